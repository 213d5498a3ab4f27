"""Compute the fields that single pixels of a chain's panel send to places in its stop."""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch

from optics.camera import Camera
from optics.chain.far_fields import FAR_ZONES, far_fields
from optics.chain.panel_to_lens import TaperedBand
from optics.chain.propagator_axes import fresnel_area
from optics.chain.split_phase import SplitPhase
from optics.propagation.fresnel_integral import cell_kernel
from optics.psf_engines.request import PSFRequest


class PixelFields:
    """Computes the field of a chain's panel pixels in the stop, a product of factors in y and x.

    The factors are Fresnel integrals in closed form (see `cell_kernel`). Places in the stop are in
    stop radii.

    n, camera: what is asked, in plain numbers. reach: bands (y, x) of frequencies whose light is
    followed, and which say how far a pixel's light goes sideways; None for all light.
    """

    def __init__(
        self, n: PSFRequest, camera: Camera, reach: Sequence[TaperedBand] | None = None
    ) -> None:
        self._n, self._panel, self._reach = n, camera.panel, reach
        self._area = fresnel_area(n)
        self._tensor_area = torch.tensor(self._area, dtype=torch.float64)
        self._grow = n.radius / float(n.shadow_magnification)
        self._shifts = [float(slope) * n.separation for slope in n.chief_ray_slopes]
        self._lines = [camera.panel.plane.coordinates(axis) for axis in (0, 1)]

    def fields(self, axis: int, place: torch.Tensor, pixels: slice = slice(None)) -> torch.Tensor:
        """Return what a chain's pixels send to places along an axis, (places, pixels)."""
        arriving = place * self._grow - self._shifts[axis]
        line, side = self._lines[axis][pixels], self._panel.active_side
        near = self._pixels_within(line, arriving, self._near_distance)
        far = [
            torch.from_numpy(far_fields(arriving.numpy(), part.numpy(), side, self._area))
            for part in (line[: near.start], line[near.stop :])
        ]
        within = cell_kernel(arriving[:, None] - line[near], side, self._tensor_area)
        field = torch.cat([far[0], within, far[1]], dim=1)
        return self._tapered(axis, field, arriving, line)

    @property
    def _near_distance(self) -> float:
        """Metres between a chain's pixel and a place within which its field is no far field."""
        return FAR_ZONES * math.sqrt(self._area) + self._panel.active_side

    @staticmethod
    def _pixels_within(line: torch.Tensor, arriving: torch.Tensor, distance: float) -> slice:
        """Return the pixels of a line that lie within a distance of any of a chain's places."""
        first = int(torch.searchsorted(line, float(arriving.min()) - distance))
        return slice(first, int(torch.searchsorted(line, float(arriving.max()) + distance)))

    def _tapered(
        self, axis: int, field: torch.Tensor, arriving: torch.Tensor, line: torch.Tensor
    ) -> torch.Tensor:
        """Return the chain's field without light that isn't followed, (places, pixels)."""
        if self._reach is None:
            return field
        band = self._reach[axis]
        room = band.taper_sigma * band.taper_sigmas
        low, high = (band.low + room) * self._area, (band.high - room) * self._area
        # Light of these pixels is followed to all places.
        first = int(torch.searchsorted(line, float(arriving.max()) - high))
        last = int(torch.searchsorted(line, float(arriving.min()) - low))
        parts = [slice(0, first), slice(max(first, last), len(line))]
        for part in parts:
            offset = arriving[:, None] - line[part]
            field[:, part] *= band.taper(offset / self._area)
        return field

    def path_turns(self, axis: int, place: torch.Tensor) -> torch.Tensor:
        """Return the phases of paths from a chain's pixels to places, in turns."""
        arriving = place * self._grow - self._shifts[axis]
        return (arriving[:, None] - self._lines[axis]) ** 2 / (2 * self._area)

    def reached(self, axis: int, place: torch.Tensor) -> slice:
        """Return the pixels of a chain's panel whose light gets to any of the places."""
        low, high = self._farthest(axis)
        arriving = place * self._grow - self._shifts[axis]
        line = self._lines[axis]
        first = int(torch.searchsorted(line, float(arriving.min()) - high))
        return slice(first, max(first, int(torch.searchsorted(line, float(arriving.max()) - low))))

    def reached_count(self, axis: int, width: float) -> float:
        """Count the chain's pixels whose light gets to places within a width, about."""
        low, high = self._farthest(axis)
        within = (high - low + width * self._grow) / self._panel.pitch + 1
        return min(float(self._panel.shape[axis]), within)

    def near_count(self, axis: int, width: float) -> float:
        """Count the chain's pixels that lie near to places within a width, about."""
        within = (2 * self._near_distance + width * self._grow) / self._panel.pitch + 1
        return min(within, self.reached_count(axis, width))

    @property
    def near_width(self) -> float:
        """How wide a neighbourhood of a chain's place takes exact fields, in stop radii."""
        return 2 * self._near_distance / self._grow

    def reached_width(self, axis: int) -> float:
        """Return how wide the light of a point of the chain's panel gets, infinite for all."""
        low, high = self._farthest(axis)
        return (high - low) / self._grow

    def _farthest(self, axis: int) -> tuple[float, float]:
        """Return how far a chain's light is followed sideways, down and up an axis, in metres."""
        if self._reach is None:
            return -math.inf, math.inf
        low, high = self._reach[axis].outer_limits
        return low * self._area, high * self._area

    def steepest_slope(self, axis: int, span: tuple[float, float], lens: SplitPhase) -> float:
        """Bound the phase slope of a chain's light in the stop, radians per stop radius.

        Light from a point of the panel, the lens, and the kernel of a sensor sample each add a
        slope that is linear in the places, so that the extremes lie at their ends.

        span: low and high end of the stop's opening.
        """
        n, grow, shift = self._n, self._grow, self._shifts[axis]
        half = self._panel.pitch / 2
        ends = float(self._lines[axis][0]) - half, float(self._lines[axis][-1]) + half
        seen = n.samples.coordinates(axis)
        low, high = self._farthest(axis)
        # At these places, light from an end of the panel has gone as far as it is followed.
        turns = [(end + way + shift) / grow for end in ends for way in (low, high)]
        places = [*span, *(min(max(turn, span[0]), span[1]) for turn in turns)]
        slopes = [
            2 * math.pi * grow * min(max(grow * place - shift - end, low), high) / self._area
            + 2 * lens.curvature * place
            - 2 * math.pi * n.radius * sample / n.scale
            for place in places
            for end in ends
            for sample in (float(seen.min()), float(seen.max()))
        ]
        return max(map(abs, slopes)) + lens.slope
