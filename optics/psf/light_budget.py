"""Compute how much of a point's light passes the stop, is blocked, or reaches the window."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch

from optics.accuracy import ToleranceError
from optics.camera import Camera
from optics.camera.pupil import numeric_camera, open_area, pupil_amplitude
from optics.psf.dim_windows import normalise_amplitude
from optics.psf.edge_scatter import fresnel_area, stop_extent
from optics.psf.lens_grid import LensGrid, lens_plane, plan_propagator_axes
from optics.psf.light_on_pixels import LightOnPixels
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
    planned: LightOnPixels,
    phase: torch.Tensor | None,
    amplitude: torch.Tensor | None,
    unmodulated: float,
    window: float,
) -> LightBudget:
    """Compute where the light of a camera's panel goes, that without a phase included.

    Energy at the lens is the sum of ``|field|²`` over its samples, by Parseval's theorem, of all
    frequencies that get from any part of the panel to any part of the stop by geometric optics.

    phase, amplitude: of one pattern, on all pixels of the panel.
    unmodulated: share of the light that gets no phase from the panel.
    window: share of the light on the pixels that are asked for.
    """
    assert planned.camera is not None
    n, plain = planned.request.numeric, numeric_camera(planned.camera)
    amplitude, peak = normalise_amplitude(amplitude, 2)
    strongest = 1.0 if peak is None else float(peak)
    parts = [(1.0, phase)]
    if unmodulated and phase is not None:
        parts = [(1 - unmodulated, phase), (unmodulated, None)]
    fields = [(strongest**2 * share, _panel_field(planned, one, amplitude)) for share, one in parts]
    panel, passed = _panel_and_stop_light(n, plain, fields)
    axis = passed
    if any(n.field) and n.separation:
        axis = _panel_and_stop_light(replace(n, field=(0.0, 0.0)), plain, fields)[1]
    vignetting = passed / axis if axis > 0 else math.nan
    return LightBudget(panel, passed, panel - passed, window, vignetting)


def _panel_field(
    planned: LightOnPixels, phase: torch.Tensor | None, amplitude: torch.Tensor | None
) -> torch.Tensor:
    """Compute the field behind the panel of one pattern, complex64, (rows, columns)."""
    assert planned.camera is not None
    shape, sphere = planned.camera.panel.shape, planned.request.sphere
    factor = planned.engine.modulation_factor(phase, amplitude, shape, torch.complex64)
    if factor is None:
        factor = torch.ones(shape, dtype=torch.complex64)
    if factor.ndim != 2:
        raise ValueError(f"phase is {tuple(factor.shape)}; give one pattern, {shape}")
    if sphere is not None:
        factor = factor * sphere.wave_factor(*planned.engine.points()).to(factor)
    return factor.detach()


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
