"""Bound what any pattern can reach over a range of depths, by the overlap of shifted pupils."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import torch

from optics.camera import Camera
from optics.camera.pupil import pupil_amplitude, require_valid_source
from optics.camera.stop import Circle
from optics.edof.dioptres import DEPTH_RANGE, require_depth_range
from optics.edof.picture_spectrum import FrequencyGrid
from optics.edof.spectral_criterion import error_level, noise_variance
from optics.gauss_legendre import gauss_legendre
from optics.validation import accepts_numpy, as_number, require_count

Rule = Literal["gauss-legendre", "midpoint"]

# Points of the quadrature that are in memory at a time; they take 8 MiB an array. Chosen.
_CHUNK_POINTS = 1 << 20

_PARALLEL = 1e-12  # sine of an angle below which a pupil's edge counts as parallel to a line


@dataclass(frozen=True)
class ConvexPupil:
    """A convex open pupil: half-planes, and a disc if the stop is round; metres, (y, x)."""

    normals: tuple[tuple[float, float], ...]
    """Outward normals of the edges, of length 1; the first four are those of the panel."""
    offsets: tuple[float, ...]
    """Distances of the edges from the origin along their normals."""
    disc: tuple[float, float, float] | None = None
    """Radius and centre."""
    corners: tuple[tuple[float, float], ...] = ()
    """Those of a polygonal stop's opening, which limit the overlap's length."""


def convex_pupil(camera: Camera) -> ConvexPupil:
    """Return the smallest convex pupil that contains the open pupil of a camera's panel.

    It is the panel's rectangle cut by the opening of the stop. Obscurations count as open. Raises
    ValueError if the stop's opening isn't convex.
    """
    panel, opening = camera.panel, camera.lens.stop.opening
    radius = as_number(camera.lens.stop_diameter) / 2
    normals: list[tuple[float, float]] = []
    offsets: list[float] = []
    for axis, normal in ((0, (1.0, 0.0)), (1, (0.0, 1.0))):
        count = panel.shape[axis]
        # The origin is the pixel count // 2, whose centre lies on the axis.
        low, high = (0.5 + count // 2) * panel.pitch, (count - count // 2 - 0.5) * panel.pitch
        normals += [normal, (-normal[0], -normal[1])]
        offsets += [high, low]
    if isinstance(opening, Circle):
        y, x = opening.centre
        disc = opening.radius * radius, y * radius, x * radius
        return ConvexPupil(tuple(normals), tuple(offsets), disc)
    if not opening.is_convex:
        raise ValueError("camera.lens.stop has an opening that isn't convex; the bound needs one")
    for (y0, x0), (y1, x1) in opening.edges:
        length = math.hypot(y1 - y0, x1 - x0)
        # Corners go from x towards y, with the inside to the left of each edge.
        normal = (-(x1 - x0) / length, (y1 - y0) / length)
        normals.append(normal)
        offsets.append(radius * (normal[0] * y0 + normal[1] * x0))
    corners = tuple((radius * y, radius * x) for y, x in opening.corners)
    return ConvexPupil(tuple(normals), tuple(offsets), corners=corners)


def overlap_integrals(
    pupil: ConvexPupil,
    sy: torch.Tensor,
    sx: torch.Tensor,
    *,
    nodes: int = 100,
    rule: Rule = "gauss-legendre",
) -> tuple[torch.Tensor, torch.Tensor]:
    """Integrate over t the width w(t) of the overlap of a pupil's two copies, and its square.

    Returns the overlap's area in square metres, and the integral of w(t)² in cubic metres, each
    (shifts,), float64, for shifts of the copies along y and x in metres. Measured for the panel's
    rectangle: 100 nodes change the bound by less than .001 dB against 300. The rule "midpoint"
    serves to check "gauss-legendre".
    """
    require_count("nodes", nodes)
    if rule == "midpoint":
        points = (torch.arange(nodes, dtype=torch.float64) + 0.5) / nodes
        weights = torch.full_like(points, 1 / nodes)
    elif rule == "gauss-legendre":
        found, sums_to_two = gauss_legendre(nodes)
        points, weights = torch.from_numpy((found + 1) / 2), torch.from_numpy(sums_to_two / 2)
    else:
        raise ValueError(f"rule is {rule!r}; choose gauss-legendre or midpoint")
    areas, squares = [], []
    size = max(1, _CHUNK_POINTS // nodes)
    for one_y, one_x in zip(
        torch.split(sy.double(), size), torch.split(sx.double(), size), strict=True
    ):
        low, high = _overlap_reach(pupil, one_y, one_x)
        length = (high - low).clamp(min=0.0)
        t = low[:, None] + length[:, None] * points
        width = _overlap_width(pupil, one_y, one_x, t)
        areas.append(length * (width @ weights))
        squares.append(length * (width**2 @ weights))
    return torch.cat(areas), torch.cat(squares)


def _direction(sy: torch.Tensor, sx: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Return the unit vector along a shift; that of x for no shift."""
    length = torch.hypot(sy, sx)
    safe = torch.where(length > 0, length, torch.ones_like(length))
    return torch.where(length > 0, sy / safe, 0.0), torch.where(length > 0, sx / safe, 1.0)


