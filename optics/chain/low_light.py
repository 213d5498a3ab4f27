"""Windows that get little of the light: errors that are small shares of the rest count there."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cached_property

import torch

from optics.chain.edge_scatter import StopEdgeScatter

_EXPECTED_WINDOW_LIGHT = 0.8
"""Of the light behind an evenly lit panel: what a window must get for an estimate that counts on
that light."""

_LOW_LIGHT_EXPONENT = 1 / 8
"""Power of a dim window's brightness by which its error is trusted less: what gets into the dark
comes from few directions of a pattern, whose light isn't even."""


class LowLightCorrection:
    """By what errors for an evenly lit panel have to be divided for the light of a pattern.

    Such an error is a share of the light that the stop's edge may scatter, which an even panel
    sends everywhere. A pattern may send less of it to the window, and more to where the edge
    scatters it from: beside the window, but through the stop as well (light that passes), or
    nowhere near. And it may send it smoothly, without speckles: what beats with it counts more.

    window_slices: rows and columns of the window. light: (..., rows, columns).
    measure_passing_brightness: brightness of the panel at frequencies that pass, over that of an
    even panel: the least and the most of a batch. It is called only where it matters.
    """

    def __init__(
        self,
        edge_scatter: StopEdgeScatter,
        window_slices: tuple[slice, slice],
        light: torch.Tensor,
        amplitude: torch.Tensor | None,
        measure_passing_brightness: Callable[[], tuple[float, float]],
    ) -> None:
        self._passing_share = min(max(edge_scatter.passing_share, 1e-9), 1 - 1e-3)
        self._measure_passing_brightness = measure_passing_brightness
        total = 1.0 if amplitude is None else float((amplitude.detach().abs() ** 2).mean())
        even = edge_scatter.window_share * total
        self.brightness = math.inf
        if light.numel() and even > 0:
            seen = light.detach()[..., window_slices[0], window_slices[1]]
            each = seen.sum(dim=(-2, -1))
            # Of a dark window nothing is known.
            if float(each.min()) > 0:
                square = seen.shape[-2] * seen.shape[-1] * seen.square().sum(dim=(-2, -1))
                smooth = (square / each**2 / edge_scatter.normalised_second_moment).clamp(max=1.0)
                self.brightness = float((each * smooth).min()) / even / _EXPECTED_WINDOW_LIGHT

    @cached_property
    def _passing_brightness(self) -> tuple[float, float]:
        with torch.no_grad():
            return self._measure_passing_brightness()

    def error_divisor(self, within: float) -> float:
        """Of an error of whose square light that passes makes the share `within`; 1 at most."""
        most = within / self._passing_share + (1 - within) / (1 - self._passing_share)
        if self.brightness >= most:
            return 1.0
        least, brightest = self._passing_brightness
        beside = max(1 - least * self._passing_share, 0.0) / (1 - self._passing_share)
        wrong = within * brightest + (1 - within) * beside
        if not wrong > 0:
            return 1.0
        return (
            min(1.0, math.sqrt(self.brightness / wrong))
            * min(1.0, self.brightness) ** _LOW_LIGHT_EXPONENT
        )

    @property
    def uniform_error_divisor(self) -> float:
        """Of an error that every pattern makes alike; 1 at most."""
        return min(1.0, math.sqrt(self.brightness))
