"""Stacks of spectral PSFs by families of shapes, each of which grows with the wavelength."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import torch

from optics.plane import Plane
from optics.targets import dots, linear_dispersion, ring, spiral
from optics.validation import require_count, require_positive, require_share, require_wavelength

Position = tuple[float, float]
"""(y, x) of a dot in metres."""

_WIDTH = 0.6
"""Standard deviation across a stroke or of a dot, in pixels: about as sharp as pixels allow."""


def ring_psfs(
    plane: Plane,
    wavelengths: Sequence[float],
    radius: float,
    *,
    count: int = 1,
    width: float | None = None,
    unmodulated: float = 0.0,
) -> torch.Tensor:
    """Draw spectral PSFs of concentric rings, whose radii grow with the wavelength.

    The rings are evenly spaced and equally bright along their circumference.

    Parameters
    ----------
    plane : Plane
        Pixels of the sensor around the axis.
    wavelengths : sequence of float
        Wavelength of each band in metres.
    radius : float
        Radius of the largest ring at the longest wavelength, metres.
    count : int, default 1
        Number of rings.
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

    References
    ----------
    Thesis Fig. 4.3.
    """
    require_count("count", count)
    sharp = _stroke_width(plane, width)

    def draw(scale: float) -> torch.Tensor:
        shares = [(k + 1) / count for k in range(count)]
        rings = [share * ring(plane, scale * share * radius, sharp) for share in shares]
        return torch.stack(rings).sum(0) / sum(shares)

    return _draw_bands(draw, plane, wavelengths, unmodulated)


def spiral_psfs(
    plane: Plane,
    wavelengths: Sequence[float],
    radius: float,
    *,
    turns: float = 3.0,
    width: float | None = None,
    unmodulated: float = 0.0,
) -> torch.Tensor:
    """Draw spectral PSFs of a spiral, whose size grows with the wavelength.

    Parameters
    ----------
    plane : Plane
        Pixels of the sensor around the axis.
    wavelengths : sequence of float
        Wavelength of each band in metres.
    radius : float
        Largest distance from the axis at the longest wavelength, metres.
    turns : float, default 3.0
        Number of turns, from the axis outwards.
    width : float, optional
        Standard deviation across the stroke, metres; 0.6 pixels if None.
    unmodulated : float, default 0.0
        Share of the light that stays on the axis, 0 to 1.

    Returns
    -------
    torch.Tensor, (bands, rows, columns), float64
        The PSFs, each with a sum of 1.

    Raises
    ------
    ValueError
        If a size isn't possible, or the spiral doesn't fit on the plane.
    """
    sharp = _stroke_width(plane, width)

    def draw(scale: float) -> torch.Tensor:
        return spiral(plane, scale * radius, sharp, turns)

    return _draw_bands(draw, plane, wavelengths, unmodulated)


def dot_psfs(
    plane: Plane,
    wavelengths: Sequence[float],
    positions: Sequence[Position],
    *,
    width: float | None = None,
    unmodulated: float = 0.0,
) -> torch.Tensor:
    """Draw spectral PSFs of equal dots, whose distances from the axis grow with the wavelength.

    Parameters
    ----------
    plane : Plane
        Pixels of the sensor around the axis.
    wavelengths : sequence of float
        Wavelength of each band in metres.
    positions : sequence of tuple of float
        (y, x) of each dot at the longest wavelength, metres.
    width : float, optional
        Standard deviation of a dot, metres; 0.6 pixels if None.
    unmodulated : float, default 0.0
        Share of the light that stays on the axis, 0 to 1.

    Returns
    -------
    torch.Tensor, (bands, rows, columns), float64
        The PSFs, each with a sum of 1.

    Raises
    ------
    ValueError
        If there is no dot, or one doesn't fit on the plane.
    """
    sharp = _stroke_width(plane, width)

    def draw(scale: float) -> torch.Tensor:
        return dots(plane, [(scale * y, scale * x) for y, x in positions], sharp)

    return _draw_bands(draw, plane, wavelengths, unmodulated)


def linear_dispersion_psfs(
    plane: Plane,
    wavelengths: Sequence[float],
    radius: float,
    *,
    direction: float = 0.0,
    width: float | None = None,
    unmodulated: float = 0.0,
) -> torch.Tensor:
    """Draw spectral PSFs of a prism: one dot, which moves along a line through the axis.

    Parameters
    ----------
    plane : Plane
        Pixels of the sensor around the axis.
    wavelengths : sequence of float
        Wavelength of each band in metres; two that differ, or more.
    radius : float
        Distance from the axis of the shortest and of the longest wavelength, metres.
    direction : float, default 0.0
        Angle in radians from x towards y, towards which longer waves move.
    width : float, optional
        Standard deviation of the dot, metres; 0.6 pixels if None.
    unmodulated : float, default 0.0
        Share of the light that stays on the axis, 0 to 1.

    Returns
    -------
    torch.Tensor, (bands, rows, columns), float64
        The PSFs, each with a sum of 1.

    Raises
    ------
    ValueError
        If all wavelengths are equal, or the line doesn't fit on the plane.

    References
    ----------
    Thesis Fig. 4.11.
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
    draw: Callable[[float], torch.Tensor],
    plane: Plane,
    wavelengths: Sequence[float],
    unmodulated: float,
) -> torch.Tensor:
    """Draw a shape for each spectral band, scaled by its wavelength relative to the longest."""
    _require_wavelengths(wavelengths)
    longest = max(wavelengths)
    pictures = [draw(float(one) / float(longest)) for one in wavelengths]
    return _add_unmodulated(torch.stack(pictures), unmodulated)


def _add_unmodulated(pictures: torch.Tensor, unmodulated: float) -> torch.Tensor:
    """Move a share of the light of spectral PSFs to the pixel on the axis."""
    require_share("unmodulated", unmodulated)
    stack = pictures * (1 - unmodulated)
    stack[:, stack.shape[1] // 2, stack.shape[2] // 2] += unmodulated
    return stack


def _stroke_width(plane: Plane, width: float | None) -> float:
    """Return the width of the strokes of spectral PSFs, which depends on the pixels if None."""
    if width is None:
        return _WIDTH * max(plane.pitch)
    require_positive("width", width, "m")
    return width


def _require_wavelengths(wavelengths: Sequence[float]) -> None:
    """Raise ValueError for wavelengths from which spectral PSFs can't be drawn."""
    if not len(wavelengths):
        raise ValueError("wavelengths is empty; give one for each band")
    for one in wavelengths:
        require_wavelength("wavelength", one)
