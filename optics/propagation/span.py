"""Describe a propagation through free space as data: two planes, lengths and the model."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, TypedDict

from optics.accuracy import Budget
from optics.plane import Plane
from optics.validation import (
    as_number,
    needs_gradient,
    require_positive,
    require_size,
    to_plain_numbers,
)

Scalar = Any
"""A number, or a 0-d tensor in which the result is differentiable."""


class SpanSettings(TypedDict, total=False):
    """Optional settings of a FreeSpaceSpan besides its planes and lengths."""

    cells: tuple[float, float] | None
    carrier: tuple[float, float]
    band: tuple[float, float] | None
    tilt: tuple[float, float]
    paraxial: bool


@dataclass(frozen=True)
class FreeSpaceSpan:
    """Describe a propagation through free space: the two planes, the field that enters, the model.

    The factor exp(i k distance), which is the same everywhere, is left out of the field on the
    target, in both models. Distance, wavelength and the target's centre may be 0-d tensors.

    A sample that lies (y, x) from the centre of a tilted target, in the target's own plane, has the
    position along (y, x, z) ::

        centre_y + y cos a,
        centre_x + x cos b + y sin a sin b,
        distance - x sin b + y sin a cos b,

    where (a, b) is the tilt. The field there is that of the wave with exp(i k distance) left out.

    Parameters
    ----------
    source : Plane
        The plane on which the field is known, across the axis. Shape, pitch and centre are free.
    target : Plane
        The plane on which the field is computed, with any other shape, pitch and centre.
    distance : float or 0-d torch.Tensor
        Metres from source to target; a negative distance propagates backward. Not zero.
    wavelength : float or 0-d torch.Tensor
        Metres.
    cells : tuple of float, optional
        What a sample stands for. None, the default, is a smooth field: band-limited, resolved by
        the samples, and died away at the source's edges. (y, x) is a rectangle of these sides in
        metres with a constant field, such as a pixel of an SLM; no wider than the pitch.
    carrier : tuple of float, optional
        Cycles per metre along (y, x). A smooth field's frequencies lie from carrier - band to
        carrier + band. Samples with a carrier beyond their Nyquist frequency are bandpass samples;
        they are allowed.
    band : tuple of float, optional
        Cycles per metre along (y, x); by default half of what the samples resolve.
    tilt : tuple of float, optional
        Radians (a, b) by which the target is turned about its own centre: first by a about the x
        axis, from y towards z, then by b about the y axis, from z towards x. Less than pi / 2.
    paraxial : bool, optional
        Whether the model is Fresnel's (thesis Eq. 2.12) or, by default, the first
        Rayleigh-Sommerfeld integral of a scalar wave (Goodman section 3.5).
    tol : float, optional
        Largest relative L2 error of the complex field on the target, from sampling and arithmetic.
    finest_sampling : float, optional
        Error from sampling that is planned even where `tol` allows more; none by default. It costs
        little, where higher precision would cost much.
    budget : Budget, optional
        The memory allowed, and the machine's speed.

    Raises
    ------
    ValueError
        For lengths or a tilt that aren't possible, and for cells or a band that don't fit the
        samples.

    References
    ----------
    Thesis Eq. 2.12; J. W. Goodman, Introduction to Fourier Optics, section 3.5.
    """

    source: Plane
    target: Plane
    distance: Scalar
    wavelength: Scalar
    cells: tuple[float, float] | None = None
    carrier: tuple[float, float] = (0.0, 0.0)
    band: tuple[float, float] | None = None
    tilt: tuple[float, float] = (0.0, 0.0)
    paraxial: bool = False
    tol: float = 1e-3
    finest_sampling: float = math.inf
    budget: Budget = field(default_factory=Budget)

    def __post_init__(self) -> None:
        distance = as_number(self.distance)
        if not (math.isfinite(distance) and distance):
            raise ValueError(
                f"distance is {distance:g} m; the target must lie before or behind the source, "
                "at a finite distance"
            )
        require_positive("wavelength", self.wavelength, "m")
        # Longer lengths would have products that overflow.
        require_size("travel", "distance", self.distance)
        require_size("travel", "wavelength", self.wavelength)
        for name, plane in (("source", self.source), ("target", self.target)):
            for pitch, place in zip(plane.pitch, plane.centre, strict=True):
                require_size("travel", f"the {name}'s pitch", pitch)
                require_size("place", f"the {name}'s centre", place)
        for name, pair in (("carrier", self.carrier), ("tilt", self.tilt)):
            if not all(math.isfinite(value) for value in pair):
                raise ValueError(f"{name} is {pair}; give two finite numbers")
        if not all(abs(angle) < math.pi / 2 for angle in self.tilt):
            raise ValueError(
                f"tilt is {self.tilt} rad; the target must face the source, by less than pi / 2"
            )
        self._require_resolved()

    def _require_resolved(self) -> None:
        """Raise ValueError if cells or band don't fit the source's samples."""
        for axis, pitch in enumerate(self.source.pitch):
            name = "yx"[axis]
            if self.cells is not None:
                side = self.cells[axis]
                if not 0 < side <= pitch * (1 + 1e-9):
                    raise ValueError(
                        f"cells are {side:g} m wide in {name}; they must be wider than 0 and no "
                        f"wider than the source's pitch, {pitch:g} m"
                    )
                continue
            band = self.half_bandwidths[axis]
            if not 0 < band <= 0.5 / pitch * (1 + 1e-9):
                raise ValueError(
                    f"band is {band:g} cycles/m in {name}; it must be positive, and samples "
                    f"{pitch:g} m apart resolve {0.5 / pitch:.4g} at most: sample finer"
                )

    @property
    def half_bandwidths(self) -> tuple[float, float]:
        """Bandwidths (y, x) beside the carrier, cycles/m; infinite for sharp-edged cells."""
        if self.cells is not None:
            return (math.inf, math.inf)
        if self.band is not None:
            return self.band
        y, x = self.source.pitch
        return (0.25 / y, 0.25 / x)

    def field_band(self, axis: int) -> tuple[float, float]:
        """Return the least and largest frequency of the field along axis 0 (y) or 1 (x)."""
        carrier, half = self.carrier[axis], self.half_bandwidths[axis]
        return carrier - half, carrier + half

    @property
    def sampling_tol(self) -> float:
        """The tolerance of which the sampling uses its shares."""
        return min(self.tol, self.finest_sampling)

    @property
    def sample_area(self) -> float:
        """The area in m² that a sample of the source represents."""
        y, x = self.source.pitch if self.cells is None else self.cells
        return y * x

    @cached_property
    def numeric(self) -> FreeSpaceSpan:
        """The same span with plain numbers instead of tensors."""
        numeric: FreeSpaceSpan = to_plain_numbers(self)
        return numeric

    @property
    def scale(self) -> Scalar:
        """Wavelength times distance in m², with the distance's sign."""
        return self.wavelength * self.distance

    def source_extent(self, axis: int) -> tuple[float, float]:
        """Compute where the source's light begins and ends along axis 0 (y) or 1 (x), in metres."""
        plane = self.numeric.source
        n, pitch = plane.shape[axis], plane.pitch[axis]
        half = (pitch if self.cells is None else self.cells[axis]) / 2
        first = plane.centre[axis] - (n // 2) * pitch
        return first - half, first + (n - 1) * pitch + half

    @cached_property
    def target_corners(self) -> tuple[tuple[float, float, float], ...]:
        """The positions (y, x, z) of the target's corner samples, in metres.

        y and x count from the axis, z counts from the source's plane.
        """
        n = self.numeric
        (ny, nx), (py, px) = n.target.shape, n.target.pitch
        ends_y = (-(ny // 2) * py, (ny - 1 - ny // 2) * py)
        ends_x = (-(nx // 2) * px, (nx - 1 - nx // 2) * px)
        return tuple(n.target_position(y, x) for y in ends_y for x in ends_x)

    def nearest_target_distance(self) -> float:
        """Compute the least distance along the axis from the source's plane to a target sample.

        It is in metres, and positive for backward propagation too. Raises ValueError where a tilt
        brings some samples through the source's plane.
        """
        n = self.numeric
        nearest = min(z * math.copysign(1.0, n.distance) for _, _, z in n.target_corners)
        if not nearest > 0:
            raise ValueError(
                f"tilt is {n.tilt} rad; it turns the target through the source's plane, "
                f"{n.distance:g} m away, to {-nearest:g} m on the other side: tilt it less, or "
                "move it away"
            )
        return nearest

    def target_position(self, y: Any, x: Any) -> tuple[Any, Any, Any]:
        """Compute the positions (y, x, z) of points in the target, metres; z is from the source.

        y, x: metres from the target's centre, in the target's own, tilted plane.
        """
        a, b = self.tilt
        across = x * math.cos(b) + y * (math.sin(a) * math.sin(b))
        depth = y * (math.sin(a) * math.cos(b)) - x * math.sin(b)
        centre = self.target.centre
        return centre[0] + y * math.cos(a), centre[1] + across, self.distance + depth

    def lateral_range(self, axis: int) -> tuple[float, float]:
        """Compute the least and largest lateral displacement along axis 0 (y) or 1 (x), in metres.

        The displacement is from any point of the source's light to any sample of the target. The
        target's tilt counts.
        """
        first, last = self.source_extent(axis)
        places = [corner[axis] for corner in self.target_corners]
        return min(places) - last, max(places) - first

    @property
    def differentiable(self) -> bool:
        """Whether a derivative is wanted in any length."""
        return any(map(needs_gradient, (self.distance, self.wavelength, *self.target.centre)))

    @cached_property
    def has_tensor_lengths(self) -> bool:
        """Whether a length is a tensor, whose value may change after planning."""
        lengths = (self.distance, self.wavelength, *self.target.centre)
        return not all(isinstance(one, (int, float)) for one in lengths)