def _overlap_reach(
    pupil: ConvexPupil, sy: torch.Tensor, sx: torch.Tensor
) -> tuple[torch.Tensor, torch.Tensor]:
    """Return limits along the shift that contain the overlap of both copies.

    They are those of the panel's rectangle, and of the disc or the polygon of the stop.
    """
    uy, ux = _direction(sy, sx)
    half = torch.hypot(sy, sx) / 2
    (top, bottom, right, left) = pupil.offsets[:4]
    high = torch.maximum(uy * top, -uy * bottom) + torch.maximum(ux * right, -ux * left) - half
    low = -torch.maximum(-uy * top, uy * bottom) - torch.maximum(-ux * right, ux * left) + half
    if pupil.disc:
        radius, y, x = pupil.disc
        middle = uy * y + ux * x
        high = torch.minimum(high, middle + radius - half)
        low = torch.maximum(low, middle - radius + half)
    if pupil.corners:
        along = torch.stack([uy * y + ux * x for y, x in pupil.corners])
        high = torch.minimum(high, along.amax(0) - half)
        low = torch.maximum(low, along.amin(0) + half)
    return low, high


def _overlap_width(
    pupil: ConvexPupil, sy: torch.Tensor, sx: torch.Tensor, t: torch.Tensor
) -> torch.Tensor:
    """Return the width of the overlap across the shift, (shifts, positions).

    A line across the shift meets each half-plane and disc in an interval, and the convex overlap in
    the intersection of them all.
    """
    uy, ux = (one[:, None] for one in _direction(sy, sx))
    low, high = torch.full_like(t, -math.inf), torch.full_like(t, math.inf)
    empty = torch.zeros_like(t, dtype=torch.bool)
    for (my, mx), offset in zip(pupil.normals, pupil.offsets, strict=True):
        # Of the two copies of an edge, the one further in limits the overlap.
        limit = offset - (my * sy + mx * sx).abs()[:, None] / 2 - t * (my * uy + mx * ux)
        across = mx * uy - my * ux
        parallel = across.abs() < _PARALLEL
        bound = limit / torch.where(parallel, 1.0, across)
        high = torch.where(~parallel & (across > 0), torch.minimum(high, bound), high)
        low = torch.where(~parallel & (across < 0), torch.maximum(low, bound), low)
        empty |= parallel & (limit < 0)
    if pupil.disc:
        radius, y, x = pupil.disc
        middle = y * -ux + x * uy
        for sign in (-1.0, 1.0):
            along = t - (uy * y + ux * x) - sign * torch.hypot(sy, sx)[:, None] / 2
            rest = radius**2 - along**2
            half = rest.clamp(min=0.0).sqrt()
            empty |= rest < 0
            high, low = torch.minimum(high, middle + half), torch.maximum(low, middle - half)
    return torch.where(empty, 0.0, (high - low).clamp(min=0.0))


