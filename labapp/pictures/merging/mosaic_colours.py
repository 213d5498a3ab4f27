"""Turn a merged bracket of a sensor with colour filters into colours, over all of its range.

Demosaicing takes noise and detail to be of one size everywhere. Those of a merged bracket grow with
its light, over decades, so that the colours are estimated of the light's inverse hyperbolic sine:
proportional to light in the noise of darkness, and to its logarithm above. Filters that see one
band each commute with that.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from labapp.common.errors import UserError
from labapp.files.raw import RawPhotograph
from labapp.pictures.analysis.colour_filters import ColourFilters
from labapp.pictures.analysis.raw_colours import raw_filters
from optics.hdr import CLIPPED
from optics.inverse import build_mosaic_observation, demosaic, demosaicing_weight

Light = NDArray[np.float32]

_KNEE = 4.0
"""Light from which on its logarithm is demosaiced, over the deviation of dark pixels. Chosen: noise
stays where the curve is straight, so that it hardly changes the mean."""

_DARKEST = 0.01
"""Quantile of the pixels' deviations that counts as that of darkness. Chosen."""

_TILE, _MARGIN = 480, 24
"""Pixels along a side that are demosaiced together, and beyond which none tells anything of them.
Multiples of the periods of usual filters. Chosen: memory stays small."""


def bracket_filters(raw: RawPhotograph) -> tuple[ColourFilters | None, list[str], list[str]]:
    """Return the colour filters of a RAW file, notes, and warnings, in words.

    The filters are None for a sensor without any, and where their colours aren't known.
    """
    if raw.pattern is None:
        return None, [], []
    try:
        filters, notes = raw_filters(raw)
    except UserError as error:
        reason = str(error).split(": ", 1)[-1].split(" Restore it", 1)[0]
        return None, [], [f"{reason} The .tiff and .png show the mosaic in grey"]
    said = (
        "the .tiff is linear sRGB, balanced to white, in which white has the electrons per second"
    )
    return filters, [*notes, f"{said} of the brightest of {', '.join(filters.channels)}"], []


def merged_colours(
    rate: Light,
    variance: NDArray[np.float32],
    state: NDArray[np.uint8],
    filters: ColourFilters,
    check: Callable[[float], None] = lambda share: None,
) -> Light:
    """Demosaic merged light to linear sRGB, (3, rows, columns), float32.

    Pixels that are clipped in all exposures are no brighter than white that just clips, since the
    colour of what is clipped isn't known. Noise makes dark pixels negative.

    rate, variance, state: (rows, columns), of the mosaic.
    filters: of the sensor; white has the light of the brightest channel.
    check: is called with the share that is done; it may raise, to end the work.
    """
    gain = filters.gains.astype(np.float32)[filters.channel_map(rate.shape)]
    clipped = state == CLIPPED
    known = np.isfinite(variance) & np.isfinite(rate)
    balanced = np.where(known | clipped, rate / gain, np.nan).astype(np.float32)
    deviation = np.sqrt(np.where(known, variance, 0)) / gain
    told = deviation[known]
    knee = _KNEE * float(np.quantile(told, _DARKEST)) if told.size else 1.0
    curved = np.arcsinh(balanced / np.float32(knee))
    spread = deviation[known] / np.hypot(balanced[known], np.float32(knee))
    scale = float(curved[known].std()) if told.size else 0.0
    noise = float(np.median(spread)) if told.size else 0.0
    weight = demosaicing_weight(noise, scale) if scale > 0 else None
    bands = np.empty((len(filters.channels), *rate.shape), dtype=np.float32)
    tiles = list(_tiles(rate.shape, filters.period))
    for number, (outer, inner, target) in enumerate(tiles):
        check(number / len(tiles))
        found = _demosaiced(curved[outer], clipped[outer], filters, noise, weight)
        bands[(slice(None), *target)] = np.sinh(found[(slice(None), *inner)]) * np.float32(knee)
    if clipped.any():
        near = ndimage.maximum_filter(clipped, tuple(2 * one + 1 for one in filters.period))
        white = float(rate[clipped].min())
        bands[:, near] = np.minimum(bands[:, near], np.float32(white))
    return filters.to_screen(bands).astype(np.float32)


def _demosaiced(
    curved: Light,
    clipped: NDArray[np.bool_],
    filters: ColourFilters,
    noise: float,
    weight: float | None,
) -> Light:
    """Return the bands of a part of the mosaic, on the scale of its curve."""
    seen = np.isfinite(curved)
    if not all(
        (seen & (filters.channel_map(curved.shape) == k)).any()
        for k in range(len(filters.channels))
    ):
        return np.zeros((len(filters.channels), *curved.shape), dtype=np.float32)
    observation = build_mosaic_observation(
        np.where(seen, curved, 0).astype(np.float32),
        filters.pattern,
        channels=filters.channels,
        noise=noise if 0 < noise < float(np.abs(curved[seen]).max()) else None,
        weights=None if seen.all() else seen.astype(np.float32),
        clipped=clipped if clipped.any() else None,
    )
    found: Light = demosaic(observation, weight)
    return found


def _tiles(
    shape: tuple[int, ...], period: tuple[int, int]
) -> Iterator[tuple[tuple[slice, ...], ...]]:
    """Yield parts of a mosaic with their margins, what counts within each, and where it belongs.

    All begin where the pattern of the filters does.
    """
    for rows, columns in itertools.product(*map(_spans, shape, period)):
        yield tuple(zip(rows, columns, strict=True))


def _spans(count: int, period: int) -> list[tuple[slice, slice, slice]]:
    """Return the spans of `_tiles` along one side of the mosaic."""
    step, margin = max(1, _TILE // period) * period, -(-_MARGIN // period) * period
    spans = []
    for at in range(0, count, step):
        start, stop = max(0, at - margin), min(count, at + step)
        outer = slice(start, min(count, stop + margin))
        spans.append((outer, slice(at - start, stop - start), slice(at, stop)))
    return spans
