"""The shrinkage operator of the penalty |v|^power, the proximal map of hyper-Laplacian priors."""

from __future__ import annotations

from functools import lru_cache

import torch

from optics.validation import accepts_numpy, as_floating_point, require_positive

_ENTRIES = 2048
"""Entries of the table; linear interpolation between them is accurate to 1e-6 of the length."""


def require_power(power: float) -> None:
    """Raise ValueError unless a deconvolution prior's power of gradients is above 0 and up to 1."""
    if not 0 < power <= 1:
        raise ValueError(f"power is {power:g}; give one above 0, up to 1")


@accepts_numpy
def shrink(value: torch.Tensor, power: float, coupling: float) -> torch.Tensor:
    """Shrink each value as a deconvolution's hyper-Laplacian prior requires.

    The result is the v that minimises ``|v|^power + coupling / 2 (v - value)²``. v is 0 up to a
    threshold of |value|. Beyond it, |v| is the largest root of v - |value| = -(power / coupling)
    v^(power - 1) (Krishnan and Fergus 2009, "Fast image deconvolution using hyper-Laplacian
    priors", NIPS 22). The result is accurate to 1e-6 of the value. Raises ValueError for a power
    outside 0 to 1, or a coupling that isn't positive.
    """
    require_power(power)
    require_positive("coupling", coupling, "")
    value = as_floating_point(value)
    return value * shrinkage_factor(value.square(), power, coupling)


def shrinkage_factor(squares: torch.Tensor, power: float, coupling: float) -> torch.Tensor:
    """Return the share of a gradient that a deconvolution prior's shrink() keeps.

    `squares` are the squared lengths of the gradients.
    """
    threshold, table = _shrinkage_table(power)
    table = table.to(squares)
    place = (squares + torch.finfo(squares.dtype).tiny).rsqrt_()
    place.mul_(threshold * coupling ** (-1 / (2 - power)) * _ENTRIES)
    lost = place > _ENTRIES
    # The table is indexed by the inverse length: infinity is at 0, and the threshold at the end.
    below = place.clamp_(max=_ENTRIES).long().clamp_(max=_ENTRIES - 1)
    share = torch.lerp(table[below], table[below + 1], place - below)
    return share.masked_fill_(lost, 0.0)


@lru_cache
def _shrinkage_table(power: float) -> tuple[float, torch.Tensor]:
    """Compute a deconvolution prior's shrinkage threshold, and a table of the shares kept.

    The threshold is for a coupling of 1. Entry i is the share that is kept of a gradient of length
    threshold / (i / _ENTRIES).
    """
    least = (2 * (1 - power)) ** (1 / (2 - power))
    threshold = least + power * least ** (power - 1) if power < 1 else 1.0
    part = torch.arange(1, _ENTRIES + 1, dtype=torch.float64) / _ENTRIES
    length = threshold / part
    root = length.clone()
    # Newton's method needs many steps: at the threshold, each step only halves the error.
    for _ in range(60):
        slope = 1 - power * (1 - power) * root ** (power - 2)
        root = root - (root - length + power * root ** (power - 1)) / slope
        root = root.clamp(min=max(least, 1e-12))
    return threshold, torch.cat([torch.ones(1, dtype=torch.float64), root / length])
