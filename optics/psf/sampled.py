"""Integrate a lens' pupil on a square grid, which is quick for large tolerances."""

from __future__ import annotations

import math

import torch

from optics.accuracy import (
    FLOAT32_ARITHMETIC,
    DearerThanOthersError,
    MachineSpeed,
    cheapest_candidate,
    require_memory,
    unreachable_tolerance_error,
)
from optics.camera.pupil import pupil_phase
from optics.camera.stop_areas import coverage
from optics.fourier import FourierGeometry, valid_transforms
from optics.plane import Plane
from optics.psf.engine import CachedPupilWave, PSFEngine
from optics.psf.phase_factor import wrap_phase
from optics.psf.reference_probe import ReferenceProbe
from optics.psf.request import PSFRequest

# Relative error of the light over the squared change of phase between neighbouring samples, in
# radians, at the stop's edge and towards the light. It was fitted to exact integrals for 40
# lenses, where it lay between 1e-3 and 7e-3. A grid that proves too coarse is refined.
_EDGE_ERROR_FACTOR = 3e-3

# Largest change of phase between neighbouring samples for the whole window, in radians. It is
# below Nyquist's limit of pi.
_MAX_PHASE_STEP = 0.8 * math.pi

_MIN_SIZE = 16  # fewest samples across the grid. Chosen.

_GROWTH = 1.5  # largest factor by which the grid is refined in one step. Chosen.

_MAX_TRIES = 4  # most grids that are tried. Chosen.

# Passes over a sample of the pupil while the open area and the wave are computed; measured.
_PASSES_PER_SAMPLE = 230.0

# Steps of Python for each piece of the stop's outline in the open area; measured.
_STEPS_PER_PIECE = 20.0

_PLANNING_CALLS = 8.0  # fixed cost of planning in calls; measured


class SampledEngine(CachedPupilWave, PSFEngine):
    """Computes the PSF of a lens from the open area and the wave on a grid over the pupil.

    The cheapest Fourier transform leads to the sensor. The grid's error falls with the square of
    its pitch, whatever the wave. So large tolerances are cheap, and small ones take too many
    samples.
    """

    name = "grid"
    MIN_TOLERANCE = 3e-5
    """Tolerance below which a grid isn't tried, because it would be too large."""

    def __init__(self, request: PSFRequest, probe: ReferenceProbe) -> None:
        self._request, self._probe = request, probe
        q = request.numeric
        outwards, whole = (
            q.phase_slope_bound.largest_slope(1.0) - q.phase_slope_bound.tilt,
            q.phase_slope_bound.largest_slope(1.0),
        )
        # The wave sends its light at most to the samples for which the kernel has the same slope.
        lit = outwards + min(outwards + math.pi, q.phase_slope_bound.tilt)
        needed = max(
            2 * lit * math.sqrt(_EDGE_ERROR_FACTOR / q.tol),
            2 * whole / _MAX_PHASE_STEP,
        )
        self._grid_size = max(_MIN_SIZE, math.ceil(needed))
        # Transforms of a grid that doesn't fit aren't compared.
        require_memory(
            f"a PSF from {self._grid_size:.3g}² samples across the stop",
            8.0 * self._grid_size**2,
            q.budget.memory,
            "ask for fewer pixels, or bring the object closer to the plane in focus",
        )
        self._coarser_seconds = 0.0
        self._plan()

    def _plan(self) -> None:
        q = self._request.numeric
        self._set_precision(0.5 * q.tol < FLOAT32_ARITHMETIC)
        # A margin of one sample on every side holds edges that lie on the outermost lines.
        pitch = 2 * q.radius / (self._grid_size - 2)
        self._plane = Plane((self._grid_size, self._grid_size), (pitch, pitch))
        geometry = FourierGeometry(self._plane, q.samples, q.scale)
        self._transform = cheapest_candidate(
            valid_transforms(geometry, self._dtype, 0.03 * q.tol, to_few_samples=True),
            q.budget,
            "a PSF",
        )
        self.name = f"grid, {self._transform.name}"
        self.sampling = f"{self._grid_size}² samples across the stop"

    @property
    def bytes(self) -> int:
        return self._transform.bytes + 3 * self._dtype.itemsize * self._grid_size**2

    def cpu_seconds(self, speed: MachineSpeed) -> float:
        return self._transform.cpu_seconds(speed)

    def planning_seconds(self, speed: MachineSpeed) -> float:
        fixed = _PLANNING_CALLS * speed.call + self._probe.planning_seconds(speed)
        return fixed + self._grid_seconds(speed) + self._coarser_seconds

    def _grid_seconds(self, speed: MachineSpeed) -> float:
        """Predict the seconds of the grid over the pupil, and of the light that judges it."""
        wave = _PASSES_PER_SAMPLE * self._grid_size**2 * speed.touch
        pieces = sum(len(loop.pieces) for loop in self._request.lens.stop.loops)
        return wave + _STEPS_PER_PIECE * pieces * speed.step + self.cpu_seconds(speed)

    def prepare(self) -> None:
        q = self._request.numeric
        for _ in range(_MAX_TRIES):
            self._cached_wave = None
            self._amplitude = coverage(q.lens.stop, q.radius, self._plane)
            with torch.no_grad():
                light = self.intensity(None, None)
            self.error = self._probe.measure_error(light)
            if self.error.value + self.arithmetic <= q.tol:
                self._keep_first_light(light)
                return
            self._coarser_seconds += self._grid_seconds(q.budget.speed)
            ratio = math.sqrt(self.error.value / q.tol) * 1.1
            growth = min(max(ratio, 1.2), _GROWTH)
            self._grid_size = math.ceil(self._grid_size * growth)
            self._plan()
            if self.bytes > q.budget.memory:
                break
            speed, calls = q.budget.speed, q.budget.calls
            if self._grid_seconds(speed) + calls * self.cpu_seconds(speed) > self.others_seconds:
                raise DearerThanOthersError(f"a grid of {self._grid_size}² samples")
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
        first = self._first_light(phase, amplitude)
        if first is not None:
            return first
        q = self._request
        wave = self._pupil_wave()
        factor = self.modulation_factor(phase, amplitude, wave.shape[-2:])
        self.require_resolved(phase, amplitude)
        if factor is not None:
            wave = wave.to(factor.device) * factor.to(self._dtype)
        moved = q.transform_variables
        field = self._transform(wave, moved.stretch, moved.shift)
        light = (field.real**2 + field.imag**2) * q.intensity_scale
        if phase is not None or amplitude is not None:
            self._tell_pattern_error(light)
        return light
