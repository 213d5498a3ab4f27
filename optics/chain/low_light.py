"""Correct error estimates for PSF windows that get little of the light.

An error that is a small share of all light may be a large share of the light in a dim window.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import torch

from optics.chain.edge_scatter import StopEdgeScatter


@dataclass(frozen=True)
class LowLightSettings:
    """Tune the error estimate of a PSF window that gets little light.

    Attributes
    ----------
    expected_window_light : float
        Share of the light behind an evenly lit panel that the window must get for an estimate made
        for that panel to hold. Chosen.
    low_light_exponent : float
        Exponent of a dim window's relative brightness, by which its error estimate is enlarged
        further. Light in a dim window comes from few directions of a pattern, so it is less even
        than the estimate assumes. Chosen.
    low_light_margin : float
        Factor on the divisor of a dim window's error estimate. Chosen: without it, three of 800
        gratings and waves on small panels exceeded their estimates, by a fifth at most.
    """

    expected_window_light: float = 0.8
    low_light_exponent: float = 1 / 8
    low_light_margin: float = 0.75


_SETTINGS = LowLightSettings()


class LowLightCorrection:
    """Finds the number by which an error estimate for an evenly lit panel must be divided.

    Such an estimate assumes that the panel sends the same light to all frequencies. A pattern may
    send less light to the window than an even panel, and more to the frequencies from which the
    stop's edge scatters light into the window. These frequencies may lie in the passing band, which
    goes through the stop beside the window, or far away. A pattern may also send light to the
    window smoothly, without speckles, and then the interference with scattered light counts more.

    window_slices: rows and columns of the window. light: the PSF, (..., rows, columns).
    measure_passing_brightness: a function that returns the panel's brightness in the passing band,
    relative to an even panel: the least and the greatest of a batch. It is called only if needed.
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
            # A window without any light allows no estimate.
            if float(each.min()) > 0:
                square = seen.shape[-2] * seen.shape[-1] * seen.square().sum(dim=(-2, -1))
                smooth = (square / each**2 / edge_scatter.normalised_second_moment).clamp(max=1.0)
                expected = _SETTINGS.expected_window_light
                self.brightness = float((each * smooth).min()) / even / expected

    @cached_property
    def _passing_brightness(self) -> tuple[float, float]:
        with torch.no_grad():
            return self._measure_passing_brightness()

    def error_divisor(self, within: float) -> float:
        """Return the number, at most 1, that divides the chain's error estimate in a dim window.

        within: share of the squared error that light in the passing band contributes.
        """
        most = within / self._passing_share + (1 - within) / (1 - self._passing_share)
        if self.brightness >= most:
            return 1.0
        least, brightest = self._passing_brightness
        beside = max(1 - least * self._passing_share, 0.0) / (1 - self._passing_share)
        wrong = within * brightest + (1 - within) * beside
        if not wrong > 0:
            return 1.0
        divisor = (
            min(1.0, math.sqrt(self.brightness / wrong))
            * min(1.0, self.brightness) ** _SETTINGS.low_light_exponent
        )
        return divisor * _SETTINGS.low_light_margin if divisor < 1 else 1.0

    @property
    def uniform_error_divisor(self) -> float:
        """The divisor, at most 1, of a chain's error estimate that holds for any pattern."""
        return min(1.0, math.sqrt(self.brightness))
