"""Any smooth wave in any stop: exact quadrature, and a non-uniform FFT to the samples."""

from __future__ import annotations

from collections.abc import Iterator

import torch

from optics.accuracy import MachineSpeed, ToleranceError, unkeepable
from optics.fourier.nonuniform import (
    FINEST_NUFFT,
    NonuniformTransform,
    nonuniform_bytes,
    nonuniform_seconds,
)
from optics.point.engine import Engine, Lit, double_arithmetic
from optics.point.question import Question
from optics.psf.truth import Probe
from optics.pupil import wave_phase
from optics.stop.quadrature import Nodes, count_nodes, stop_blocks, stop_rule

_SHARE = 0.1
"""Of the tolerance that quadrature and transform may each use, in the field."""

_TRIES = 4

_BYTES_A_NODE = 340
"""Its position and weight, its wave, and what its transform keeps of it."""

_REMADE = 6.0
"""Times as long a call takes that makes its nodes anew."""

_LEAST_BLOCK = 1 << 20
_MOST_NODES = 300_000_000
"""Some minutes of work."""


class ScatteredEngine(Engine):
    """Nodes that follow the stop's boundary, and finufft from them to the samples.

    Whole circles of nodes in round stops, rows and columns in rectangles, and arcs in all
    others. The error is spectral in the nodes: two digits cost a few percent. Where the
    nodes fit no memory they are made anew at every call, block by block.
    """

    name = "quadrature and non-uniform FFT"
    precision = "float64"

    def __init__(self, question: Question, probe: Probe) -> None:
        self._question, self._probe = question, probe
        q = question.numeric
        self.arithmetic = double_arithmetic(q)
        self._error = max(_SHARE * q.tol, FINEST_NUFFT)
        self._count = count_nodes(q.lens.stop, q.steepness, _SHARE * q.tol)
        self._window = nonuniform_bytes(0, q.samples)
        allowed = (q.budget.memory - self._window) // _BYTES_A_NODE
        self._most = max(allowed, _LEAST_BLOCK)
        # Derivatives need all nodes at once.
        self._held = self._count <= self._most or question.differentiable
        self._whole: _Block | None = None
        if self._count > _MOST_NODES:
            raise ToleranceError(
                f"tol {q.tol:g} can't be kept: the wave turns so fast that it takes "
                f"{self._count:.1e} nodes in the stop; bring the object closer to the plane in "
                "focus, or ask for a smaller window"
            )

    @property
    def bytes(self) -> int:
        nodes = self._count if self._held else min(self._count, self._most)
        return self._window + _BYTES_A_NODE * nodes

    def cpu_seconds(self, speed: MachineSpeed) -> float:
        seconds = nonuniform_seconds(self._count, self._question.samples, self._error, speed)
        return seconds if self._held else _REMADE * seconds

    def prepare(self) -> None:
        q = self._question.numeric
        nodes = stop_rule(q.lens.stop, q.steepness, _SHARE * q.tol) if self._held else None
        if nodes is not None:
            self._count = nodes.count
        self.sampling = f"{self._count} nodes in the stop"
        for _ in range(_TRIES):
            if nodes is not None:
                self._whole = _Block(nodes, self._question, self._error)
            with torch.no_grad():
                self.error = self._probe.measure(self.intensity(None, None))
            wanted = q.tol - self.arithmetic
            if self.error.value <= wanted:
                return
            # A window in the dark: the transform's error is one of all the light.
            if self._error <= FINEST_NUFFT:
                break
            self._error = max(self._error * min(0.1, wanted / self.error.value), FINEST_NUFFT)
        raise unkeepable(q.tol, 1.5 * self.error.value + self.arithmetic)

    def _blocks(self) -> Iterator[_Block]:
        """Where all nodes don't fit the memory: some of them after the others."""
        q = self._question.numeric
        for nodes in stop_blocks(q.lens.stop, q.steepness, _SHARE * q.tol, self._most):
            yield _Block(nodes, self._question, self._error)

    def points(self) -> tuple[torch.Tensor, torch.Tensor]:
        if self._whole is None:
            empty = torch.zeros(0, dtype=torch.float64)
            return empty, empty
        return self._whole.transform.positions()

    def intensity(self, phase: torch.Tensor | None, amplitude: torch.Tensor | None) -> torch.Tensor:
        if self._whole is not None:
            factor = self.modulation(phase, amplitude, (self._count,))
            self.require_slope(phase)
            field = self._whole.field(factor)
        else:
            self._require_plain(phase, amplitude)
            field = sum((block.field(None) for block in self._blocks()), torch.zeros(()))
        return (field.real**2 + field.imag**2) * self._question.share

    def _require_plain(self, phase: torch.Tensor | None, amplitude: torch.Tensor | None) -> None:
        if phase is not None or amplitude is not None:
            raise ValueError(
                f"a pupil of {self._count} nodes takes no extra phase or amplitude; give the lens "
                "aberrations, or bring the object closer to the plane in focus"
            )


class _Block(Lit):
    """Some nodes, the light of a point on them, and the transform to the samples."""

    def __init__(self, nodes: Nodes, question: Question, error: float) -> None:
        q = question.numeric
        self._nodes, self._question = nodes, question
        self.transform = NonuniformTransform(
            nodes.y * q.radius, nodes.x * q.radius, q.samples, q.scale, error
        )

    def field(self, factor: torch.Tensor | None) -> torch.Tensor:
        """On the samples, in square stop radii; factor: of the modulation, on the nodes."""
        q, wave = self._question, self._wave()
        if factor is not None:
            wave = wave.to(factor.device) * factor
        moved = q.derivatives
        return self.transform(wave, moved.stretch, moved.shift)

    def _made_wave(self) -> torch.Tensor:
        """Weights and phases."""
        q, nodes = self._question, self._nodes
        phase = wave_phase(q.lens, q.distance, q.wavelength, nodes.y, nodes.x)
        return torch.polar(torch.ones_like(phase), phase) * nodes.weight
