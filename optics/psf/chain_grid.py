"""Go through the chain from panel to sensor on grids, by FFTs."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
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
from optics.psf.axes import lens_plane, plan_propagator_axes
from optics.psf.chain_engine import ChainEngine
from optics.psf.dim_windows import AddedLight
from optics.psf.lens_grid import choose_lens_grid
from optics.psf.request import PSFRequest
from optics.psf.stop_mask import BlockwiseStopMask
from optics.psf.to_lens import PanelToLensPropagator, PropagatorAxis, propagate_to_lens
from optics.psf.to_sensor import LensWave, PanelToSensorMap, panel_spectrum, propagate_to_sensor


@dataclass(frozen=True)
class ChainGridSettings:
    """Tune how a GridEngine divides its tolerance and memory.

    grid_tol_share: share of the tolerance that the grid at the lens may use. Chosen.
    transform_tol_share: share of the tolerance that a Fourier transform may use, in the field.
    Chosen.
    lens_wave_memory_share: share of the allowed memory in which an aberrated lens' wave may be
    cached. Chosen.
    planning_calls: time of what the first call computes for all later ones, in calls. Fitted to 130
    random chains, like the next.
    planning_passes: the same for each sample at the lens, in passes.
    """

    grid_tol_share: float = 0.92
    transform_tol_share: float = 0.02
    lens_wave_memory_share: float = 0.25
    planning_calls: float = 30.0
    planning_passes: float = 8.0


_SETTINGS = ChainGridSettings()


class GridEngine(ChainEngine):
    """Computes the PSF behind a panel and a lens with the lens' plane on a grid, by FFTs.

    FFTs lead from the panel to the lens, where each sample is weighted by the area that the stop
    leaves open. FFTs lead onward to the sensor. Light of frequencies that reach no farther than the
    stop's edge is left out as far as the tolerance allows; see `choose_lens_grid`. Thesis Eq. 5.1
    to 5.7; E. A. Sziklas and A. E. Siegman, 1975, doi 10.1364/AO.14.001874.

    search: finds the grid at the lens that keeps the tolerance.
    promised_tol: the relative L2 error that the caller was promised, where the request's own is
    stricter; the request's own by default.
    kinds: engines of which the cheapest stands in where a dark window needs a stricter one; the
    engine's own type by default.

    Raises ToleranceError where no grid keeps the tolerance.
    """

    name = "chain"

    def _plan(self, n: PSFRequest) -> None:
        self._set_precision(0.1 * n.tol < FLOAT32_ARITHMETIC)
        rough = self._sphere_error()
        allowed = _SETTINGS.grid_tol_share * n.tol - rough
        if not allowed > 0:
            raise unreachable_tolerance_error(n.tol, 1.1 * (rough + 0.2 * n.tol))
        self._grid = choose_lens_grid(n, self._camera, self._search, allowed)
        self._build_propagators(plan_propagator_axes(n, self._camera, self._grid))
        left_out = self._grid.error + rough + 2 * self._sensor_map.sensor_transform.error
        self.error = ErrorEstimate(left_out, "estimate, for an evenly lit panel")

    def _build_propagators(self, axes: list[PropagatorAxis]) -> None:
        """Build the propagator to the lens, the map to the sensor, and the lens' wave."""
        self.propagator = PanelToLensPropagator(axes[0], axes[1], self._dtype)
        self._lens_plane = lens_plane(self._request.numeric, axes)
        self._sensor_map = self._plan_sensor_map()
        self._lens_wave = self._plan_lens_wave()
        rows, columns = self._lens_plane.shape
        self.sampling = f"{columns}x{rows} samples at the lens"

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
        self._build_propagators(
            [
                replace(
                    axis, shared_range=(math.ceil(a * axis.period), math.floor(b * axis.period))
                )
                for axis, (a, b) in zip(axes, frequency_ranges, strict=True)
            ]
        )

    def _plan_lens_wave(self) -> LensWave | None:
        """Plan the lens' wave if it isn't a product of factors along y and x.

        Returns None for other lenses, and where derivatives are wanted, because the wave is then
        computed at every call.
        """
        n = self._request.numeric
        if n.lens.has_quadratic_phase or self._request.differentiable:
            return None
        room = _SETTINGS.lens_wave_memory_share * n.budget.memory
        return LensWave(partial(_lens_phase, n), self._lens_plane, self._dtype, room)

    def _plan_sensor_map(self) -> PanelToSensorMap:
        """Plan the map from the panel's spectrum to the field at the sensor."""
        n, lens = self._request.numeric, self._camera.lens
        real = torch.zeros((), dtype=self._dtype).real.dtype
        openings = BlockwiseStopMask(lens.stop, n.radius, self._lens_plane, real)
        error = max(_SETTINGS.transform_tol_share * n.tol, FINEST_GRIDDING)
        geometry = FourierGeometry(self._lens_plane, n.samples, n.scale)
        return PanelToSensorMap(self.propagator, openings, geometry, error, n.budget)

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
        seconds = super().planning_seconds(speed) + _SETTINGS.planning_calls * speed.call
        seconds += _SETTINGS.planning_passes * rows * columns * speed.touch
        return seconds + (self._lens_wave.planning_seconds(speed) if self._lens_wave else 0.0)

    def prepare(self) -> None:
        """Compute what is kept between calls; raise ToleranceError if the tolerance isn't kept."""
        if not self.error.value + self.arithmetic <= self._request.tol:
            raise unreachable_tolerance_error(self._request.tol, self.error.value + self.arithmetic)
        if not self._request.differentiable:
            if self._lens_wave:
                self._lens_wave.prepare()
            self._sensor_map.set_lens_wave(self._separable_lens_wave(), self._lens_wave)

    def _separable_lens_wave(self) -> tuple[torch.Tensor, torch.Tensor]:
        """Return the lens' wave as factors along y and x, ones if it isn't their product."""
        n = self._request.numeric
        if not n.lens.has_quadratic_phase:
            y, x = (torch.ones(count, dtype=torch.complex128) for count in self._lens_plane.shape)
            return y, x
        curvature = defocus_curvature(n.lens, n.object_to_lens_distance, n.wavelength) / (
            2 * math.pi
        )
        y, x = (
            unit_phasor(curvature * self._lens_plane.coordinates(axis) ** 2, torch.complex128)
            for axis in (0, 1)
        )
        return y, x

    def intensity(
        self,
        phase: torch.Tensor | None,
        amplitude: torch.Tensor | None,
        added: AddedLight | None = None,
    ) -> torch.Tensor:
        """Compute the share of the light on every sample, (..., rows, columns).

        phase: radians, (..., rows, columns) of the panel.
        added: other light that is added afterwards. The error that is told is that of both
        together.
        """
        modulated = self.panel_field(phase, amplitude)
        if not modulated.numel():
            return self.empty_intensity(modulated)
        spectrum: Callable[[], torch.Tensor]
        if self._request.differentiable:
            field = self._differentiable_field_at_sensor(self.propagator, modulated)
            spectrum = partial(self.propagator.spectrum, modulated.detach())
        else:
            known = panel_spectrum(self.propagator, modulated)
            field, spectrum = propagate_to_sensor(self._sensor_map, known), known.detach
        for axis, part in self.wavefront_slope_fields(modulated):
            field = field + self._field_at_sensor(self._slope_propagator(axis), part)
        return self._intensity_from_field(field, phase, amplitude, spectrum, added)

    def _slope_propagator(self, axis: int) -> PanelToLensPropagator:
        axes = [
            replace(one, has_pixel_slope=k == axis) for k, one in enumerate(self.propagator.axes)
        ]
        return PanelToLensPropagator(axes[0], axes[1], self._dtype)

    def _field_at_sensor(
        self, propagator: PanelToLensPropagator, field: torch.Tensor
    ) -> torch.Tensor:
        """Propagate a field to the lens by `propagator`, then to the sensor."""
        if self._request.differentiable:
            return self._differentiable_field_at_sensor(propagator, field)
        return propagate_to_sensor(
            self._sensor_map.with_propagator(propagator), panel_spectrum(propagator, field)
        )

    def intensity_from_spectrum(
        self,
        spectrum: torch.Tensor,
        phase: torch.Tensor | None,
        amplitude: torch.Tensor | None,
        added: AddedLight | None = None,
    ) -> torch.Tensor:
        """Compute what `intensity` does, from a known spectrum of the panel (`panel_spectrum`)."""
        field = propagate_to_sensor(self._sensor_map, spectrum)
        return self._intensity_from_field(field, phase, amplitude, spectrum.detach, added)

    def _differentiable_field_at_sensor(
        self, propagator: PanelToLensPropagator, field: torch.Tensor
    ) -> torch.Tensor:
        """Propagate a field from panel to sensor, differentiable in all lengths."""
        q = self._request
        turns = _lens_phase(q, *self._lens_plane.mesh()) / (2 * math.pi)
        wave = unit_phasor(turns, self._dtype)
        wave = wave * coverage(self._camera.lens.stop, q.numeric.radius, self._lens_plane)
        field = propagate_to_lens(propagator, field, self._propagator_variables()) * wave.to(
            self._dtype
        ).to(field.device)
        moved = q.transform_variables
        return self._sensor_map.sensor_transform(field, moved.stretch, moved.shift)

    def _intensity_from_field(
        self,
        field: torch.Tensor,
        phase: torch.Tensor | None,
        amplitude: torch.Tensor | None,
        spectrum: Callable[[], torch.Tensor],
        added: AddedLight | None,
    ) -> torch.Tensor:
        """Compute the light from the field at the sensor.

        spectrum: returns the panel's spectrum without derivatives. It is called only for a window
        that gets little light.
        """
        cell = (
            self._lens_plane.pitch[0] * self._lens_plane.pitch[1] / self._request.numeric.radius**2
        )
        light = (field.real**2 + field.imag**2) * (self.intensity_scale() * cell**2)
        light = light.to(torch.float64 if self._dtype == torch.complex128 else torch.float32)

        def measure_passing_brightness() -> tuple[float, float]:
            low, high = (end.tolist() for end in self._edge_scatter.passing_band)
            power = self.propagator.mean_band_power(spectrum(), low, high)
            rows, columns = self._camera.panel.shape
            sent: Any = rows * columns
            if amplitude is not None:
                sent = (amplitude.detach().abs() ** 2).sum(dim=(-2, -1)).clamp(min=1e-300)
            found = power / sent
            return float(found.min()), float(found.max())

        return self._intensity_or_replan(light, phase, amplitude, added, measure_passing_brightness)

    @cached_property
    def _passing_error_share(self) -> float:
        return self._search.passing_error_share(self._grid)


def _lens_phase(q: PSFRequest, y: torch.Tensor, x: torch.Tensor) -> torch.Tensor:
    """Return the phase of the lens' wave at points (y, x) of its plane in metres, in radians."""
    radius = q.numeric.radius
    return pupil_phase(q.lens, q.object_to_lens_distance, q.wavelength, y / radius, x / radius)
