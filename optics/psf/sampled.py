"""A lens' pupil on a square grid, with exact edges: quick where a percent will do."""

from __future__ import annotations

import math

import torch

from optics.accuracy import FLOAT32_ARITHMETIC, MachineSpeed, unreachable_tolerance_error
from optics.fourier import FourierGeometry, plan_transform
from optics.plane import Plane
from optics.point.engine import CachedPupilWave, PSFEngine, wrap_phase
from optics.point.request import PSFRequest
from optics.psf.reference_probe import ReferenceProbe
from optics.pupil import pupil_phase
from optics.stop.coverage import coverage

_EDGE_ERROR_FACTOR = 3e-3
"""The error of a grid with covered edges is about this times the radians, at the stop's edge
and towards the light, from one of its samples to the next, squared: fitted to exact integrals
for 40 lenses, where it lay between 1e-3 and 7e-3. A grid that turns out too coarse is refined."""

_MAX_PHASE_STEP = 0.8 * math.pi
"""Radians from sample to sample in the whole window, below Nyquist's."""

_MIN_GRID_SIZE = 16
_GROWTH = 1.5
_TRIES = 4


class SampledEngine(CachedPupilWave, PSFEngine):
    """The stop's covered area and the wave on a grid, and the cheapest transform of it.

    What most programs do. The grid's error falls with the square of its pitch, whatever the
    wave: a few digits are cheap, and many unaffordable.
    """

    name = "grid"
    MIN_TOLERANCE = 3e-5
    """No tolerance below this is worth a grid."""

    def __init__(self, request: PSFRequest, probe: ReferenceProbe) -> None:
        self._request, self._probe = request, probe
        q = request.numeric
        outwards, whole = (
            q.phase_slope_bound.largest_slope(1.0) - q.phase_slope_bound.tilt,
            q.phase_slope_bound.largest_slope(1.0),
        )
        # A wave of such a slope sends its light to where the kernel's is the same, at most.
        lit = outwards + min(outwards + math.pi, q.phase_slope_bound.tilt)
        needed = max(2 * lit * math.sqrt(_EDGE_ERROR_FACTOR / q.tol), 2 * whole / _MAX_PHASE_STEP)
        self._grid_size = max(_MIN_GRID_SIZE, math.ceil(needed))
        self._plan()

    def _plan(self) -> None:
        q = self._request.numeric
        self._set_precision(0.5 * q.tol < FLOAT32_ARITHMETIC)
        # A margin of a sample on every side, for edges that lie on the outermost lines.
        pitch = 2 * q.radius / (self._grid_size - 2)
        self._plane = Plane((self._grid_size, self._grid_size), (pitch, pitch))
        geometry = FourierGeometry(self._plane, q.samples, q.scale)
        self._transform = plan_transform(geometry, self._dtype, q.budget, error=0.03 * q.tol)
        self.name = f"grid, {self._transform.name}"
        self.sampling = f"{self._grid_size}² samples across the stop"

    @property
    def bytes(self) -> int:
        return self._transform.bytes + 3 * self._dtype.itemsize * self._grid_size**2

    def cpu_seconds(self, speed: MachineSpeed) -> float:
        return self._transform.cpu_seconds(speed)

    def prepare(self) -> None:
        q = self._request.numeric
        for _ in range(_TRIES):
            self._cached_wave = None
            self._amplitude = coverage(q.lens.stop, q.radius, self._plane)
            with torch.no_grad():
                self.error = self._probe.measure_error(self.intensity(None, None))
            if self.error.value + self.arithmetic <= q.tol:
                return
            ratio = math.sqrt(self.error.value / q.tol) * 1.1
            self._grid_size = math.ceil(self._grid_size * min(max(ratio, 1.2), _GROWTH))
            self._plan()
            if self.bytes > q.budget.memory:
                break
        raise unreachable_tolerance_error(q.tol, 1.5 * self.error.value + self.arithmetic)

    def points(self) -> tuple[torch.Tensor, torch.Tensor]:
        return self._plane.mesh()

    def _compute_pupil_wave(self) -> torch.Tensor:
        q, radius = self._request, self._request.numeric.radius
        y, x = self._plane.mesh()
        phase = pupil_phase(q.lens, q.distance, q.wavelength, y / radius, x / radius)
        cell = (self._plane.pitch[0] / radius) ** 2
        return torch.polar(self._amplitude * cell, wrap_phase(phase)).to(self._dtype)

    def intensity(self, phase: torch.Tensor | None, amplitude: torch.Tensor | None) -> torch.Tensor:
        q = self._request
        wave = self._pupil_wave()
        factor = self.modulation_factor(phase, amplitude, wave.shape[-2:])
        self.require_phase_slope(phase)
        if factor is not None:
            wave = wave.to(factor.device) * factor.to(self._dtype)
        moved = q.transform_variables
        field = self._transform(wave, moved.stretch, moved.shift)
        return (field.real**2 + field.imag**2) * q.intensity_scale
