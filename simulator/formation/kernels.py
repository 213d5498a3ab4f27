"""PSFs of points by wavelength, distance and place in the field, averaged over an exposure."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray

from optics.accuracy import Budget, ToleranceError
from optics.caching import ByteCache
from optics.camera import Camera
from optics.camera.field_aberrations import add_aberrations
from optics.camera.pupil import share_through_stop
from optics.plane import Plane
from optics.psf import PSFOperator, modulated_psf
from optics.slm import Modulator
from optics.slm.dynamics import first_start_phase, relaxed_phase
from optics.slm.modulator import front_reflection_share
from optics.validation import as_number
from simulator.focus import defocused
from simulator.formation.rays import RayOperator
from simulator.formation.windows import ORDER_FADE_PIXELS, Windows, psf_operations, ray_operations
from simulator.ledger import Ledger
from simulator.panel_at_wavelength import modulator_at
from simulator.panel_content import FrameSequence, PanelState, Span
from simulator.recipe import Recipe
from simulator.situation import Situation

Pictures = Mapping[str, NDArray[np.uint8]]
WeightedFields = Iterator[tuple[float, torch.Tensor]]
"""Shares of an exposure and fields on the panel's pixels; the mean PSF is the weighted sum of the
fields' PSFs."""


def exposure_fields(
    modulator: Modulator, panel_state: PanelState, pictures: Pictures, tol: float
) -> WeightedFields:
    """Yield the panel's fields during an exposure, with each field's share of it.

    Each field is computed when it is asked for. tol: relative error of averages over time.
    """
    if isinstance(panel_state, FrameSequence):
        yield from _moving(modulator, panel_state, pictures, tol)
        return
    for name, share in panel_state.shares:
        if share > 0:
            grey = torch.from_numpy(pictures[name].copy())
            fields = modulator.iterate_still_fields(grey, tol=tol)
            yield from ((share * weight, field) for weight, field in fields)


def _moving(
    modulator: Modulator, seen: FrameSequence, pictures: Pictures, tol: float
) -> WeightedFields:
    """Yield the fields of a repeated video while the liquid crystal responds.

    A span within a frame is treated as a shorter frame, which begins with the phase that the
    crystal has reached by then.
    """

    def settled_phase(name: str) -> torch.Tensor:
        return torch.as_tensor(modulator.phase(torch.from_numpy(pictures[name].copy())))

    tau, frame_time = modulator.panel.response_time, seen.frame_time
    # After 36 time constants a frame has no effect on the phase in double precision (e^-36).
    recent = seen.names[-max(1, math.ceil(36.0 * tau / frame_time)) :]
    before = torch.stack([settled_phase(name) for name in recent])
    start = first_start_phase(before, frame_time, tau)
    spans: defaultdict[int, list[Span]] = defaultdict(list)
    for span in seen.spans:
        spans[span.frame].append(span)
    for frame, name in enumerate(seen.names):
        end = settled_phase(name)
        for span in spans[frame]:
            begun, seconds = relaxed_phase(end, start, span.begin, tau), span.end - span.begin
            fields = modulator.transition_fields(begun, end, seconds, dtype=torch.float32, tol=tol)
            yield from ((span.share * share, field) for share, field in fields)
        start = relaxed_phase(end, start, frame_time, tau)


Order = tuple[int, int]
"""Number (y, x) of a diffraction order of the panel's pixel grid, in the panel's axes."""

# One PSF of a picture may take longer than a question that stands alone: who predicts a picture
# sees its progress and can cancel it. Chosen.
_BUDGET = Budget(seconds=600.0)


@dataclass(frozen=True)
class PointSource:
    """A point whose PSF is computed: its wavelength and its distance from the panel in metres.

    place: (y, x) metres on the sensor from the axis to its geometric image.
    """

    wavelength: float
    distance: float
    place: tuple[float, float] = (0.0, 0.0)


