"""Any smooth wave in any stop: exact quadrature, and a non-uniform FFT to the samples."""

from __future__ import annotations

import torch

from optics.accuracy import MachineSpeed, ToleranceError
from optics.edge import rounded_up
from optics.fourier.nonuniform import (
    FINEST_NUFFT,
    NonuniformTransform,
    nonuniform_bytes,
    nonuniform_seconds,
)
from optics.psf.engine import Engine, double_arithmetic
from optics.psf.question import Question
from optics.psf.truth import Probe
from optics.pupil import wave_phase
from optics.quadrature import Nodes, count_nodes, stop_rule

_SHARE = 0.1
"""Of the tolerance that quadrature and transform may each use, in the field."""

_TRIES = 4


class ScatteredEngine(Engine):
    """Nodes that follow the stop's boundary, and finufft from them to the samples.

    Polar quadrature for round stops, Gauss-Legendre products for rectangles, and fans for
    whatever has straight edges. The error is spectral in the nodes: two digits cost a few
    percent.
    """

    name = "quadrature and non-uniform FFT"
    precision = "float64"

    def __init__(self, question: Question, probe: Probe) -> None:
        self._question, self._probe = question, probe
        q = question.numeric
        self.arithmetic = double_arithmetic(q)
        self._error = max(_SHARE * q.tol, FINEST_NUFFT)
        self._count = count_nodes(q.lens.stop, q.steepness, _SHARE * q.tol)
        self._nodes: Nodes | None = None
        self._kept: torch.Tensor | None = None

    @property
    def bytes(self) -> int:
        return nonuniform_bytes(self._count, self._question.samples)

    def cpu_seconds(self, speed: MachineSpeed) -> float:
        return nonuniform_seconds(self._count, self._question.samples, self._error, speed)

    def prepare(self) -> None:
        q = self._question.numeric
        self._nodes = stop_rule(q.lens.stop, q.steepness, _SHARE * q.tol)
        self._count = self._nodes.count
        self.sampling = f"{self._count} nodes in the stop"
        for _ in range(_TRIES):
            self._transform = self._transform_of(self._error)
            with torch.no_grad():
                self.error = self._probe.measure(self.intensity(None, None))
            wanted = q.tol - self.arithmetic
            if self.error.value <= wanted:
                return
            # A window in the dark: the transform's error is one of all the light.
            if self._error <= FINEST_NUFFT:
                break
            self._error = max(self._error * min(0.1, wanted / self.error.value), FINEST_NUFFT)
        floor = rounded_up(1.5 * self.error.value + self.arithmetic)
        raise ToleranceError(f"tol {q.tol:g} can't be kept; ask for tol {floor} or more")

    def _transform_of(self, error: float) -> NonuniformTransform:
        q, nodes = self._question.numeric, self._nodes
        assert nodes is not None
        return NonuniformTransform(
            nodes.y * q.radius, nodes.x * q.radius, q.samples, q.scale, error
        )

    def points(self) -> tuple[torch.Tensor, torch.Tensor]:
        return self._transform.positions()

    def _wave(self) -> torch.Tensor:
        """Weights and phases of a point's light; kept unless somebody asks for derivatives."""
        if self._kept is not None:
            return self._kept
        q, nodes = self._question, self._nodes
        assert nodes is not None
        phase = wave_phase(q.lens, q.distance, q.wavelength, nodes.y, nodes.x)
        wave = torch.polar(torch.ones_like(phase), phase) * nodes.weight
        if not wave.requires_grad:
            self._kept = wave
        return wave

    def intensity(self, phase: torch.Tensor | None, amplitude: torch.Tensor | None) -> torch.Tensor:
        q = self._question
        wave = self._wave()
        factor = self.modulation(phase, amplitude, (self._count,))
        if factor is not None:
            wave = wave.to(factor.device) * factor
        n = q.numeric
        moved = q.derivatives(n.radius, n.scale)
        field = self._transform(wave, moved.stretch, moved.shift)
        return (field.real**2 + field.imag**2) * lens_share(q)


def lens_share(question: Question) -> torch.Tensor | float:
    """What turns |integral over the stop in stop radii|² into shares of the light a sample."""
    q = question
    area = q.samples.pitch[0] * q.samples.pitch[1]
    return area * q.radius**2 / (q.scale**2 * q.lens.stop.area)
