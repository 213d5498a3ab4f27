"""Compute how much of a point's light passes the stop, is blocked, or reaches the window.

Error estimates of windows that get little of it are corrected.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import torch

from optics.accuracy import ToleranceError
from optics.camera import Camera
from optics.camera.pupil import numeric_camera, open_area, pupil_amplitude
from optics.psf.edge_scatter import StopEdgeScatter, fresnel_area, stop_extent
from optics.psf.lens_grid import LensGrid, lens_plane, plan_propagator_axes
from optics.psf.request import PSFRequest
from optics.psf.stop_mask import BlockwiseStopMask
from optics.psf.to_lens import PanelToLensPropagator


@dataclass(frozen=True)
class LightBudget:
    """Holds where a point's light goes: through the stop, to the window, or blocked.

    The shares are in the units of a PSF: shares of what panel and stop would pass on the axis if
    they stood in one plane.

    panel: light that leaves the panel's pixels.
    through_stop: light that passes the stop.
    blocked: light that meets the stop's blades or goes past them.
    window: light on the pixels that are asked for.
    vignetting: `through_stop` over what would pass for a point on the axis.
    """

    panel: float
    through_stop: float
    blocked: float
    window: float
    vignetting: float


def compute_light_budget(
    request: PSFRequest,
    camera: Camera,
    fields: Sequence[tuple[float, torch.Tensor]],
    window: float,
) -> LightBudget:
    """Compute where the light of a panel goes, for fields that add in intensity.

    Energy at the lens is the sum of ``|field|²`` over its samples, by Parseval's theorem, of all
    frequencies that get from any part of the panel to any part of the stop by geometric optics.

    fields: shares of the light, and complex fields (rows, columns) of the panel.
    window: share of the light on the pixels that are asked for.
    """
    n, plain = request.numeric, numeric_camera(camera)
    panel, passed = _panel_and_stop_light(n, plain, fields)
    axis = passed
    if any(n.field) and n.separation:
        axis = _panel_and_stop_light(replace(n, field=(0.0, 0.0)), plain, fields)[1]
    return LightBudget(
        panel, passed, panel - passed, window, passed / axis if axis > 0 else math.nan
    )


def _panel_and_stop_light(
    n: PSFRequest, camera: Camera, fields: Sequence[tuple[float, torch.Tensor]]
) -> tuple[float, float]:
    parts = [(share, _light_through_stop(n, camera, field)) for share, field in fields]
    leaving = sum(share * panel for share, (panel, _) in parts)
    return leaving, sum(share * passed for share, (_, passed) in parts)


def _light_through_stop(n: PSFRequest, camera: Camera, field: torch.Tensor) -> tuple[float, float]:
    """Return the shares of the light that leave the panel and that pass the stop."""
    light = (field.real**2 + field.imag**2).to(torch.float64)
    pixel = camera.panel.pitch**2 / open_area(camera)
    panel = float(light.sum()) * pixel
    if not n.separation:
        return panel, float((light * pupil_amplitude(camera)).sum()) * pixel
    try:
        return panel, _light_at_lens(n, camera, field)
    except ToleranceError:
        # By geometric optics, no light of the panel reaches the stop.
        return panel, 0.0


def _light_at_lens(n: PSFRequest, camera: Camera, field: torch.Tensor) -> float:
    """Return the share of the light that passes the stop at the lens."""
    grid, followed = _reachable_lens_grid(n, camera)
    axes = plan_propagator_axes(n, camera, grid)
    propagator, plane = PanelToLensPropagator(axes[0], axes[1], field.dtype), lens_plane(n, axes)
    real = torch.zeros((), dtype=field.dtype).real.dtype
    openings = BlockwiseStopMask(camera.lens.stop, n.radius, plane, real)
    arriving = propagator.fields_at_lens(propagator.spectrum(field), openings.row_blocks)
    power = sum(openings.open_power(part, block) for block, (_, part) in enumerate(arriving))
    area = plane.pitch[0] * plane.pitch[1] / float(n.shadow_magnification) ** 2
    return power * area / (open_area(camera) * camera.panel.fill_factor) / followed


def _reachable_lens_grid(n: PSFRequest, camera: Camera) -> tuple[LensGrid, float]:
    """Plan a lens grid for all panel frequencies that reach the stop.

    Returns the grid, and the share of a panel pixel's light that it includes.
    """
    bend = fresnel_area(n)
    # 16 orders of a pixel's own diffraction are followed to either side. If the stop is wide
    # enough, about 1 % of the light lies beyond. It is assumed to pass in the same proportion.
    most, low, high, followed = 16.0 / camera.panel.active_side, [], [], 1.0
    for axis in (0, 1):
        line = camera.panel.plane.coordinates(axis)
        half = camera.panel.pitch / 2
        shift = float(n.chief_ray_slopes[axis]) * n.separation
        stop = [
            place * n.radius / float(n.shadow_magnification) - shift
            for place in stop_extent(camera, axis)
        ]
        zone = 1 / math.sqrt(bend)
        first = (stop[0] - float(line[-1]) - half) / bend - zone
        last = (stop[1] - float(line[0]) + half) / bend + zone
        low.append(max(first, -most))
        high.append(min(last, most))
        if first < -most or last > most:
            followed *= _pixel_light_share(camera, max(first, -most), min(last, most))
    # With at least 1024 samples across the stop, the noise of speckles averages out.
    rate = 1024 / (2 * n.radius)
    return LensGrid((low[0], low[1]), (high[0], high[1]), (rate, rate), 0.0), followed


def _pixel_light_share(camera: Camera, low: float, high: float) -> float:
    """Return the share of its light that a pixel sends between two frequencies along one axis.

    low, high: cycles per metre.
    """
    f = torch.linspace(low, high, 20001, dtype=torch.float64) * camera.panel.active_side
    return float(torch.trapezoid(torch.sinc(f) ** 2, f))


@dataclass(frozen=True)
class LowLightSettings:
    """Tune the error estimate of a window that gets little light.

    expected_window_light: share of the light behind an evenly lit panel that the window must get
    for an estimate made for that panel to hold. Chosen.
    low_light_exponent: exponent of a dim window's relative brightness, by which its error estimate
    is enlarged further: light in a dim window comes from few directions of a pattern, so it is less
    even than the estimate assumes. Chosen.
    low_light_margin: factor on the divisor of a dim window's error estimate. Chosen: without it,
    three of 800 gratings and waves on small panels exceeded their estimates, by a fifth at most.
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

    window_slices: rows and columns of the window.
    light: (..., rows, columns).
    measure_passing_brightness: returns the panel's brightness in the passing band, relative to an
    even panel: the least and the greatest of a batch. It is called only if needed.
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
        """Return the number, at most 1, that divides the error estimate in a dim window.

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
        """The divisor, at most 1, of an error estimate that holds for any pattern."""
        return min(1.0, math.sqrt(self.brightness))
