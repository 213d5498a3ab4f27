"""Define the base class of all engines that go through the chain from panel to sensor."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import torch

from optics.accuracy import (
    MachineSpeed,
    MethodChoice,
    ToleranceError,
    unreachable_tolerance_error,
)
from optics.camera import Camera
from optics.camera.pupil import Scalar, numeric_camera, open_area
from optics.psf.dim_windows import AddedLight, LowLightCorrection, allowed_own_error, window_norm
from optics.psf.engine import BehindPanelEngine
from optics.psf.lens_grid import LensGridSearch
from optics.psf.request import PSFRequest
from optics.psf.to_lens import PropagatorAxis, PropagatorVariables
from optics.validation import needs_gradient, rounded_up

# Factor on the tolerance that is advised for a dim window, because another engine's light may
# differ a little. Chosen.
_DIM_MARGIN = 1.3


def search_seconds(speed: MachineSpeed) -> float:
    """Predict the seconds of the search for the light that may be neglected."""
    return 180.0 * speed.call  # fitted to 180 random chains


class ChainLight(NamedTuple):
    """The light that an engine has computed, and what is known of its error."""

    light: torch.Tensor
    rounding: float = 0.0  # relative L2 error beside what was planned
    is_judged: bool = False  # whether its error is told already
    passing_brightness: Callable[[], tuple[float, float]] | None = None
    """A quicker way to the panel's brightness than `StopEdgeScatter.passing_brightness`."""


