"""Choose object depths in dioptres, and convert them from and to metres.

A depth in dioptres is the inverse of the distance in metres; infinity is 0. Defocus is linear in
dioptres, so that depths which are uniform in dioptres are uniform in defocus.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import torch

from optics.validation import require_count

PUBLISHED_DISTANCES = (0.5, 0.62, 0.75, 0.8, 1.0, 1.5, 2.0, 3.5, 5.0, 50.0)
"""Test distances in metres of thesis Eq. 5.11."""

PUBLISHED_DIOPTRES = tuple(1.0 / one for one in PUBLISHED_DISTANCES)
"""The same in dioptres, from near to far."""

DEPTH_RANGE = (0.0, 2.0)
"""Depths in dioptres from infinity to half a metre, which thesis section 5.7 covers."""


def dioptres_from_metres(distances: Sequence[float]) -> tuple[float, ...]:
    """Convert object distances from metres to dioptres; ``math.inf`` becomes 0.

    Parameters
    ----------
    distances : sequence of float
        Metres, positive; ``math.inf`` is allowed.

    Returns
    -------
    tuple of float
        Dioptres.

    Raises
    ------
    ValueError
        If a distance isn't positive.
    """
    for one in distances:
        if not one > 0:
            raise ValueError(f"distances holds {one:g} m; give positive distances (inf is allowed)")
    return tuple(1.0 / float(one) for one in distances)


def metres_from_dioptres(dioptres: Sequence[float]) -> tuple[float, ...]:
    """Convert object depths from dioptres to metres; 0 becomes ``math.inf``.

    Parameters
    ----------
    dioptres : sequence of float
        Dioptres, 0 or more.

    Returns
    -------
    tuple of float
        Metres.

    Raises
    ------
    ValueError
        If a depth is negative or isn't finite, or there is none.
    """
    require_dioptres("dioptres", dioptres)
    return tuple(1.0 / float(one) if one > 0 else math.inf for one in dioptres)


def require_dioptres(name: str, dioptres: Sequence[float]) -> None:
    """Raise ValueError, with an argument's name, unless depths are one or more, finite, from 0."""
    if not len(dioptres):
        raise ValueError(f"{name} is empty; give one depth at least")
    for one in dioptres:
        if not 0 <= one < math.inf:
            raise ValueError(f"{name} holds {one:g} dioptres; give 0 (infinity) or more, finite")


def require_depth_range(depth_range: tuple[float, float]) -> None:
    """Raise ValueError unless (farthest, nearest) depth in dioptres is in order and not empty."""
    require_dioptres("depth_range", depth_range)
    if len(depth_range) != 2 or not depth_range[0] < depth_range[1]:
        raise ValueError(
            f"depth_range is {tuple(depth_range)}; give the farther depth first, then the nearer: "
            "two different numbers"
        )


def midpoint_dioptres(
    count: int, depth_range: tuple[float, float] = DEPTH_RANGE
) -> tuple[float, ...]:
    """Return the midpoints, in dioptres, of equal parts of a depth range, for a mean over depth.

    Parameters
    ----------
    count : int
        Number of parts, 1 or more.
    depth_range : tuple of (float, float), optional
        Farthest and nearest depth in dioptres.

    Returns
    -------
    tuple of float
        Depths in dioptres, from far to near.

    Raises
    ------
    ValueError
        If the count is below 1, or the range is empty or reversed.
    """
    _require_count_and_range(count, depth_range)
    return _in_parts([0.5] * count, depth_range)


def random_dioptres(
    count: int, generator: torch.Generator, depth_range: tuple[float, float] = DEPTH_RANGE
) -> tuple[float, ...]:
    """Draw independent depths in dioptres, uniform over a depth range.

    Parameters
    ----------
    count : int
        Number of depths, 1 or more.
    generator : torch.Generator
        Source of the random numbers.
    depth_range : tuple of (float, float), optional
        Farthest and nearest depth in dioptres.

    Returns
    -------
    tuple of float
        Depths in dioptres, in the order drawn.

    Raises
    ------
    ValueError
        If the count is below 1, or the range is empty or reversed.
    """
    _require_count_and_range(count, depth_range)
    low, high = depth_range
    drawn = torch.rand(count, generator=generator, dtype=torch.float64).tolist()
    return tuple(low + (high - low) * one for one in drawn)


def stratified_dioptres(
    count: int, generator: torch.Generator, depth_range: tuple[float, float] = DEPTH_RANGE
) -> tuple[float, ...]:
    """Draw one depth in dioptres from each of equal parts of a depth range, from far to near.

    A mean over these depths varies less from draw to draw than one over independent depths.
    Arguments and errors are those of `random_dioptres`.
    """
    _require_count_and_range(count, depth_range)
    drawn = torch.rand(count, generator=generator, dtype=torch.float64).tolist()
    return _in_parts(drawn, depth_range)


def find_undrawn(
    draw_index: Callable[[], int], count: int, *, miss_probability: float = 1e-9
) -> tuple[int, ...]:
    """Find the entries of a list of depths that a sampler never draws.

    A sampler such as ``int(u * (count - 1))`` never draws the last entry, so that the hardest
    distance is neither trained nor tested. Returns the indices that were never drawn, in order.
    Raises ValueError if the count is below 1, the probability isn't within 0 and 1, or an index is
    outside the list.

    draw_index: draws an index from 0 to `count` - 1; called without arguments.
    miss_probability: largest probability that a sampler which draws every entry equally often is
        accused.
    """
    require_count("count", count)
    if not 0 < miss_probability < 1:
        raise ValueError(f"miss_probability is {miss_probability:g}; give one between 0 and 1")
    missing = set(range(count))
    # That one of `count` entries is missed in n draws has a probability of count (1 - 1 / count)^n.
    enough = 1
    if count > 1:
        enough = math.ceil(math.log(miss_probability / count) / math.log1p(-1.0 / count))
    for _ in range(enough):
        if not missing:
            break
        index = draw_index()
        if not 0 <= index < count:
            raise ValueError(f"draw_index gave {index}; entries go from 0 to {count - 1}")
        missing.discard(index)
    return tuple(sorted(missing))


def _require_count_and_range(count: int, depth_range: tuple[float, float]) -> None:
    require_count("count", count)
    require_depth_range(depth_range)


def _in_parts(positions: list[float], depth_range: tuple[float, float]) -> tuple[float, ...]:
    """Return one depth in dioptres at a relative position, 0 to 1, in each part of a range."""
    low, high = depth_range
    width = (high - low) / len(positions)
    return tuple(low + width * (part + one) for part, one in enumerate(positions))
