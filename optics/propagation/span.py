"""What is asked of free space: a field on one plane, wanted on another."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, TypedDict, cast

from optics.accuracy import Budget
from optics.plane import Plane
from optics.validation import as_number, needs_gradient, require_positive, to_plain_numbers

Scalar = Any
"""A number or a 0-d tensor in which the answer is differentiable."""


class SpanSettings(TypedDict, total=False):
    """What may be said of a span besides its planes and lengths."""

    cells: tuple[float, float] | None
    carrier: tuple[float, float]
    band: tuple[float, float] | None
    tilt: tuple[float, float]
    paraxial: bool


@dataclass(frozen=True)
class FreeSpaceSpan:
    """A stretch of free space, the field that enters it, and where it is wanted.

    source, target: planes across the axis; any two shapes, pitches and centres. distance:
    metres from source to target; negative goes back. wavelength: metres.

    cells: what a sample stands for. None: a smooth field, band-limited, that the samples
    resolve and that has died away at the source's edges. (y, x): a rectangle of such sides
    with a constant field, as an SLM's pixel.
    carrier, band: cycles per metre along (y, x); a smooth field's fringes lie from
    carrier - band to carrier + band, half of what the samples resolve if band is None.
    (Samples with a carrier beyond their Nyquist rate are bandpass samples, and serve.)

    tilt: radians (a, b) by which the target is turned about its own centre: first by a about
    the x axis, from y towards z, then by b about the y axis, from z towards x. A sample that
    lies (y, x) from the target's centre in the target's own plane then stands at the place

        centre_y + y cos a,
        centre_x + x cos b + y sin a sin b,
        distance - x sin b + y sin a cos b

    along (y, x, z), and the field there is that of the wave with exp(i k distance) left out.

    paraxial: the declared model: Fresnel's (thesis Eq. 2.12) or, if False, Rayleigh and
    Sommerfeld's first integral of a scalar wave (Goodman 3.5). tol: relative L2 error of the
    complex field on the target, from sampling and arithmetic. The factor exp(i k distance),
    which is the same everywhere, is left out in both models.

    distance, wavelength and the target's centre may be 0-d tensors.
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
    budget: Budget = field(default_factory=Budget)

    def __post_init__(self) -> None:
        distance = as_number(self.distance)
        if not (math.isfinite(distance) and distance):
            raise ValueError(
                f"distance is {distance:g} m; the target must lie before or behind the source, "
                "at a finite distance"
            )
        require_positive("wavelength", self.wavelength, "m")
        for name, pair in (("carrier", self.carrier), ("tilt", self.tilt)):
            if not all(math.isfinite(value) for value in pair):
                raise ValueError(f"{name} is {pair}; give two finite numbers")
        if not all(abs(angle) < math.pi / 2 for angle in self.tilt):
            raise ValueError(
                f"tilt is {self.tilt} rad; the target must face the source, by less than pi / 2"
            )
        self._require_resolved()

    def _require_resolved(self) -> None:
        """Raise ValueError for cells or a band that don't fit the samples."""
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
        """The field's fringes to either side of its carrier, cycles per metre; infinite for
        cells, whose edges are sharp."""
        if self.cells is not None:
            return (math.inf, math.inf)
        if self.band is not None:
            return self.band
        y, x = self.source.pitch
        return (0.25 / y, 0.25 / x)

    @property
    def sample_area(self) -> float:
        """Square metres that a sample stands for."""
        y, x = self.source.pitch if self.cells is None else self.cells
        return y * x

    @cached_property
    def numeric(self) -> FreeSpaceSpan:
        """The same in plain numbers."""
        return cast(FreeSpaceSpan, to_plain_numbers(self))

    @property
    def scale(self) -> Scalar:
        """Wavelength times distance, square metres, with the distance's sign."""
        return self.wavelength * self.distance

    def source_extent(self, axis: int) -> tuple[float, float]:
        """Where the source's light begins and ends along axis 0 (y) or 1 (x), metres."""
        plane = self.numeric.source
        n, pitch = plane.shape[axis], plane.pitch[axis]
        half = (pitch if self.cells is None else self.cells[axis]) / 2
        first = plane.centre[axis] - (n // 2) * pitch
        return first - half, first + (n - 1) * pitch + half

    @cached_property
    def target_corners(self) -> tuple[tuple[float, float, float], ...]:
        """Of the target: (y, x, z) of its outermost samples, metres; z is from the source."""
        n = self.numeric
        (ny, nx), (py, px) = n.target.shape, n.target.pitch
        ends_y = (-(ny // 2) * py, (ny - 1 - ny // 2) * py)
        ends_x = (-(nx // 2) * px, (nx - 1 - nx // 2) * px)
        return tuple(n.target_position(y, x) for y in ends_y for x in ends_x)

    def require_target_in_front(self) -> float:
        """The least distance of a target's sample from the source's plane, metres.

        Raises ValueError where a tilt brings some through it.
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
        """Where the points (y, x) of the target's own plane, metres from its centre, lie:
        (y, x, z), the turned place."""
        a, b = self.tilt
        across = x * math.cos(b) + y * (math.sin(a) * math.sin(b))
        depth = y * (math.sin(a) * math.cos(b)) - x * math.sin(b)
        centre = self.target.centre
        return centre[0] + y * math.cos(a), centre[1] + across, self.distance + depth

    def lateral_range(self, axis: int) -> tuple[float, float]:
        """The least and the largest lateral way, metres, from any of the source's light to any
        of the target's samples along axis 0 (y) or 1 (x), wherever a tilt brings them."""
        first, last = self.source_extent(axis)
        places = [corner[axis] for corner in self.target_corners]
        return min(places) - last, max(places) - first

    @property
    def differentiable(self) -> bool:
        """Whether a derivative in a length is wanted."""
        return any(map(needs_gradient, self._scalars))

    @cached_property
    def has_tensor_lengths(self) -> bool:
        """Whether a length is more than a number: a tensor's value may change under a plan."""
        return not all(isinstance(one, (int, float)) for one in self._scalars)

    @property
    def _scalars(self) -> tuple[Scalar, ...]:
        return (self.distance, self.wavelength, *self.target.centre)