class ChainEngine(BehindPanelEngine):
    """Computes the PSF of a panel apart from its lens: thesis Eq. 5.1 to 5.7, in Fresnel's model.

    With the point's parabolic wave factored out (Sziklas and Siegman 1975,
    10.1364/AO.14.001874), the spread M = 1 + z1/d and the point's image at x_i on the sensor,
    the field at x in the lens' plane is

        exp(i pi (x - x_o)² / (lambda (d + z1))) W(x / M - z1 x_i / z2) / M,

    where W is the panel's modulation after z1 / M of free space and x_o = -x_i (d + z1) / z2
    the object. This follows from completing the square in s: (s - x_o)²/d + (x - s)²/z1 equals
    (M / z1) (s - c)² + (x - x_o)² / (d + z1), with c = x / M - z1 x_i / z2. M is 1 for an object at
    infinity. After the lens, the phase is that of defocus and aberrations (`pupil_phase`). A
    Fraunhofer integral about the image point leads to the sensor; the tilt of the wave from x_o
    moves the image to that point.

    promised_tol: relative L2 error that the caller was promised, if the request's is stricter.
    kinds: engines of which the cheapest stands in where a dark window needs a stricter one.
    """

    def __init__(
        self,
        request: PSFRequest,
        camera: Camera,
        search: LensGridSearch,
        promised_tol: float | None = None,
        kinds: Sequence[type[ChainEngine]] = (),
    ) -> None:
        self._request, self._camera = request, numeric_camera(camera)
        self._kinds = tuple(kinds) or (type(self),)
        self._promised_tol = promised_tol or request.tol
        self._search, self._edge_scatter = search, search.edge_scatter
        self._stricter_engine: ChainEngine | None = None
        self._plan(request.numeric)
        self._planned_error = self.error

    def prepare(self) -> None:
        """Raise ToleranceError if the plan doesn't keep the tolerance."""
        tol, error = self._request.numeric.tol, self.error.value + self.arithmetic
        if not error <= tol:
            raise unreachable_tolerance_error(tol, error)

    @abstractmethod
    def _plan(self, n: PSFRequest) -> None:
        """Choose the sampling that keeps the tolerance; `n` is the request in plain numbers."""

    def points(self) -> tuple[torch.Tensor, torch.Tensor]:
        return self._camera.panel.plane.mesh()

    def planning_seconds(self, speed: MachineSpeed) -> float:
        return search_seconds(speed)

    def panel_field(
        self, phase: torch.Tensor | None, amplitude: torch.Tensor | None
    ) -> torch.Tensor:
        """Return the field behind the panel, without the point's parabolic wave."""
        factor = self.modulation_factor(phase, amplitude, self._camera.panel.shape, self._dtype)
        if factor is None:
            factor = torch.ones(self._camera.panel.shape, dtype=self._dtype)
        sphere = self._request.sphere
        if sphere is None:
            return factor
        return factor * sphere.wave_factor(*self.points()).to(factor)

    def _sloped_parts(
        self, field: torch.Tensor, axes: Sequence[PropagatorAxis]
    ) -> Iterator[tuple[list[PropagatorAxis], torch.Tensor]]:
        """Yield what the spherical wave's slope in each pixel adds to the panel's field, per axis.

        It is the slope of the exact wave less that of its parabola, in cycles per metre. Each part
        comes with the propagator's axes (y, x) for it.
        """
        sphere = self._request.sphere
        if sphere is None:
            return
        slopes = sphere.phase_gradient(*self.points(), self._camera.panel.active_side)
        for axis, slope in enumerate(slopes):
            sloped = [replace(one, has_pixel_slope=k == axis) for k, one in enumerate(axes)]
            yield sloped, field * slope.to(field)

    def _sphere_error(self) -> float:
        """Estimate the error if a sphere's phase less its parabola's counts as linear in a pixel.

        At the pixel's edge, it is half of the square of half the phase change across the pixel. Its
        mean over the pixel is a third of that.
        """
        sphere, panel = self._request.numeric.sphere, self._camera.panel
        if sphere is None:
            return 0.0
        turn = sphere.largest_phase_slope(math.hypot(*panel.shape) * panel.pitch / 2) * panel.pitch
        return turn**2 / 12

    def _propagator_variables(self) -> PropagatorVariables | None:
        """Return the propagator's parameters with derivatives; None if none is wanted."""
        q = self._request
        lengths = (q.wavelength, q.separation, q.distance, q.radius, *q.chief_ray_slopes)
        if not any(map(needs_gradient, lengths)):
            return None
        n = q.numeric
        bend = q.wavelength * q.separation / q.shadow_magnification
        stretch = (q.radius / n.radius) * (n.shadow_magnification / q.shadow_magnification)
        shift = tuple(
            stretch * (was * n.separation) - now * q.separation
            for was, now in zip(n.chief_ray_slopes, q.chief_ray_slopes, strict=True)
        )
        one = torch.ones((), dtype=torch.float64)
        return PropagatorVariables(bend * one, stretch * one, (shift[0] * one, shift[1] * one))

    def intensity_scale(self) -> Scalar:
        """Return the factor from ``|sum over lens samples|²``, in stop radii, to PSF values."""
        q, panel = self._request, self._camera.panel
        # As if panel and stop stood in one plane.
        pixel_area = open_area(replace(self._camera, lens=q.lens)) * panel.fill_factor
        area = q.samples.pitch[0] * q.samples.pitch[1]
        return area * q.radius**4 / (q.scale**2 * q.shadow_magnification**2 * pixel_area)

    @property
    def _passing_error_share(self) -> float:
        """The share of the squared error that comes from light in the passing band."""
        return 0.0

    @abstractmethod
    def _light(
        self, field: torch.Tensor, amplitude: torch.Tensor | None, added: AddedLight | None
    ) -> ChainLight:
        """Compute the light on the samples from the field behind the panel."""

    def intensity(
        self,
        phase: torch.Tensor | None,
        amplitude: torch.Tensor | None,
        added: AddedLight | None = None,
    ) -> torch.Tensor:
        """Compute the share of the light on every sample, (..., rows, columns).

        The error that is told is that together with other light that is `added` afterwards.
        """
        field = self.panel_field(phase, amplitude)
        if not field.numel():
            # FFTs don't accept an empty batch.
            light = field.real.sum(dim=(-2, -1))[..., None, None]
            return light.expand(*field.shape[:-2], *self._request.samples.shape)
        found = self._light(field, amplitude, added)
        return self._light_or_replan(found, phase, amplitude, added)

    def _light_or_replan(
        self,
        found: ChainLight,
        phase: torch.Tensor | None,
        amplitude: torch.Tensor | None,
        added: AddedLight | None,
    ) -> torch.Tensor:
        """Return light that this engine has computed, or a stricter one's if the window is dark."""
        light, window = found.light, self._request.window_slices
        if found.is_judged:
            return light
        measure = found.passing_brightness or (
            lambda: self._edge_scatter.passing_brightness(self.panel_field(phase, amplitude))
        )
        ratio = LowLightCorrection(
            self._edge_scatter, window, light, amplitude, measure
        ).error_divisor(self._passing_error_share)
        own = (self._planned_error.value + self.arithmetic) / ratio + found.rounding
        norm = window_norm(light.detach(), window)
        how = "estimate for the light in the window"
        error = self.tell_error(own, norm, added, self.arithmetic, how)
        self._stand_in = None
        if error <= self._promised_tol:
            return light
        tol = 0.7 * ratio * allowed_own_error(self._promised_tol, norm, added)
        if self._stricter_engine is None or self._stricter_engine._planned_error.value > tol:
            self._stricter_engine = self._plan_stricter_engine(tol)
        self._stand_in = self._stricter_engine
        return self._stand_in.intensity(phase, amplitude, added)

    def _plan_stricter_engine(self, tol: float) -> ChainEngine:
        """Plan the cheapest engine for a smaller tol, which a dark window needs."""
        promised = self._promised_tol
        if tol < 0.9 * self._request.tol:
            request = replace(self._request, tol=tol)
            makers = [
                partial(kind, request, self._camera, self._search, promised, self._kinds)
                for kind in self._kinds
            ]
            choice = MethodChoice(makers, request.budget, "a PSF")
            for engine in choice.prepared_candidates():
                return engine
        reason = (
            f"tol {promised:g} can't be kept: the window gets so little of the light that what the "
            "stop's edge scatters there counts"
        )
        # What this engine was planned for is kept in brighter windows, in proportion.
        floor = _DIM_MARGIN * self._request.tol / tol * promised
        if not floor < 1:
            raise ToleranceError(reason)
        refusal = ToleranceError(reason, f"ask for tol {rounded_up(floor)} or more")
        refusal.floor = floor
        raise refusal