def rms_transfer_limit(
    camera: Camera,
    wavelength: float,
    grid: FrequencyGrid,
    *,
    depth_range: tuple[float, float] = DEPTH_RANGE,
    binning: int = 1,
    folded: bool = True,
    nodes: int = 100,
    rule: Rule = "gauss-legendre",
) -> torch.Tensor:
    """Compute the largest root mean square over depth of the OTF that any pattern can have.

    Parameters
    ----------
    camera : Camera
        The camera; its panel stands at the lens, which has no aberrations and a convex stop.
    wavelength : float
        Metres.
    grid : FrequencyGrid
        The frequencies, in cycles per (binned) pixel.
    depth_range : tuple of (float, float), optional
        Farthest and nearest depth in dioptres.
    binning : int, optional
        Sensor pixels along each side of the squares that are averaged into a pixel. The scene is
        taken to be constant within such a square.
    folded : bool, optional
        Whether all orders that the samples fold onto a frequency count, which the bound needs (the
        default). Without them the limit is that of the optics before sampling.
    nodes, rule
        The quadrature; see `overlap_integrals`.

    Returns
    -------
    torch.Tensor, (rows, columns), float64
        Limit of the root mean square of the OTF, relative to the light of the open pupil.

    Raises
    ------
    ValueError
        If the camera isn't one that this model covers, or a number is out of range.
    """
    require_valid_source(math.inf, wavelength)
    require_depth_range(depth_range)
    require_count("binning", binning)
    _require_bounded(camera)
    pupil = convex_pupil(camera)
    light = float(pupil_amplitude(camera).sum()) * camera.panel.pitch**2
    # Metres of pupil shift per cycle per binned pixel.
    shift = wavelength * as_number(camera.lens.image_distance) / camera.sensor.pitch / binning
    focal_spread = wavelength / (depth_range[1] - depth_range[0])
    total = torch.zeros(grid.shape, dtype=torch.float64)
    fy, fx = grid.frequencies()
    for my in _orders(pupil, 0, shift, folded):
        for mx in _orders(pupil, 1, shift, folded):
            oy, ox = (f.expand(grid.shape).flatten() for f in (fy + my, fx + mx))
            box = _averaging_transfer(oy, binning) * _averaging_transfer(ox, binning)
            area, square = overlap_integrals(pupil, oy * shift, ox * shift, nodes=nodes, rule=rule)
            length = torch.hypot(oy, ox) * shift
            in_focus = (area / light) ** 2
            safe = torch.where(length > 0, length, torch.ones_like(length))
            spread = torch.where(length > 0, focal_spread * square / (safe * light**2), 1.0)
            limit = torch.minimum(spread, in_focus.clamp(max=1.0)).sqrt()
            total += (limit * box**2).reshape(grid.shape)
    return total.clamp(max=1.0)


@accepts_numpy
def known_depth_bound(
    limit: torch.Tensor, spectrum: torch.Tensor, shares: torch.Tensor, noise: float
) -> float:
    """Compute the highest expected PSNR in dB that any pattern and linear restoration can reach.

    Parameters
    ----------
    limit, spectrum, shares : torch.Tensor, (rows, columns)
        From `rms_transfer_limit`, and the power spectrum of the pictures and the frequencies'
        shares, as in `known_depth_error`.
    noise : float
        Standard deviation of a pixel's noise, where white is the light of the open pupil.

    Returns
    -------
    float
        PSNR in dB, of the mean squared error over pictures and depths. It bounds restoration with
        the depth known, and so also without.

    Raises
    ------
    ValueError
        If shapes don't fit or the noise is out of range.
    """
    if limit.shape != spectrum.shape or limit.shape != shares.shape:
        raise ValueError(
            f"limit is {tuple(limit.shape)}, spectrum {tuple(spectrum.shape)} and shares "
            f"{tuple(shares.shape)}; they must be on the same frequencies"
        )
    variance, spectrum = noise_variance(noise), spectrum.double()
    return error_level((shares * spectrum * variance / (spectrum * limit**2 + variance)).sum())


def _orders(pupil: ConvexPupil, axis: int, shift: float, folded: bool) -> range:
    """Return the orders along an axis, in cycles per pixel, in which a pupil passes light."""
    if not folded:
        return range(1)
    cutoff = sum(pupil.offsets[2 * axis : 2 * axis + 2]) / shift
    most = math.floor(cutoff + 0.5)
    return range(-most, most + 1)


def _averaging_transfer(frequency: torch.Tensor, binning: int) -> torch.Tensor:
    """Return the transfer function of a mean over a row of pixels, at cycles per binned pixel."""
    before = frequency / binning
    return torch.sinc(binning * before) / torch.sinc(before)


def _require_bounded(camera: Camera) -> None:
    """Raise ValueError for a camera that the bound isn't derived for."""
    if not camera.lens.has_quadratic_phase:
        raise ValueError("camera.lens has aberrations or isn't thin; the bound is for a thin lens")
    if as_number(camera.separation):
        raise ValueError(
            f"camera.separation is {as_number(camera.separation):g} m; the bound is for a panel "
            "at the lens: set 0"
        )
