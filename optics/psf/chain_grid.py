"""Go through the chain from panel to sensor on grids, by FFTs."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property, partial
from typing import Any

import torch

from optics.accuracy import (
    FLOAT32_ARITHMETIC,
    ErrorEstimate,
    MachineSpeed,
    unreachable_tolerance_error,
)
from optics.camera.pupil import defocus_curvature, pupil_phase
from optics.camera.stop_areas import coverage
from optics.fourier import FourierGeometry, unit_phasor
from optics.fourier.gridded import FINEST_GRIDDING
from optics.psf.chain_engine import ChainEngine, ChainLight
from optics.psf.dim_windows import AddedLight
from optics.psf.lens_grid import choose_lens_grid, lens_plane, plan_propagator_axes
from optics.psf.request import PSFRequest
from optics.psf.stop_mask import BlockwiseStopMask
from optics.psf.to_lens import PanelToLensPropagator, PropagatorAxis, propagate_to_lens
from optics.psf.to_sensor import LensWave, PanelToSensorMap, panel_spectrum, propagate_to_sensor

_GRID_TOL_SHARE = 0.92  # of the tolerance, for the grid at the lens; chosen
_TRANSFORM_TOL_SHARE = 0.02  # of the tolerance, for a Fourier transform, in the field; chosen
_LENS_WAVE_MEMORY_SHARE = 0.25  # of the memory, for a cached aberrated lens' wave; chosen

# Predicted times of what the first call computes for all later ones; fitted to 130 random chains.
_PLANNING_CALLS = 30.0  # in calls
_PLANNING_PASSES = 8.0  # for each sample at the lens


class GridEngine(ChainEngine):
    """Computes the PSF behind a panel and a lens with the lens' plane on a grid, by FFTs.

    FFTs lead from the panel to the lens, where each sample is weighted by the area that the stop
    leaves open. FFTs lead onward to the sensor. Light of frequencies that reach no farther than the
    stop's edge is left out as far as the tolerance allows; see `choose_lens_grid`. Thesis Eq. 5.1
    to 5.7; E. A. Sziklas and A. E. Siegman, 1975, doi 10.1364/AO.14.001874.

    Raises ToleranceError where no grid keeps the tolerance.
    """

    name = "chain"

    def _plan(self, n: PSFRequest) -> None:
        self._set_precision(0.1 * n.tol < FLOAT32_ARITHMETIC)
        rough = self._sphere_error()
        allowed = _GRID_TOL_SHARE * n.tol - rough
        if not allowed > 0:
            raise unreachable_tolerance_error(n.tol, 1.1 * (rough + 0.2 * n.tol))
        self._grid = choose_lens_grid(n, self._camera, self._search, allowed)
        self._build_propagators(plan_propagator_axes(n, self._camera, self._grid))
        left_out = self._grid.error + rough + 2 * self._sensor_map.sensor_transform.error
        self.error = ErrorEstimate(left_out, "estimate, for an evenly lit panel")

    def _build_propagators(self, axes: list[PropagatorAxis]) -> None:
        """Build the propagator to the lens, the map to the sensor, and the lens' wave."""
        n, dtype = self._request.numeric, self._dtype
        self.propagator = PanelToLensPropagator(axes[0], axes[1], dtype)
        self._lens_plane = plane = lens_plane(n, axes)
        openings = BlockwiseStopMask(self._camera.lens.stop, n.radius, plane, dtype.to_real())
        error = max(_TRANSFORM_TOL_SHARE * n.tol, FINEST_GRIDDING)
        geometry = FourierGeometry(plane, n.samples, n.scale)
        self._sensor_map = PanelToSensorMap(self.propagator, openings, geometry, error, n.budget)
        # Only the wave of an aberrated lens isn't a product of factors along y and x. Where
        # derivatives are wanted, the wave is computed at every call.
        self._lens_wave: LensWave | None = None
        if not (n.lens.has_quadratic_phase or self._request.differentiable):
            room = _LENS_WAVE_MEMORY_SHARE * n.budget.memory
            self._lens_wave = LensWave(partial(_lens_phase, n), plane, dtype, room)
        self.sampling = f"{plane.shape[1]}x{plane.shape[0]} samples at the lens"

    @property
    def can_share_spectrum(self) -> bool:
        """Whether a spectrum of the panel's modulation is all that is needed."""
        return not self._request.differentiable and self._request.sphere is None

    def use_shared_spectrum(
        self, lengths: Sequence[int], frequency_ranges: Sequence[tuple[float, float]]
    ) -> None:
        """Use spectra of the panel that other engines use too; call before `prepare`.

        lengths: FFT lengths along y and x.
        frequency_ranges: the (first, last) frequencies that the spectra hold along each axis,
        cycles per metre.
        """
        axes = plan_propagator_axes(self._request.numeric, self._camera, self._grid, lengths)
        shared = [
            (math.ceil(low * axis.period), math.floor(high * axis.period))
            for axis, (low, high) in zip(axes, frequency_ranges, strict=True)
        ]
        self._build_propagators(
            [replace(axis, shared_range=ends) for axis, ends in zip(axes, shared, strict=True)]
        )

    @property
    def bytes(self) -> int:
        rows, columns = self._lens_plane.shape
        dense = 6 * self._dtype.itemsize * rows * columns if self._request.differentiable else 0
        panel = self._camera.panel.shape
        wave = self._lens_wave.bytes if self._lens_wave else 0
        return self._sensor_map.bytes + dense + wave + 40 * panel[0] * panel[1]

    def cpu_seconds(self, speed: MachineSpeed) -> float:
        wave = self._lens_wave.cpu_seconds(speed) if self._lens_wave else 0.0
        return (self._sensor_map.cpu_seconds(speed) + wave) * (3 if self._request.sphere else 1)

    def planning_seconds(self, speed: MachineSpeed) -> float:
        """Predict the processor seconds of the search, and of what all calls share."""
        rows, columns = self._lens_plane.shape
        seconds = super().planning_seconds(speed) + _PLANNING_CALLS * speed.call
        seconds += _PLANNING_PASSES * rows * columns * speed.touch
        return seconds + (self._lens_wave.planning_seconds(speed) if self._lens_wave else 0.0)

    def prepare(self) -> None:
        """Compute what is kept between calls; raise ToleranceError if the tolerance isn't kept."""
        super().prepare()
        if self._request.differentiable:
            return
        if self._lens_wave:
            self._lens_wave.prepare()
        n, plane = self._request.numeric, self._lens_plane
        if n.lens.has_quadratic_phase:
            curvature = defocus_curvature(n.lens, n.object_to_lens_distance, n.wavelength)
            turns = (curvature / (2 * math.pi) * plane.coordinates(k) ** 2 for k in (0, 1))
            y, x = (unit_phasor(one, torch.complex128) for one in turns)
        else:
            y, x = (torch.ones(count, dtype=torch.complex128) for count in plane.shape)
        self._sensor_map.set_lens_wave((y, x), self._lens_wave)

    def _light(
        self, field: torch.Tensor, amplitude: torch.Tensor | None, added: AddedLight | None
    ) -> ChainLight:
        seen, spectrum = self._field_at_sensor(self.propagator, field)
        for (y, x), part in self._sloped_parts(field, self.propagator.axes):
            sloped = PanelToLensPropagator(y, x, self._dtype)
            seen = seen + self._field_at_sensor(sloped, part)[0]
        return self._light_from_field(seen, amplitude, spectrum)

    def _field_at_sensor(
        self, propagator: PanelToLensPropagator, field: torch.Tensor
    ) -> tuple[torch.Tensor, Callable[[], torch.Tensor]]:
        """Propagate a field from panel to sensor; differentiable in all lengths if they are wanted.

        Also returns a function that returns the panel's spectrum without derivatives.
        """
        q, plane = self._request, self._lens_plane
        if not q.differentiable:
            known = panel_spectrum(propagator, field)
            sensor_map = self._sensor_map.with_propagator(propagator)
            return propagate_to_sensor(sensor_map, known), known.detach
        wave = unit_phasor(_lens_phase(q, *plane.mesh()) / (2 * math.pi), self._dtype)
        wave = wave * coverage(self._camera.lens.stop, q.numeric.radius, plane)
        arriving = propagate_to_lens(propagator, field, self._propagator_variables())
        behind = arriving * wave.to(self._dtype).to(arriving.device)
        moved = q.transform_variables
        seen = self._sensor_map.sensor_transform(behind, moved.stretch, moved.shift)
        return seen, partial(propagator.spectrum, field.detach())

    def intensity_from_spectrum(
        self,
        spectrum: torch.Tensor,
        phase: torch.Tensor | None,
        amplitude: torch.Tensor | None,
        added: AddedLight | None = None,
    ) -> torch.Tensor:
        """Compute what `intensity` does, from a known spectrum of the panel (`panel_spectrum`)."""
        field = propagate_to_sensor(self._sensor_map, spectrum)
        found = self._light_from_field(field, amplitude, spectrum.detach)
        return self._light_or_replan(found, phase, amplitude, added)

    def _light_from_field(
        self,
        field: torch.Tensor,
        amplitude: torch.Tensor | None,
        spectrum: Callable[[], torch.Tensor],
    ) -> ChainLight:
        """Compute the light from the field at the sensor.

        spectrum: returns the panel's spectrum without derivatives. It is called only for a window
        that gets little light.
        """
        pitch = self._lens_plane.pitch
        cell = pitch[0] * pitch[1] / self._request.numeric.radius**2
        light = (field.real**2 + field.imag**2) * (self.intensity_scale() * cell**2)
        light = light.to(self._dtype.to_real())

        def measure_passing_brightness() -> tuple[float, float]:
            low, high = (end.tolist() for end in self._edge_scatter.passing_band)
            power = self.propagator.mean_band_power(spectrum(), low, high)
            rows, columns = self._camera.panel.shape
            sent: Any = rows * columns
            if amplitude is not None:
                sent = (amplitude.detach().abs() ** 2).sum(dim=(-2, -1)).clamp(min=1e-300)
            found = power / sent
            return float(found.min()), float(found.max())

        return ChainLight(light, passing_brightness=measure_passing_brightness)

    @cached_property
    def _passing_error_share(self) -> float:
        return self._search.passing_error_share(self._grid)


def _lens_phase(q: PSFRequest, y: torch.Tensor, x: torch.Tensor) -> torch.Tensor:
    """Return the phase of the lens' wave at points (y, x) of its plane in metres, in radians."""
    radius = q.numeric.radius
    return pupil_phase(q.lens, q.object_to_lens_distance, q.wavelength, y / radius, x / radius)