class Kernels:
    """Compute the PSFs of a recipe; each is computed once while the cache holds it.

    A PSF is (rows, columns) of samples around the point's geometric image, or a diffraction order
    of it, each a share of the point's light. Vignetting is applied elsewhere: off the axis there is
    as much light.
    """

    def __init__(
        self,
        s: Situation,
        recipe: Recipe,
        windows: Windows,
        cache: ByteCache,
        ledger: Ledger,
        check: Callable[[], None],
    ) -> None:
        self.s, self.recipe, self.cache, self._ledger = s, recipe, cache, ledger
        self._check, self._merged_orders = check, windows.merged_orders
        self._drift = s.focus_drift if recipe.focus_drift else 0.0
        camera = s.mount.camera_in_panel_axes(replace(s.camera, panel=recipe.panel))
        self.camera: Camera = camera
        sensor, finer = camera.sensor, recipe.samples_per_pixel
        self.plane = sensor.window_plane(windows.psf).with_finer_pitch(finer)
        self._around_orders = sensor.window_plane(windows.side_order).with_finer_pitch(finer)

    @property
    def key(self) -> tuple[object, ...]:
        """Return the cache key with all that PSFs depend on, without point and panel state."""
        r = self.recipe
        beats = self.s.interference if r.interference else 0j
        sides = (self.plane.shape, self._around_orders.shape, self._merged_orders)
        varied = (r.places > 1, r.aberrated_places > 1, r.axial_colour, self._drift)
        axes = (sides, r.samples_per_pixel, r.dispersion, beats, r.diffraction, varied)
        return (self.camera, self.s.mount, self.s.numerics, self.s.wavelength, *axes)

    def camera_at(self, wavelength: float, place: tuple[float, float] = (0.0, 0.0)) -> Camera:
        """Return the camera in the panel's axes for light of a wavelength.

        place: (y, x) metres of the image, for the lens' field aberrations.
        """
        recipe, lens = self.recipe, self.s.camera.lens
        shift = lens.focus_shift(wavelength) if recipe.axial_colour else 0.0
        shift += self._drift
        bent = lens.field_aberrations if recipe.aberrated_places > 1 else None
        if not shift and bent is None:
            return self.camera
        camera = replace(self.s.camera, panel=recipe.panel)
        if bent is not None:
            aberrations = add_aberrations(lens.aberrations, bent.at(*place))
            camera = replace(camera, lens=replace(lens, aberrations=aberrations))
        return self.s.mount.camera_in_panel_axes(defocused(camera, shift) if shift else camera)

    def psf(
        self, panel_state: PanelState, point: PointSource, effect: str, order: Order | None = None
    ) -> torch.Tensor:
        """Return a point's PSF, from the cache or computed.

        effect: to which the ledger ascribes the work. order: the diffraction order whose cell alone
        is returned, for the zeroth with those merged with it; if None, all light in the window.
        """
        causes = ("psf", self.key, panel_state, point, order)
        return self.cache.get(causes, lambda: self._compute_psf(panel_state, point, effect, order))

    def fields(
        self, panel_state: PanelState, wavelength: float
    ) -> tuple[Modulator, Iterable[tuple[float, torch.Tensor]]]:
        """Return the modulator at a wavelength, and an exposure cell's fields with their shares.

        The fields are kept if they are needed again, at other depths, places or wavelengths.
        """
        r, s, panel = self.recipe, self.s, self.camera.panel
        pictures, tol = s.panel_content.pictures, s.numerics
        own = acting = modulator_at(panel, wavelength)
        if not r.dispersion:
            acting = modulator_at(panel, s.wavelength)
        elif r.depths == r.places == r.aberrated_places == 1 and not r.orders:
            return own, exposure_fields(own, panel_state, pictures, tol)
        causes = ("fields", panel, acting.wavelength, panel_state, tol)
        return own, self.cache.get(
            causes, lambda: list(exposure_fields(acting, panel_state, pictures, tol))
        )

    def central(self, wavelength: float) -> Order | None:
        """Return the zeroth order if a PSF's window reaches beyond its orders, else None."""
        period, side = self.period(wavelength), max(self.plane.shape) * self.plane.pitch[0]
        wide = side > (2 * self._merged_orders + 1) * period - self._fading(period)
        return (0, 0) if wide and self.recipe.diffraction else None

    def _fading(self, period: float) -> float:
        """Return the metres over which one diffraction order fades into the next."""
        return min(ORDER_FADE_PIXELS * self.camera.sensor.pitch, period / 4)

    def period(self, wavelength: float) -> float:
        """Return the metres on the sensor between the panel's orders."""
        return wavelength * as_number(self.camera.ray_matrix_b) / self.camera.panel.pitch

    def order_centre(self, wavelength: float, order: Order) -> tuple[float, float]:
        """Return (y, x) metres on the sensor from a point's image to one of its orders."""
        return self.s.mount.places_on_sensor(*self._order_offset(wavelength, order))

    def _order_offset(self, wavelength: float, order: Order) -> tuple[float, float]:
        """Return an order's offset in the panel's axes, rounded to whole samples.

        The samples of neighbouring orders then coincide where they meet.
        """
        y, x = (
            round(k * self.period(wavelength) / pitch) * pitch
            for k, pitch in zip(order, self.plane.pitch, strict=True)
        )
        return y, x

    def _compute_psf(
        self, panel_state: PanelState, point: PointSource, effect: str, order: Order | None
    ) -> torch.Tensor:
        """Compute a point's PSF in the sensor's axes."""
        mount, window = self.s.mount, self._window(order)
        modulator, fields = self.fields(panel_state, point.wavelength)
        parts = self._record_fields(fields, effect, window.shape)
        if order and any(order):
            light = self._side_order_light(point, order, modulator, parts)
        else:
            light = self._light(self._operator(point, (0, 0)), modulator, parts)
        if order is not None:
            for share in self._cell_shares(point, order):
                light = light * share.to(light)
        correction = self._vignetting_correction(point)
        if correction != 1:
            light = light * correction
        if not mount.is_aligned:
            light = mount.to_sensor_axes(light, window)
        return light

    def _light(
        self, operator: PSFOperator | RayOperator, modulator: Modulator, parts: WeightedFields
    ) -> torch.Tensor:
        """Return the PSF of the panel's fields, by waves or rays as the recipe says."""
        if isinstance(operator, RayOperator):
            return _ray_psf(operator, modulator, parts)
        if not self.recipe.interference:
            return modulated_psf(operator, modulator, parts)
        return _interference_psf(operator, modulator, parts, self.s.interference)

    def _side_order_light(
        self, point: PointSource, order: Order, modulator: Modulator, parts: WeightedFields
    ) -> torch.Tensor:
        """Return the PSF of a side order.

        Where hardly any light goes, the error may be a large share of it. The tolerance is
        therefore relaxed, up to .1: such an order hardly counts in the picture.
        """
        kept, tol = list(parts), self.s.numerics
        while True:
            try:
                return self._light(self._operator(point, order, tol), modulator, iter(kept))
            except ToleranceError:
                tol *= 10
                if tol > 0.1:
                    raise

    def _vignetting_correction(self, point: PointSource) -> float:
        """Return the factor that makes an off-axis PSF as bright as one on the axis."""
        seen = self._shadow_place(point)
        if not (self.camera.separation and any(seen)):
            return 1.0
        here, axis = (
            share_through_stop(self.camera, point.distance, self._in_panel_axes(point, place))
            for place in (seen, (0.0, 0.0))
        )
        return axis / here if here else 0.0

    def _shadow_place(self, point: PointSource) -> tuple[float, float]:
        """Return the place from which a point sees the stop's shadow on the panel.

        It is on the axis if only the lens' aberrations differ over the field.
        """
        return point.place if self.recipe.places > 1 else (0.0, 0.0)

    def _in_panel_axes(self, point: PointSource, place: tuple[float, float]) -> tuple[float, float]:
        """Return a place of the point's image, (y, x) metres, in the panel's axes."""
        return self.s.mount.place_in_panel_axes(place, self.camera, point.distance)

    def _window(self, order: Order | None) -> Plane:
        """Return the plane of a PSF's window.

        A side order is far from any image: all of its square window counts.
        """
        return self._around_orders if order and any(order) else self.plane

    def _around(self, point: PointSource, order: Order) -> Plane:
        """Return the samples of a PSF around an order, in the panel's axes."""
        plane = self._window(order)
        if not self.s.mount.is_aligned:
            plane = self.s.mount.plane_in_panel_axes(plane)
        return replace(plane, centre=self._order_offset(point.wavelength, order))

    def _operator(
        self, point: PointSource, order: Order, tol: float | None = None
    ) -> PSFOperator | RayOperator:
        """Return the wave or ray operator from the panel's field to a PSF.

        Unmodulated light is left to the modulator.
        """
        tol, mount, plane = tol or self.s.numerics, self.s.mount, self._around(point, order)
        camera = self.camera_at(point.wavelength, point.place)
        if not mount.is_centred:
            # On this plane a centred panel has the light that a shifted one has on the other.
            moved = mount.image_shift_in_panel_axes(camera, point.distance)
            y, x = (one - away for one, away in zip(plane.centre, moved, strict=True))
            plane = replace(plane, centre=(y, x))
        place = self._in_panel_axes(point, self._shadow_place(point))
        given = camera, point.distance, point.wavelength, plane
        if not self.recipe.diffraction:
            return RayOperator(*given, place)
        return self.cache.get(
            ("operator", camera, tol, point, plane),
            lambda: PSFOperator(
                *given, field=place, integrate=False, unmodulated=0.0, tol=tol, budget=_BUDGET
            ),
        )

    def _record_fields(
        self, fields: Iterable[tuple[float, torch.Tensor]], effect: str, shape: tuple[int, int]
    ) -> WeightedFields:
        """Yield the panel's fields, each with a ledger entry and a check.

        The caller computes a PSF from each field before it asks for the next.
        """
        count = psf_operations if self.recipe.diffraction else ray_operations
        self._check()
        for part in fields:
            self._ledger.add(effect, count(self.camera.panel, *shape), 4 * math.prod(shape))
            yield part
            self._check()

    def _cell_shares(self, point: PointSource, order: Order) -> list[torch.Tensor]:
        """Return the share of each sample's light that belongs to a diffraction order.

        It is the product of a column along y and a row along x, in the panel's axes; those of all
        orders add up to 1. Where two orders meet, one fades out as the other fades in: a PSF that
        ended abruptly would cause ringing.
        """
        period, shares = self.period(point.wavelength), []
        for at, k in zip(self._around(point, order).mesh(), order, strict=True):
            depth = (self._merged_orders + 0.5) * period - (at - k * period).abs()
            ramp = (depth / self._fading(period) + 0.5).clamp(0, 1)
            shares.append(torch.sin(math.pi / 2 * ramp) ** 2)
        return shares


