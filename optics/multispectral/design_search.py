"""Families of coded PSFs, and the search for those whose bands are restored best."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import torch

from optics.plane import Plane
from optics.progress import Progress
from optics.targets import dots, linear_dispersion, ring, spiral
from optics.threads import single_threaded
from optics.validation import require_count, require_positive, require_share, require_wavelength

Position = tuple[float, float]  # (y, x) of a dot in metres
_WIDTH = 0.6  # standard deviation of a stroke or a dot in pixels: about as sharp as they allow


def ring_psfs(
    plane: Plane,
    wavelengths: Sequence[float],
    radius: float,
    *,
    count: int = 1,
    width: float | None = None,
    unmodulated: float = 0.0,
) -> torch.Tensor:
    """Draw PSFs of concentric rings, whose radii grow with the wavelength (thesis Fig. 4.3).

    The rings are evenly spaced and equally bright along their circumference.

    Parameters
    ----------
    plane, wavelengths : Plane, sequence of float
        Pixels of the sensor around the axis, and the wavelength of each band in metres.
    radius, count : float, int
        Radius of the largest ring at the longest wavelength, metres; number of rings.
    width : float, optional
        Standard deviation across a ring, metres; 0.6 pixels if None.
    unmodulated : float, default 0.0
        Share of the light that stays on the axis, 0 to 1.

    Returns
    -------
    torch.Tensor, (bands, rows, columns), float64
        The PSFs, each with a sum of 1.

    Raises
    ------
    ValueError
        If a size isn't possible, or the largest ring doesn't fit on the plane.
    """
    require_count("count", count)

    def draw(scale: float, sharp: float) -> torch.Tensor:
        shares = [(k + 1) / count for k in range(count)]
        rings = [share * ring(plane, scale * share * radius, sharp) for share in shares]
        return torch.stack(rings).sum(0) / sum(shares)

    return _draw_bands(draw, plane, wavelengths, width, unmodulated)


def spiral_psfs(
    plane: Plane,
    wavelengths: Sequence[float],
    radius: float,
    *,
    turns: float = 3.0,
    width: float | None = None,
    unmodulated: float = 0.0,
) -> torch.Tensor:
    """Draw PSFs of a spiral, whose size grows with the wavelength.

    Parameters
    ----------
    plane, wavelengths, width, unmodulated
        As of `ring_psfs`.
    radius, turns : float
        Largest distance from the axis at the longest wavelength, metres; number of turns, from the
        axis outwards.

    Returns
    -------
    torch.Tensor, (bands, rows, columns), float64
        The PSFs, each with a sum of 1.

    Raises
    ------
    ValueError
        If a size isn't possible, or the spiral doesn't fit on the plane.
    """

    def draw(scale: float, sharp: float) -> torch.Tensor:
        return spiral(plane, scale * radius, sharp, turns)

    return _draw_bands(draw, plane, wavelengths, width, unmodulated)


def dot_psfs(
    plane: Plane,
    wavelengths: Sequence[float],
    positions: Sequence[Position],
    *,
    width: float | None = None,
    unmodulated: float = 0.0,
) -> torch.Tensor:
    """Draw PSFs of equal dots, whose distances from the axis grow with the wavelength.

    Parameters
    ----------
    plane, wavelengths, width, unmodulated
        As of `ring_psfs`.
    positions : sequence of tuple of float
        (y, x) of each dot at the longest wavelength, metres.

    Returns
    -------
    torch.Tensor, (bands, rows, columns), float64
        The PSFs, each with a sum of 1.

    Raises
    ------
    ValueError
        If there is no dot, or one doesn't fit on the plane.
    """

    def draw(scale: float, sharp: float) -> torch.Tensor:
        return dots(plane, [(scale * y, scale * x) for y, x in positions], sharp)

    return _draw_bands(draw, plane, wavelengths, width, unmodulated)


def linear_dispersion_psfs(
    plane: Plane,
    wavelengths: Sequence[float],
    radius: float,
    *,
    direction: float = 0.0,
    width: float | None = None,
    unmodulated: float = 0.0,
) -> torch.Tensor:
    """Draw PSFs of a prism: a dot that moves along a line through the axis (thesis Fig. 4.11).

    Parameters
    ----------
    plane, wavelengths, width, unmodulated
        As of `ring_psfs`; two wavelengths that differ, or more.
    radius : float
        Distance from the axis of the shortest and of the longest wavelength, metres.
    direction : float, default 0.0
        Angle in radians from x towards y, towards which longer waves move.

    Returns
    -------
    torch.Tensor, (bands, rows, columns), float64
        The PSFs, each with a sum of 1.

    Raises
    ------
    ValueError
        If all wavelengths are equal, or the line doesn't fit on the plane.
    """
    require_positive("radius", radius, "m")
    _require_wavelengths(wavelengths)
    shortest, longest = min(wavelengths), max(wavelengths)
    if not longest > shortest:
        raise ValueError(f"wavelengths are all {longest:g} m; a prism needs two that differ")
    pictures = linear_dispersion(
        plane,
        [float(one) for one in wavelengths],
        (shortest + longest) / 2,
        2 * radius / (longest - shortest),
        _stroke_width(plane, width),
        direction,
    )
    return _add_unmodulated(pictures, unmodulated)


def _draw_bands(
    draw: Callable[[float, float], torch.Tensor],
    plane: Plane,
    wavelengths: Sequence[float],
    width: float | None,
    unmodulated: float,
) -> torch.Tensor:
    """Draw a shape for each band, scaled by its wavelength relative to the longest."""
    sharp = _stroke_width(plane, width)
    _require_wavelengths(wavelengths)
    longest = max(wavelengths)
    pictures = [draw(float(one) / float(longest), sharp) for one in wavelengths]
    return _add_unmodulated(torch.stack(pictures), unmodulated)


def _add_unmodulated(pictures: torch.Tensor, unmodulated: float) -> torch.Tensor:
    """Move a share of each PSF's light to the pixel on the axis."""
    require_share("unmodulated", unmodulated)
    stack = pictures * (1 - unmodulated)
    stack[:, stack.shape[1] // 2, stack.shape[2] // 2] += unmodulated
    return stack


def _stroke_width(plane: Plane, width: float | None) -> float:
    """Return the width of strokes in metres, which depends on the pixels if None."""
    if width is None:
        return _WIDTH * max(plane.pitch)
    require_positive("width", width, "m")
    return width


def _require_wavelengths(wavelengths: Sequence[float]) -> None:
    if not len(wavelengths):
        raise ValueError("wavelengths is empty; give one for each band")
    for one in wavelengths:
        require_wavelength("wavelength", one)


Merit = Callable[[torch.Tensor], float]  # rates PSFs, (bands, rows, columns), in dB

# Families that the search tries: rings, turns of a spiral, corners of a regular polygon of dots,
# and dots at random places; chosen.
_MOST_RINGS, _TURNS, _POLYGONS, _MOST_DOTS = 4, (1.0, 2.0, 3.0, 4.0), range(2, 9), 24

# Least distance of dots from each other and from the axis at the shortest wavelength, in pixels:
# nearer ones would be one dot, or add to the unmodulated light. Chosen.
_LEAST_DISTANCE = 3.0

_FIRST_STEP, _LAST_STEP = 0.4, 0.05  # standard deviation of moves of a dot, over the radius; chosen


@dataclass(frozen=True, eq=False)
class Design:
    """One design of the bands' PSFs, with its merit.

    Parameters
    ----------
    name, psfs : str, torch.Tensor, (bands, rows, columns), float64
        The design in words, and the PSF of each band.
    level : float
        Merit of the PSFs, the expected mean PSNR of the bands in dB.
    positions : tuple of tuple of float
        (y, x) of each dot at the longest wavelength, metres; empty for other shapes.
    """

    name: str
    psfs: torch.Tensor
    level: float
    positions: tuple[Position, ...] = ()


@single_threaded
def search_design(
    merit: Merit,
    plane: Plane,
    wavelengths: Sequence[float],
    radius: float,
    *,
    unmodulated: float,
    generator: torch.Generator,
    candidates: int = 40,
    steps: int = 100,
    progress: Progress | None = None,
) -> Design:
    """Search for the PSFs of a given size from which bands are expected to be restored best.

    The search tries rings, spirals and regular polygons of dots, then dots at random places. Then
    it moves, adds and removes single dots of the best ones as long as the merit rises. All shapes
    reach to `radius` at the longest wavelength, and dots have their centroid on the axis: PSFs that
    shift a band as a whole lose light at the border of the picture.

    Parameters
    ----------
    merit : callable
        Rates PSFs, (bands, rows, columns), by a level in dB: see `PsfMerit`.
    plane, wavelengths, unmodulated
        As of `ring_psfs`.
    radius : float
        Largest distance from the axis at the longest wavelength, metres.
    generator : torch.Generator
        Source of random numbers.
    candidates, steps : int, default 40, 100
        Number of random sets of dots, and of moves that are tried.
    progress : Progress, optional
        Receives reports, and can cancel the work.

    Returns
    -------
    Design
        The best design.

    Raises
    ------
    ValueError
        If a count or a size isn't positive, a share isn't one, or the radius doesn't fit on the
        plane or leaves no room for dots.
    """
    for name, count in (("candidates", candidates), ("steps", steps)):
        require_count(name, count)
    require_positive("radius", radius, "m")
    require_share("unmodulated", unmodulated)
    progress = progress or Progress()
    search = _Search(merit, plane, wavelengths, radius, unmodulated, generator)
    search.try_families(progress.part(0.0, 0.2))
    search.try_random_dots(candidates, progress.part(0.2, 0.5))
    search.move_dots(steps, progress.part(0.5, 1.0))
    assert search.best is not None
    return search.best


@dataclass(eq=False)
class _Search:
    """What a search is given, and the best designs so far."""

    merit: Merit
    plane: Plane
    wavelengths: Sequence[float]
    radius: float
    unmodulated: float
    generator: torch.Generator
    best: Design | None = None
    best_dots: Design | None = None

    def __post_init__(self) -> None:
        shortest = min(self.wavelengths) / max(self.wavelengths)
        self._least_distance = _LEAST_DISTANCE * max(self.plane.pitch) / shortest
        if self.radius < 2 * self._least_distance:
            raise ValueError(
                f"radius is {self.radius:g} m; dots need {2 * self._least_distance:.3g} m or more "
                "to lie apart on these pixels"
            )

    def try_families(self, progress: Progress) -> None:
        """Try rings, spirals, and dots at the corners of regular polygons."""
        given, share = (self.plane, self.wavelengths, self.radius), self.unmodulated
        for count in range(1, _MOST_RINGS + 1):
            self._keep_better(f"{count} rings", ring_psfs(*given, count=count, unmodulated=share))
            progress.report(0.25 * count / _MOST_RINGS, "rings")
        for turns in _TURNS:
            psfs = spiral_psfs(*given, turns=turns, unmodulated=share)
            self._keep_better(f"spiral of {turns:g} turns", psfs)
            progress.report(0.5, "spirals")
        for corners in _POLYGONS:
            angles = [2 * math.pi * k / corners for k in range(corners)]
            self._try_dots([_at_angle(self.radius, angle) for angle in angles])
            progress.report(1.0, "polygons of dots")

    def try_random_dots(self, candidates: int, progress: Progress) -> None:
        """Try dots at random places, few of them as often as many."""
        for n in range(candidates):
            count = round(_MOST_DOTS ** self._random())
            positions = list[Position]()
            for _ in range(10 * count):
                distance = self.radius * math.sqrt(self._random())
                place = _at_angle(distance, 2 * math.pi * self._random())
                if len(positions) < count and self._is_apart(place, positions):
                    positions.append(place)
            if positions:
                self._try_dots(positions)
            progress.report((n + 1) / candidates, f"random dots {n + 1}/{candidates}")

    def move_dots(self, steps: int, progress: Progress) -> None:
        """Move, add or remove single dots of the best design that is made of dots."""
        for n in range(steps):
            step = _FIRST_STEP * (_LAST_STEP / _FIRST_STEP) ** (n / steps)
            self._try_dots(self._changed_dots(step * self.radius))
            progress.report((n + 1) / steps, f"moves of dots {n + 1}/{steps}")

    def _changed_dots(self, step: float) -> list[Position]:
        """Return the best dots after a random change of one of them."""
        assert self.best_dots is not None
        positions = list(self.best_dots.positions)
        chosen = positions[int(self._random() * len(positions))]
        kind = self._random()
        if kind < 0.8 or (kind < 0.9 and len(positions) == 1):
            positions.remove(chosen)
        elif kind < 0.9:
            positions.remove(chosen)
            return positions
        shift = torch.randn(2, generator=self.generator, dtype=torch.float64).tolist()
        place = chosen[0] + step * shift[0], chosen[1] + step * shift[1]
        return [*positions, place] if self._is_apart(place, positions) else [*positions, chosen]

    def _try_dots(self, positions: Sequence[Position]) -> None:
        """Try dots around the axis, of which the outermost is at the radius."""
        middle = [sum(axis) / len(positions) for axis in zip(*positions, strict=True)]
        around = [(y - middle[0], x - middle[1]) for y, x in positions]
        farthest = max(math.hypot(*place) for place in around)
        if farthest < self._least_distance:
            return
        scale = self.radius / farthest
        placed = tuple((scale * y, scale * x) for y, x in around)
        if not all(self._is_apart(p, [q for q in placed if q != p]) for p in placed):
            return
        psfs = dot_psfs(self.plane, self.wavelengths, placed, unmodulated=self.unmodulated)
        found = self._keep_better(f"{len(placed)} dots", psfs, placed)
        if self.best_dots is None or found.level > self.best_dots.level:
            self.best_dots = found

    def _keep_better(
        self, name: str, psfs: torch.Tensor, positions: tuple[Position, ...] = ()
    ) -> Design:
        """Rate PSFs, and keep them if they are the best."""
        found = Design(name, psfs, self.merit(psfs), positions)
        if self.best is None or found.level > self.best.level:
            self.best = found
        return found

    def _is_apart(self, place: Position, others: Sequence[Position]) -> bool:
        """Tell whether a dot is far enough from the axis and from other dots."""
        return all(math.dist(place, other) >= self._least_distance for other in ((0, 0), *others))

    def _random(self) -> float:
        return float(torch.rand((), generator=self.generator, dtype=torch.float64))


def _at_angle(distance: float, angle: float) -> Position:
    return distance * math.sin(angle), distance * math.cos(angle)
