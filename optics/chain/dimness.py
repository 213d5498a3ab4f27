"""Windows that get little of the light: errors that are small shares of the rest count there."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cached_property

import torch

from optics.chain.edge_light import EdgeLight

_DIMMER = 0.8
"""Of the light behind an evenly lit panel: what a window must get for an estimate that counts on
that light."""

_DARKER = 1 / 8
"""Power of a dim window's brightness by which its error is trusted less: what gets into the dark
comes from few directions of a pattern, whose light isn't even."""


class Dimness:
    """By what errors for an evenly lit panel have to be divided for the light of a pattern.

    Such an error is a share of the light that the stop's edge may scatter, which an even panel
    sends everywhere. A pattern may send less of it to the window, and more to where the edge
    scatters it from: beside the window, but through the stop as well (light that `passes`), or
    nowhere near. And it may send it smoothly, without speckles: what beats with it counts more.

    inner: rows and columns of the window. light: (..., rows, columns). inside: brightness of the
    panel at frequencies that pass, over that of an even panel: the least and the most of a batch.
    It is called only where it matters.
    """

    def __init__(
        self,
        edge: EdgeLight,
        inner: tuple[slice, slice],
        light: torch.Tensor,
        amplitude: torch.Tensor | None,
        inside: Callable[[], tuple[float, float]],
    ) -> None:
        self._share = min(max(edge.passing_share, 1e-9), 1 - 1e-3)
        self._look = inside
        total = 1.0 if amplitude is None else float((amplitude.detach().abs() ** 2).mean())
        even = edge.window_share * total
        self.brightness = math.inf
        if light.numel() and even > 0:
            seen = light.detach()[..., inner[0], inner[1]]
            each = seen.sum(dim=(-2, -1))
            # Of a dark window nothing is known.
            if float(each.min()) > 0:
                square = seen.shape[-2] * seen.shape[-1] * seen.square().sum(dim=(-2, -1))
                smooth = (square / each**2 / edge.contrast).clamp(max=1.0)
                self.brightness = float((each * smooth).min()) / even / _DIMMER

    @cached_property
    def _inside(self) -> tuple[float, float]:
        with torch.no_grad():
            return self._look()

    def ratio(self, within: float) -> float:
        """Of an error of whose square light that passes makes the share `within`; 1 at most."""
        most = within / self._share + (1 - within) / (1 - self._share)
        if self.brightness >= most:
            return 1.0
        least, brightest = self._inside
        beside = max(1 - least * self._share, 0.0) / (1 - self._share)
        wrong = within * brightest + (1 - within) * beside
        if not wrong > 0:
            return 1.0
        return min(1.0, math.sqrt(self.brightness / wrong)) * min(1.0, self.brightness) ** _DARKER

    @property
    def even(self) -> float:
        """Of an error that every pattern makes alike; 1 at most."""
        return min(1.0, math.sqrt(self.brightness))
