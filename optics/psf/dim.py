"""Windows that get little of the light: errors that are small shares of the rest count there."""

from __future__ import annotations

import math
from collections.abc import Callable

import torch

from optics.psf.edge_light import EdgeLight

_DIMMER = 0.8
"""Of the light behind an evenly lit panel: what a window must get for an estimate that counts on
that light."""


def shortfall(
    edge: EdgeLight,
    inner: tuple[slice, slice],
    light: torch.Tensor,
    amplitude: torch.Tensor | None,
    leaving: Callable[[], torch.Tensor],
) -> float:
    """By what an error of an evenly lit panel has to be divided for this light; 1 at the most.

    An error is a share of the light that the stop's edge may scatter, which an even panel sends
    everywhere; a smooth pattern sends less of it. inner: rows and
    columns of the window. light: (..., rows, columns). leaving: makes the panel's field; it is
    called only where it matters.
    """
    total = 1.0 if amplitude is None else float((amplitude.detach().abs() ** 2).mean())
    even = edge.window_share * total
    if not (light.numel() and even > 0):
        return 1.0
    rows, columns = inner
    least = float(light.detach()[..., rows, columns].sum(dim=(-2, -1)).min())
    brightness = least / even / _DIMMER
    if not 0 < brightness < 1:
        return 1.0
    with torch.no_grad():
        rest = min(1.0, edge.rest(leaving()))
    return math.sqrt(min(1.0, brightness / rest)) if rest > 0 else 1.0
