"""Compute the PSF of any smooth wave in any stop, by quadrature and a non-uniform FFT."""

from __future__ import annotations

from collections.abc import Iterator

import torch

from optics.accuracy import MachineSpeed, ToleranceError, unreachable_tolerance_error
from optics.camera.pupil import pupil_phase
from optics.camera.stop_nodes import (
    QuadratureNodes,
    count_nodes,
    rule_seconds,
    stop_rule,
    stop_rule_blocks,
)
from optics.fourier.nonuniform import (
    FINEST_COARSE_NUFFT,
    FINEST_NUFFT,
    NonuniformTransform,
    nonuniform_bytes,
    nonuniform_seconds,
)
from optics.psf.engine import CachedPupilWave, PSFEngine, double_precision_error
from optics.psf.reference_probe import PASSES_PER_ABERRATION, ReferenceProbe
from optics.psf.request import PSFRequest

_LEAST_BLOCK = 1 << 20


# Share of the tolerance that the quadrature and the transform may each use, in the field. Chosen.
_STEP_TOL_SHARE = 0.1

_MAX_TRIES = 4  # most tolerances of the transform that are tried. Chosen.

# Memory in bytes for a node's position, weight and wave, and for its data in the transform.
_BYTES_PER_NODE = 340

# Time of a call that computes its nodes anew, over that of a call with nodes in memory.
_REBUILD_COST_FACTOR = 6.0

_MAX_NODES = 300_000_000  # most nodes that are computed; they take some minutes

# Passes over a node while its wave is computed and finufft sorts it; measured.
_PASSES_PER_WAVE = 70.0

_PLANNING_CALLS = 20.0  # fixed cost of planning in calls; measured


