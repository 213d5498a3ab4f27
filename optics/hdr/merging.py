"""Merge the frames of an exposure bracket into radiance with variance and state."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch
from numpy.typing import NDArray

from optics.hdr.bracket import Bracket
from optics.hdr.clip_levels import ClipLevel
from optics.hdr.doubts import find_doubts, join_doubts, settle_doubts
from optics.hdr.radiance import (
    CLIPPED,
    DARK,
    DEFECTIVE,
    MAY_CLIP,
    MOVED,
    VALID,
    RadianceEstimate,
)
from optics.hdr.samples import Array, Indices, Samples, read_samples
from optics.hdr.weighted_mean import (
    METHODS,
    Method,
    WeightedMean,
    information_by_time,
    mean_and_contradiction,
    mean_by_time,
    mean_by_variance,
)

_TILE = 1 << 15
"""Pixels that are averaged together: so few that their numbers stay in a core's memory. 2¹⁴ to 2¹⁶
take the same time."""

_BLOCK = 1 << 19
"""Pixels whose doubtful ones are settled together: so many that each call of numpy has enough to
do. Chosen."""

_DARK = 3.0
"""Standard deviations of its noise below which a pixel counts as dark."""


def merge(
    bracket: Bracket,
    method: Method = "full",
    defects: NDArray[np.bool_] | None = None,
    check: Callable[[float], None] = lambda share: None,
) -> RadianceEstimate:
    """Merge an exposure bracket into an HDR radiance estimate.

    Parameters
    ----------
    bracket : Bracket
        Frames with their exposure times and darks.
    method : {"full", "Granados", "Poisson", "plain"}, default "full"
        How exposures that aren't clipped are weighted. "plain": by the square of their time, as if
        all noise were the same. "Poisson": by their time, as if photons made all noise. "Granados":
        by their inverse variance, predicted from the merged value (Granados et al., CVPR 2010, doi
        10.1109/CVPR.2010.5540208). "full": likewise, and an exposure near its clip level counts by
        an estimate that is unbiased there (see `optics.hdr.near_clipping`), and what moved is left
        out.
    defects : NDArray of bool, optional
        (rows, columns): pixels that don't measure light.
    check : callable, optional
        Is called with the share that is done. It may raise, to end the work.

    Returns
    -------
    RadianceEstimate
        The variance counts photons, dark current, read noise, quantisation, and the noise of the
        dark frames, which all frames of one exposure time share.

    Raises
    ------
    ValueError
        For another method, a mask of another size, and numbers that aren't finite.
    """
    if method not in METHODS:
        raise ValueError(f"method is {method!r}; choose one of {', '.join(METHODS)}")
    if defects is not None and defects.shape != bracket.shape:
        raise ValueError(f"defects are {defects.shape} and the frames {bracket.shape} pixels")
    rows, columns = bracket.shape
    rate, variance = (np.empty(bracket.shape, np.float32) for _ in range(2))
    state = np.empty(bracket.shape, np.uint8)
    levels = [ClipLevel(bracket, number) for number in range(len(bracket.exposures))]
    step = max(1, _BLOCK // columns)
    for start in range(0, rows, step):
        check(start / rows)
        part = slice(start, min(start + step, rows))
        mean = WeightedMean(rate[part].ravel(), variance[part].ravel())
        moved = _merge_rows(bracket, part, method, levels, mean)
        state[part] = _states(mean, levels[0].may_clip, moved).reshape(-1, columns)
        with np.errstate(divide="ignore"):
            np.divide(1, mean.information, out=mean.information)
    if defects is not None:
        state[defects], variance[defects] = DEFECTIVE, np.inf
    return RadianceEstimate(*(torch.from_numpy(one) for one in (rate, variance, state)))


def _merge_rows(
    bracket: Bracket, rows: slice, method: Method, levels: list[ClipLevel], mean: WeightedMean
) -> Indices | None:
    """Write the mean of the HDR pixels in some rows; return where something moved, if that's known.

    mean: is overwritten.
    """
    columns = bracket.shape[1]
    count, step = rows.stop - rows.start, max(1, _TILE // columns)
    space = np.empty((4, len(bracket.exposures), step * columns), dtype=np.float32)
    doubts = []
    for start in range(0, count, step):
        stop = min(start + step, count)
        samples = read_samples(bracket, slice(rows.start + start, rows.start + stop), space)
        here = slice(start * columns, stop * columns)
        tile, contradiction = _mean(samples, method)
        mean.rate[here], mean.information[here] = tile
        if contradiction is not None:
            doubts.append(find_doubts(samples, tile, contradiction, levels, here.start))
    return settle_doubts(join_doubts(doubts), mean, levels, rows) if doubts else None


def _mean(samples: Samples, method: Method) -> tuple[WeightedMean, Array | None]:
    """Return the mean of HDR pixels by a method; and how much exposures contradict, for "full"."""
    if method in ("plain", "Poisson"):
        rate = mean_by_time(samples, method)
        return WeightedMean(rate, information_by_time(samples, rate, method)), None
    # After one pass, weights would depend on the chance that is in the longest exposures; a third
    # one changed nothing in brackets of two to eight exposures.
    first = mean_by_variance(samples, mean_by_time(samples)).rate
    if method == "full":
        return mean_and_contradiction(samples, first)
    return mean_by_variance(samples, first), None


def _states(mean: WeightedMean, may_clip: np.float32, moved: Indices | None) -> NDArray[np.uint8]:
    """Return the states of HDR pixels; moved: indices of those that contradict themselves."""
    state = np.full(mean.rate.shape, int(VALID), dtype=np.uint8)
    significance = np.abs(mean.rate)
    significance *= mean.rate
    significance *= mean.information
    state[significance < _DARK**2] = DARK
    state[mean.rate > may_clip] = MAY_CLIP
    if moved is not None:
        state[moved] = MOVED
    state[~(mean.information > 0)] = CLIPPED
    return state
