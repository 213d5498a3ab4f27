"""Where a PSF has its origin and its light, and the PSF with its light about the origin.

The origin is in the middle of the array, or in a corner.
"""

from __future__ import annotations

import math

import numpy as np
import scipy.ndimage
import torch
from numpy.typing import NDArray

Light = NDArray[np.float64]

# Light above the background that belongs to a PSF, over its peak and over the noise. Chosen.
_LEAST_LIGHT, _LEAST_NOISE_RATIO = 0.02, 4.0

# Quantiles of a PSF's values that show its background and noise. Chosen: few PSFs light more than
# four fifths of their array.
_LOW_QUANTILES = 0.02, 0.2

# Distances of these quantiles of the normal distribution below its mean, in deviations.
_NORMAL_DISTANCES = 2.054, 0.842

# Least share of a PSF's light in its largest connected part; below, parts that a dark pixel
# separates belong together, as the lobes of a cubic phase mask's PSF. Chosen.
_MAIN_SHARE = 0.5

# Largest share of that light that is connected in the array as it is stored. Chosen.
_TORN_SHARE = 0.99

# Least light of the first and last line, over that of the two lines in the middle, and over all.
# Chosen; in a sound PSF the first ratio is below 1.
_EDGE_RATIO, _EDGE_SHARE = 3.0, 0.01

# Lines on either side of an edge, the least ratio of their light, and the share of light in one
# line from which a PSF is thin and needn't lie on both sides. Chosen.
_NEAR_LINES, _SIDE_RATIO, _THIN_SHARE = 3, 0.005, 0.9

# Light of the second line from an edge over the first, on both sides, from which the edge
# separates spots that only touch it. Chosen: 1.6 for disks of 5 to 7 pixels.
_VALLEY = 1.25

# Least light of the second lines from an edge over the first. Chosen: single pixels have none.
_BEYOND = 0.05

# Largest difference of the lines on both sides of an edge, over their light, where the light lies
# in two quarters only, as a thin line's. Chosen.
_MISFIT = 0.2


def has_origin_in_corner(psf: NDArray[np.floating]) -> bool:
    """Tell by its wrapped light whether a PSF, (rows, columns), has its origin at index 0.

    Parts that don't touch each other, as spots, aren't torn by the edges and can't tell. Audited on
    296 computed PSFs that made no limit (disks, rings, motions, shakes, cubic masks, spots and
    speckle), with noise of 0, 1 and 5 % of the peak, centred and off centre: none is taken wrongly.
    With the origin in the corner and dark pixels around, 22 to 28 aren't found without noise,
    nearly all spots, and 54 to 58 with noise of 5 %.
    """
    psf = np.asarray(psf, dtype=np.float64)
    lowest, low = (float(one) for one in np.quantile(psf, _LOW_QUANTILES))
    far, near = _NORMAL_DISTANCES
    noise = (low - lowest) / (far - near)
    background = low + near * noise
    # What belongs to the PSF is above background and noise, and above a share of its peak.
    least = max(_LEAST_LIGHT * (float(psf.max()) - background), _LEAST_NOISE_RATIO * noise)
    light = np.clip(psf - background - least, 0, None)
    whole = np.fft.fftshift(light)
    main = _largest_part(whole, joins=False)
    joins = bool(main.sum() < _MAIN_SHARE * light.sum())
    if joins:
        main = _largest_part(whole, joins=True)
    stored = np.fft.ifftshift(main)
    total = float(main.sum())
    if total <= 0 or total < _MAIN_SHARE * light.sum():
        return False
    if _largest_part(stored, joins=joins).sum() > _TORN_SHARE * total:
        return False
    edges = [_look_along_edge(one) for one in (stored, stored.T) if len(one) > _NEAR_LINES]
    if not edges or not all(lies for lies, _, _ in edges):
        return False
    half, wide = math.ceil(stored.shape[0] / 2), math.ceil(stored.shape[1] / 2)
    quarters = [
        part.sum()
        for side in (stored[:half], stored[half:])
        for part in (side[:, :wide], side[:, wide:])
    ]
    lit = sum(one > _SIDE_RATIO * max(quarters) for one in quarters)
    continues, misfit = any(one for _, one, _ in edges), min(one for _, _, one in edges)
    return continues and (lit > 2 or misfit <= _MISFIT)


def _look_along_edge(light: Light) -> tuple[bool, bool, float]:
    """Look at the edge before the first row, which is behind the last one.

    Returns whether light lies along it on both sides, and not in the middle; whether it goes on
    across it as one piece; and the difference of both sides over their light, for the best shift.
    """
    rows, first, last = light.sum(1), light[0], light[-1]
    # The last lines that a shift of the origin to the middle puts at the edges.
    middle, edge = len(rows) - len(rows) // 2, rows[0] + rows[-1]
    sides = sorted((rows[:_NEAR_LINES].sum(), rows[-_NEAR_LINES:].sum()))
    on_both = sides[0] >= _SIDE_RATIO * sides[1]
    is_thin = max(rows[0], rows[-1]) >= _THIN_SHARE * rows.sum()
    is_at_edge = edge >= _EDGE_RATIO * rows[middle - 1 : middle + 1].sum()
    if not (is_at_edge and edge > _EDGE_SHARE * rows.sum() and (on_both or is_thin)):
        return False, False, math.inf
    is_valley = rows[1] > _VALLEY * rows[0] and rows[-2] > _VALLEY * rows[-1]
    goes_on = rows[1] + rows[-2] >= _BEYOND * edge
    off = min(float(np.abs(first - np.roll(last, step)).sum()) for step in (-1, 0, 1))
    continues = bool(on_both and goes_on and not is_valley)
    return True, continues, off / float((first + last).sum())