class ScatteredNodesEngine(PSFEngine):
    """Computes the PSF by nodes that follow the stop's boundary, and finufft to the samples.

    The nodes lie on whole circles in round stops, on rows and columns in rectangles, and on arcs in
    all other stops. The error falls exponentially with the number of nodes, so that two more digits
    cost a few percent. If the nodes don't fit the memory, they are computed anew at every call,
    block by block.
    """

    name = "quadrature and non-uniform FFT"
    precision = "float64"

    def __init__(self, request: PSFRequest, probe: ReferenceProbe) -> None:
        self._request, self._probe = request, probe
        q = request.numeric
        self.arithmetic = double_precision_error(q)
        self._quadrature_tol = _STEP_TOL_SHARE * q.tol
        self._transform_tol = max(self._quadrature_tol, FINEST_NUFFT)
        self._node_count = count_nodes(q.lens.stop, q.phase_slope_bound, self._quadrature_tol)
        self._window = nonuniform_bytes(0, q.samples)
        allowed = (q.budget.memory - self._window) // _BYTES_PER_NODE
        self._max_block_nodes = max(allowed, _LEAST_BLOCK)
        # Derivatives need all nodes in memory at once.
        self._nodes_in_memory = self._node_count <= self._max_block_nodes or request.differentiable
        self._full_block: _NodeBlock | None = None
        self._coarser_seconds = 0.0
        if self._node_count > _MAX_NODES:
            raise ToleranceError(
                f"tol {q.tol:g} can't be kept: the wave turns so fast that it takes "
                f"{self._node_count:.1e} nodes in the stop",
                "bring the object closer to the plane in focus, or ask for a smaller window",
            )

    @property
    def bytes(self) -> int:
        nodes = (
            self._node_count
            if self._nodes_in_memory
            else min(self._node_count, self._max_block_nodes)
        )
        return self._window + _BYTES_PER_NODE * nodes

    def cpu_seconds(self, speed: MachineSpeed) -> float:
        seconds = nonuniform_seconds(
            self._node_count,
            self._request.samples,
            self._transform_tol,
            speed,
            few_points=self._transform_tol >= FINEST_COARSE_NUFFT,
        )
        return seconds if self._nodes_in_memory else _REBUILD_COST_FACTOR * seconds

    def planning_seconds(self, speed: MachineSpeed) -> float:
        q = self._request.numeric
        rule = rule_seconds(q.lens.stop, q.phase_slope_bound, self._quadrature_tol, speed)
        fixed = _PLANNING_CALLS * speed.call + self._probe.planning_seconds(speed)
        return fixed + rule + self._trial_seconds(speed) + self._coarser_seconds

    def _trial_seconds(self, speed: MachineSpeed) -> float:
        """Predict the seconds of the wave on the nodes, and of the light that judges it."""
        aberrations = len(self._request.numeric.lens.aberrations)
        passes = _PASSES_PER_WAVE + PASSES_PER_ABERRATION * aberrations
        return passes * self._node_count * speed.touch + self.cpu_seconds(speed)

    def prepare(self) -> None:
        q = self._request.numeric
        nodes = (
            stop_rule(q.lens.stop, q.phase_slope_bound, self._quadrature_tol)
            if self._nodes_in_memory
            else None
        )
        if nodes is not None:
            self._node_count = nodes.count
        self.sampling = f"{self._node_count} nodes in the stop"
        for _ in range(_MAX_TRIES):
            if nodes is not None:
                self._full_block = _NodeBlock(nodes, self._request, self._transform_tol)
            with torch.no_grad():
                light = self.intensity(None, None)
            self.error = self._probe.measure_error(light)
            wanted = q.tol - self.arithmetic
            if self.error.value <= wanted:
                self._keep_first_light(light)
                return
            self._coarser_seconds += self._trial_seconds(q.budget.speed)
            # The transform's error scales with all of the light, so a dim window needs a finer one.
            if self._transform_tol <= FINEST_NUFFT:
                break
            self._transform_tol = max(
                self._transform_tol * min(0.1, wanted / self.error.value), FINEST_NUFFT
            )
        raise unreachable_tolerance_error(q.tol, 1.5 * self.error.value + self.arithmetic)

    def _blocks(self) -> Iterator[_NodeBlock]:
        """Yield the nodes in blocks; not all nodes of the stop fit the memory."""
        q = self._request.numeric
        for nodes in stop_rule_blocks(
            q.lens.stop, q.phase_slope_bound, self._quadrature_tol, self._max_block_nodes
        ):
            yield _NodeBlock(nodes, self._request, self._transform_tol)

    def points(self) -> tuple[torch.Tensor, torch.Tensor]:
        if self._full_block is None:
            empty = torch.zeros(0, dtype=torch.float64)
            return empty, empty
        return self._full_block.transform.positions()

    def intensity(self, phase: torch.Tensor | None, amplitude: torch.Tensor | None) -> torch.Tensor:
        first = self._first_light(phase, amplitude)
        if first is not None:
            return first
        if self._full_block is not None:
            factor = self.modulation_factor(phase, amplitude, (self._node_count,))
            self.require_resolved(phase, amplitude)
            field = self._full_block.field(factor)
        else:
            self._require_no_modulation(phase, amplitude)
            field = sum((block.field(None) for block in self._blocks()), torch.zeros(()))
        light = (field.real**2 + field.imag**2) * self._request.intensity_scale
        if phase is not None or amplitude is not None:
            self._tell_pattern_error(light)
        return light

    def _require_no_modulation(
        self, phase: torch.Tensor | None, amplitude: torch.Tensor | None
    ) -> None:
        if phase is not None or amplitude is not None:
            raise ValueError(
                f"a pupil of {self._node_count} nodes takes no extra phase or amplitude; give the "
                "lens aberrations, or bring the object closer to the plane in focus"
            )


class _NodeBlock(CachedPupilWave):
    """Holds a block of nodes in the stop, and the transform from them to the samples."""

    def __init__(self, nodes: QuadratureNodes, request: PSFRequest, error: float) -> None:
        q = request.numeric
        self._nodes, self._request = nodes, request
        self.transform = NonuniformTransform(
            nodes.y * q.radius,
            nodes.x * q.radius,
            q.samples,
            q.scale,
            error,
            few_points=error >= FINEST_COARSE_NUFFT,
        )

    def field(self, factor: torch.Tensor | None) -> torch.Tensor:
        """Compute the field on the samples from this block of nodes, in square stop radii.

        factor: complex modulation on the nodes, or None.
        """
        q, wave = self._request, self._pupil_wave()
        if factor is not None:
            wave = wave.to(factor.device) * factor
        moved = q.transform_variables
        return self.transform(wave, moved.stretch, moved.shift)

    def _compute_pupil_wave(self) -> torch.Tensor:
        """Compute the lens' wave on the nodes, times their weights."""
        q, nodes = self._request, self._nodes
        phase = pupil_phase(q.lens, q.distance, q.wavelength, nodes.y, nodes.x)
        return torch.complex(torch.cos(phase) * nodes.weight, torch.sin(phase) * nodes.weight)