def _ray_psf(operator: RayOperator, modulator: Modulator, parts: WeightedFields) -> torch.Tensor:
    """Return a point's geometric PSF from the panel's fields, as modulated_psf() does for waves.

    The light that jitter scatters goes evenly to all orders, beyond the picture.
    """
    light, time = torch.zeros(operator.pixels.shape, dtype=torch.float64), 0.0
    for share, field in parts:
        light += share * (1 - modulator.jitter_scatter_share) * operator(None, field)
        time += share
    light = (1 - modulator.unmodulated_share) * light
    for share, straight in modulator.unmodulated_fields:
        light += time * share * operator.straight(straight)
    return light


def _interference_psf(
    operator: PSFOperator, modulator: Modulator, parts: WeightedFields, strength: complex
) -> torch.Tensor:
    """Return the PSF of modulated_psf(), plus the interference with unmodulated light.

    It is Re(strength conj(p) q), of the pattern's field p and the field q of light that the panel
    doesn't modulate (see optics.polarisation.PathEffect). The sensor's field is linear in the
    panel's: |p + a q|² contains the term. Light that the cover glass reflects is too far away to
    interfere, and light that jitter scatters has no fixed phase.
    """
    kept = list(parts)
    light = modulated_psf(operator, modulator, kept)
    coherent = (1 - front_reflection_share(modulator.panel)) * math.sqrt(
        1 - modulator.jitter_scatter_share
    )
    amount = abs(strength) * coherent
    if not amount:
        return light
    turn = strength / abs(strength)
    still = modulator.unmodulated_fields[-1][1] if modulator.unmodulated_fields else None
    for share, field in kept:
        other = torch.ones_like(field) if still is None else still.to(field)
        both = operator(None, field + turn * other)
        term = (
            both
            - operator(None, field)
            - operator.unmodulated_psf(still, cache_result=True).to(both)
        )
        light = light + share * amount / 2 * term
    return light