def _largest_part(light: Light, *, joins: bool) -> Light:
    """Return the connected part that has most light; `joins` bridges two dark pixels."""
    square = np.ones((3, 3), dtype=bool)
    lit = scipy.ndimage.binary_dilation(light > 0, square) if joins else light > 0
    labels, count = scipy.ndimage.label(lit, square)
    if not count:
        return light
    sums = scipy.ndimage.sum_labels(light, labels, np.arange(1, count + 1))
    return np.where(labels == 1 + int(np.argmax(sums)), light, 0)


# Offset in pixels up to which a PSF's light may be off its origin by its own shape, and the dark
# pixels that are left around one that is farther off. Measured: the offset is up to 3.5 in 32
# kernels of shaken cameras. Without room, linear steps find light from beyond the frame worse, by
# 0.2 dB in the mean of 132 photographs with these kernels.
_OWN_OFFSET, _ROOM = 3.75, 8


def light_offset(psf: torch.Tensor) -> tuple[int, int]:
    """Return the (rows, columns) by which a PSF's light lies off its origin.

    It is that of the centroid in whole pixels; 0 where it may be the PSF's own, but -1 in an even
    array whose last line is dark, and whose light lies before the origin.
    """
    offset, psf = centroid_offset(psf), psf.detach()
    rows, columns = psf.shape
    down = -1 if rows % 2 == 0 and offset[0] < -0.5 and not bool(psf[-1].any()) else 0
    along = -1 if columns % 2 == 0 and offset[1] < -0.5 and not bool(psf[:, -1].any()) else 0
    if max(abs(offset[0] - down), abs(offset[1] - along)) > _OWN_OFFSET:
        return round(offset[0]), round(offset[1])
    return down, along


def centroid_offset(psf: torch.Tensor) -> tuple[float, float]:
    """Return how far the centroid lies off index n // 2, (rows, columns), in pixels.

    Negative values of the PSF don't count.
    """
    light = psf.detach().to(torch.float64).clamp(min=0)
    light, (rows, columns) = light / light.sum(), light.shape
    down = float((light.sum(1) * torch.arange(rows)).sum()) - rows // 2
    return down, float((light.sum(0) * torch.arange(columns)).sum()) - columns // 2


def rms_radius(psf: torch.Tensor) -> float:
    """Return the root mean square radius of a PSF about its centroid, in pixels."""
    light = psf.detach().to(torch.float64).clamp(min=0)
    share, radius = light / light.sum(), 0.0
    for axis in (0, 1):
        line = share.sum(1 - axis)
        place = torch.arange(line.numel(), dtype=torch.float64, device=line.device)
        radius += float((line * (place - (line * place).sum()) ** 2).sum())
    return math.sqrt(radius)


def about_offset(psfs: torch.Tensor, offset: tuple[int, int]) -> torch.Tensor:
    """Return PSFs, (..., rows, columns), with their light at `offset` central.

    If it is 0 or -1, nothing but a dark last line is left out. Otherwise the array is odd, and has
    some room around all light that isn't 0.
    """
    is_near = all(shift in (0, -1) for shift in offset)
    lit = (psfs != 0).reshape(-1, *psfs.shape[-2:]).any(0)
    for axis, shift in zip((-2, -1), offset, strict=True):
        n = psfs.shape[axis]
        if is_near:
            psfs = psfs.narrow(axis, 0, n + shift)
            continue
        known = lit.any(-3 - axis).nonzero()[:, 0]
        middle = n // 2 + shift
        reach = int((known - middle).abs().max()) + _ROOM
        place = torch.arange(middle - reach, middle + reach + 1)
        inside = (place >= 0) & (place < n)
        taken = psfs.index_select(axis, place.clamp(0, n - 1))
        psfs = taken * (inside[:, None] if axis == -2 else inside)
    return psfs


def shifted_window(
    picture: torch.Tensor, offset: tuple[int, int], shape: tuple[int, ...], wraps: bool
) -> torch.Tensor:
    """Cut a window of a shape out of a picture, `offset` pixels off its middle.

    Beyond the picture its edge is repeated, or its other side if it `wraps`.
    """
    for axis, shift, n in zip((-2, -1), offset, shape[-2:], strict=True):
        length = picture.shape[axis]
        place = torch.arange(n) + length // 2 - n // 2 + shift
        place = place % length if wraps else place.clamp(0, length - 1)
        picture = picture.index_select(axis, place)
    return picture
