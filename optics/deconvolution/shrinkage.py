"""What is left of a length when its power has a price."""

from __future__ import annotations

from functools import lru_cache

import torch

from optics.validation import accepts_numpy, as_floating_point, require_positive

_ENTRIES = 2048
"""Of the table, between which it is read off straight: to 1e-6 of the length."""

_STEPS = 60
"""Of Newton's method, per entry: at the threshold's own root it halves the error only."""


def require_power(power: float) -> None:
    """Raise ValueError for a power that isn't above 0, up to 1."""
    if not 0 < power <= 1:
        raise ValueError(f"power is {power:g}; give one above 0, up to 1")


@accepts_numpy
def shrink(value: torch.Tensor, power: float, coupling: float) -> torch.Tensor:
    """The v with the least |v|^power + coupling / 2 (v - value)², for each value.

    Zero up to a threshold; beyond it the largest root of v - |value| = -(power / coupling)
    v^(power - 1) (Krishnan and Fergus 2009, "Fast image deconvolution using hyper-Laplacian
    priors", NIPS 22), to 1e-6 of the value. Raises ValueError for a power outside 0 to 1, or a
    coupling that isn't positive.
    """
    require_power(power)
    require_positive("coupling", coupling, "")
    value = as_floating_point(value)
    return value * shrinkage_factor(value.square(), power, coupling)


def shrinkage_factor(squares: torch.Tensor, power: float, coupling: float) -> torch.Tensor:
    """The share of a length that shrink() leaves, of the length's square."""
    threshold, table = _table(power)
    table = table.to(squares)
    place = (squares + torch.finfo(squares.dtype).tiny).rsqrt_()
    place.mul_(threshold * coupling ** (-1 / (2 - power)) * _ENTRIES)
    lost = place > _ENTRIES
    # Lengths are told apart by their inverse: from endless ones at 0 to the threshold at the end.
    below = place.clamp_(max=_ENTRIES).long().clamp_(max=_ENTRIES - 1)
    share = torch.lerp(table[below], table[below + 1], place - below)
    return share.masked_fill_(lost, 0.0)


@lru_cache
def _table(power: float) -> tuple[float, torch.Tensor]:
    """For a coupling of 1: the threshold, and the share that is kept of it over 0, 1, ... of as
    many parts as the table has."""
    least = (2 * (1 - power)) ** (1 / (2 - power))
    threshold = least + power * least ** (power - 1) if power < 1 else 1.0
    part = torch.arange(1, _ENTRIES + 1, dtype=torch.float64) / _ENTRIES
    length = threshold / part
    root = length.clone()
    for _ in range(_STEPS):
        slope = 1 - power * (1 - power) * root ** (power - 2)
        root = root - (root - length + power * root ** (power - 1)) / slope
        root = root.clamp(min=max(least, 1e-12))
    return threshold, torch.cat([torch.ones(1, dtype=torch.float64), root / length])
