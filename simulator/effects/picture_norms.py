"""Lower bounds and estimates of a picture's norms, which errors are relative to."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.ndimage import minimum_filter1d

from optics.camera.ghost import total_share
from optics.formation import spectrum_of_samples
from optics.plane import centred_crop
from optics.sensor.readout import row_starts
from optics.sensor.stages import max_contrast_loss
from simulator.effects.electron_bounds import area_change, peak_electrons
from simulator.effects.landed_light import detail_factor, landed_light
from simulator.effects.psf_bounds import (
    has_occlusion,
    is_uniform_scene,
)
from simulator.effects.result_cache import cached_across_exposures, cached_across_patterns
from simulator.effects.spectra import angle_shares, spectral_measure
from simulator.effects.vignetting_bounds import vignetting_samples
from simulator.formation.distorting import lateral_scales, moved_frame
from simulator.formation.dust_shadows import dust_shadows
from simulator.formation.vibration import image_vibration
from simulator.planning.effect import MinimumNorms
from simulator.probing.picture_probe import MARGIN
from simulator.probing.sampled_frequencies import RadialProfile
from simulator.situation import Situation
from simulator.speckle import speckle_variance


@dataclass(frozen=True)
class DustLosses:
    """Sums of the losses by dust over the pixels, each a share of a pixel's light.

    Shadows that overlap count as if they added up.
    deepest: of any pixel.
    total: of all.
    norm: root of the sum of squares.
    pixels: number that are shaded.
    """

    deepest: float
    total: float
    norm: float
    pixels: float


def dust_losses(s: Situation) -> DustLosses:
    """Return the losses by dust; all are 0 for a sensor without any."""
    sensor = s.camera.sensor
    if not sensor.dust:
        return DustLosses(0.0, 0.0, 0.0, 0.0)
    losses = [one.loss for one in dust_shadows(sensor, s.camera.lens)]
    left = math.prod(1 - float(one.max()) for one in losses)
    return DustLosses(
        1 - left,
        sum(float(one.sum()) for one in losses),
        sum(math.sqrt(float((one**2).sum())) for one in losses),
        float(sum(one.size for one in losses)),
    )


T = TypeVar("T")

_SHARES = (0.5, 0.3, 0.2, 0.1, 0.05)
"""Shares of a PSF's light that may fall beyond a square around its image; each gives a bound."""


def minimum_norms(s: Situation) -> MinimumNorms:
    """Bound the norms of mean, variance and σ over the sensor's pixels from below, in electrons.

    The norm of the mean is the largest of three bounds. First, a pixel has at least the light of
    the darkest place within the reach of its PSF. Second, the light that surely stays on the sensor
    has the least norm if it is uniform (Cauchy-Schwarz). Third, the least of the transfer function
    leaves at least so much of the sharp picture at each frequency. All attenuation counts. The
    noise is the shot noise of that light, with dark current and read noise. A full well counts with
    the electrons that it would hold if it were deeper: an overexposed picture is compared as if it
    weren't clipped.
    """
    sensor = s.camera.sensor
    pixels = sensor.shape[0] * sensor.shape[1]
    dark = sensor.dark_current * s.exposure
    total, norm = 0.0, 0.0
    if not s.picture_probe.is_dark:
        seconds = s.exposure * _min_lamp_light(s)
        total, norm = (
            seconds * one for one in cached_across_exposures(s, "floor", lambda: _min_light(s))
        )
        total, norm = _in_dusts_shadow(s, total, norm)
    noise = dark + sensor.read_noise**2
    found = MinimumNorms(
        math.hypot(norm, dark * math.sqrt(pixels)),
        math.hypot(norm, noise * math.sqrt(pixels)),
        math.sqrt(total + noise * pixels),
    )
    return _with_speckle(s, found, norm)


def _with_speckle(s: Situation, norms: MinimumNorms, light: float) -> MinimumNorms:
    """Add what speckle of variance v m² adds to the least norms of pictures, for a mean m.

    The norm of m² is least where all pixels are alike.
    light: least norm of m.
    """
    varied = speckle_variance(s)
    squared = varied * light**2
    even = squared / math.sqrt(math.prod(s.camera.sensor.shape))
    return MinimumNorms(
        norms.mean, math.hypot(norms.variance, even), math.sqrt(norms.sigma**2 + squared)
    )


def _in_dusts_shadow(s: Situation, total: float, norm: float) -> tuple[float, float]:
    """Return the least sum and norm of light that dust leaves, electrons."""
    losses = dust_losses(s)
    if not losses.deepest:
        return total, norm
    left, most = 1 - losses.deepest, peak_electrons(s)
    return max(left * total, total - losses.total * most), max(
        left * norm, norm - losses.norm * most
    )


def estimated_norms(s: Situation) -> MinimumNorms:
    """Estimate the norms that estimated errors are relative to.

    The norm of the mean is that of the sharp picture, whose power at each frequency falls by the
    mean square of the transfer function. The full wells count as in minimum_norms().
    """
    sensor = s.camera.sensor
    pixels = sensor.shape[0] * sensor.shape[1]
    dark = sensor.dark_current * s.exposure
    noise = dark + sensor.read_noise**2
    total, norm = (s.exposure * one for one in estimated_light(s))

    def with_offset(offset: float) -> float:
        return math.sqrt(norm**2 + 2 * offset * total + offset**2 * pixels)

    found = MinimumNorms(with_offset(dark), with_offset(noise), math.sqrt(total + noise * pixels))
    return _with_speckle(s, found, norm)


def estimated_light(s: Situation) -> tuple[float, float]:
    """Estimate the sum and norm of all light in the frame, electrons/s."""
    if s.picture_probe.is_dark:
        return 0.0, 0.0
    return cached_across_exposures(s, "estimated light", lambda: _estimated_light(s))


def estimated_light_share(s: Situation) -> float:
    """Estimate the share of the frame's light that vignetting, panel and colour filters leave."""
    distances = set(s.picture_probe.distances)
    seen = float(vignetting_samples(s, s.camera.sensor.shape, distances).mean())
    seen *= float(angle_shares(s).mean())
    return seen * _min_channel_share(s) * min(s.pattern_probe.min_relative_power, 1.0)


def _estimated_light(s: Situation) -> tuple[float, float]:
    """Compute what estimated_light() keeps."""
    power = _cached_for_margin(s, "power", 0, lambda edge: _power(s, _frame_without_edge(s, edge)))
    if power is None:
        return 0.0, 0.0
    left = estimated_light_share(s)
    if is_uniform_scene(s):
        # As much light is blurred into the frame as out of it.
        return left * s.picture_probe.total, left * math.sqrt(float(power.power.sum()))
    transfer = s.pattern_probe.transfer_bounds.mean_square_between(power.low, power.high)
    pixel = _pixel_power_gain(s, power.high)
    norm = math.sqrt(float((power.power * transfer * pixel).sum()))
    half = min(s.camera.sensor.shape) / 2 * s.camera.sensor.pitch
    kept = 1 - s.pattern_probe.share_beyond(half) / 2 - s.pattern_probe.side_order_share
    total = max(kept, 0.0) * s.picture_probe.total
    landed = landed_light(s)
    if landed is not None:
        total, norm = landed.total, min(norm, landed.norm * detail_factor(s))
    return left * total, left * (1 - total_share(s.camera.ghosts)) * norm


def _min_light(s: Situation) -> tuple[float, float]:
    """Bound the sum and norm of the frame's light from below, electrons per second."""
    # The factor 0.8 is from audits: it allows for effects that blur the picture further.
    attenuated, spread = 0.8 * _min_attenuation(s) / area_change(s), _min_light_by_area(s)
    # What ghosts take may fall beside the frame.
    attenuated *= 1 - total_share(s.camera.ghosts)
    total = max((one for one, _ in spread), default=0.0)
    norm = max((one / math.sqrt(area) for one, area in spread), default=0.0)
    return attenuated * total, attenuated * max(
        norm, _norm_by_frequency(s), _norm_by_neighbourhood(s)
    )


def _min_attenuation(s: Situation) -> float:
    """Return the least share of light that vignetting, angle, colour filters and panel leave.

    The colour filters' share is relative to the light of the best channel.
    """
    least = vignetting_samples(s, s.camera.sensor.shape, set(s.picture_probe.distances)).min()
    left = float(least) * float(angle_shares(s).min())
    return left * _min_channel_share(s) * min(s.pattern_probe.min_relative_power, 1.0)


def _min_channel_share(s: Situation) -> float:
    """Return the least share of electrons that colour filters leave the mean pixel.

    The minimum is over the scene's parts. The share is relative to the part's best channel.
    """
    colour = s.camera.sensor.colour
    if colour is None:
        return 1.0
    masses = spectral_measure(s, "band").electrons.sum(-1)[: len(colour.channels)]
    letters = "".join(colour.pattern)
    shares = np.array([letters.count(name) / len(letters) for name in colour.channels])
    best = masses.max(0)
    lit = best > 0
    if not lit.any():
        return 0.0
    relative = masses[:, lit] / best[lit]
    return float((shares @ relative).min())


def _min_lamp_light(s: Situation) -> float:
    """Return the least mean lamp light of any row's exposure, relative to the mean."""
    lamp = s.target.lamp
    if lamp is None or lamp.is_constant:
        return 1.0
    begins = row_starts(s.camera.sensor, s.exposure_start).numpy()
    return float(lamp.mean(begins, begins + s.exposure).min())


def _blur_margin(s: Situation, share: float) -> int:
    """Return the pixels beyond which blur sends less than `share` of a point's light.

    The image's motion is added. The result is rounded up to one of four values per octave, so that
    other patterns can use the same results of the picture.
    """
    reach = (
        s.pattern_probe.reach_of_share(share) * s.band.support[1] / s.wavelength
        + s.image_motion
        + moved_frame(s).reach
        + 3 * image_vibration(s)
    )
    pixels = max(reach / s.camera.sensor.pitch, 1.0) + (1.0 if s.camera.sensor.crosstalk else 0.0)
    return math.ceil(2 ** (math.ceil(4 * math.log2(pixels)) / 4))


def _cached_for_margin(s: Situation, what: str, edge: int, find: Callable[[int], T]) -> T:
    """Return a result of the sharp picture alone, computed once for each edge width."""
    causes = (what, edge, s.camera.sensor.shape)
    return cached_across_patterns(s, causes, lambda: find(edge))


def _frame_without_edge(s: Situation, edge: int) -> torch.Tensor:
    """Return the sharp picture, set to zero outside the frame and on an edge within it.

    edge: pixels of the frame that are set to zero on each side.
    """
    rows, columns = s.camera.sensor.shape
    picture = s.picture_probe.sharp_picture
    y, x = ((n - m) // 2 + edge for n, m in zip(picture.shape, (rows, columns), strict=True))
    kept = torch.zeros_like(picture)
    if rows > 2 * edge and columns > 2 * edge:
        part = slice(y, y + rows - 2 * edge), slice(x, x + columns - 2 * edge)
        kept[part] = picture[part].clamp(min=0)
    return kept


def _min_light_by_area(s: Situation) -> list[tuple[float, float]]:
    """Return pairs (light, pixels): light that blur surely leaves on so many pixels."""
    found = []
    for share in _SHARES:
        edge = _blur_margin(s, share)
        total, sides = _cached_for_margin(
            s, "lit", edge, lambda edge: _sum_and_sides(_frame_without_edge(s, edge))
        )
        if not total:
            continue
        kept = 1 - share - s.pattern_probe.side_order_share
        frame = zip(s.camera.sensor.shape, sides, strict=True)
        wide = [min(n, side + 2 * edge + 2) for n, side in frame]
        found.append((max(kept, 0.0) * total, float(wide[0] * wide[1])))
    return found


def _sum_and_sides(light: torch.Tensor) -> tuple[float, tuple[int, int]]:
    """Return a picture's sum, and how many rows and columns its light spans."""
    rows, columns = (light > 0).any(1).nonzero(), (light > 0).any(0).nonzero()
    if not len(rows):
        return 0.0, (0, 0)
    sides = tuple(int(one[-1] - one[0]) + 1 for one in (rows, columns))
    return float(light.sum(dtype=torch.float64)), (sides[0], sides[1])


def _norm_by_neighbourhood(s: Situation) -> float:
    """Bound the norm from below by the least light within the PSF's reach of each pixel.

    It is in electrons per second.
    """
    if has_occlusion(s):
        return 0.0
    best = 0.0
    for share in _SHARES:
        edge = _blur_margin(s, share)
        if edge <= MARGIN:
            kept = max(1 - share - s.pattern_probe.side_order_share, 0.0)
            best = max(
                best,
                kept
                * _cached_for_margin(
                    s, "least", edge, lambda edge: _neighbourhood_min_norm(s, edge)
                ),
            )
    return best


def _neighbourhood_min_norm(s: Situation, edge: int) -> float:
    """Return the frame's norm with the least light up to `edge` pixels away, along each axis."""
    least = s.picture_probe.sharp_picture.clamp(min=0).numpy()
    for axis in (0, 1):
        least = minimum_filter1d(least, 2 * edge + 1, axis, mode="constant")
    frame = centred_crop(torch.from_numpy(least), s.camera.sensor.shape)
    return float(torch.linalg.vector_norm(frame, dtype=torch.float64))


def _norm_by_frequency(s: Situation) -> float:
    """Bound the norm that blur leaves from below by the transfer function, electrons per second."""
    if s.target.is_moving or has_occlusion(s):
        return 0.0
    transfer, best = s.pattern_probe.transfer_bounds, 0.0
    for share in _SHARES[2:]:
        edge = _blur_margin(s, share)
        power = _cached_for_margin(
            s, "power", edge, lambda edge: _power(s, _frame_without_edge(s, edge))
        )
        if power is None:
            continue
        least = transfer.least_between(power.low, power.high)
        mean = transfer.mean_square_between(power.low, power.high)
        pixel = _pixel_power_gain(s, power.high)
        squares = np.maximum(power.power * least**2, power.least * mean) * pixel
        # At most `share` of the light falls beyond the frame.
        best = max(best, math.sqrt(float(squares.sum())) * (1 - share))
    return best


def _pixel_power_gain(s: Situation, k: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the least share of power that pixels, colours and vibration leave at k cycles/m."""
    sensor = s.camera.sensor
    gain = np.clip(1 - (np.pi * k * sensor.pitch) ** 2 / 3, 0, 1)
    if sensor.crosstalk:
        gain = gain * (1 - max_contrast_loss(sensor.crosstalk, k, sensor.pitch)) ** 2
    low, high = lateral_scales(s)
    if low != high:
        # Colours lie apart by so much in the corners, to either side of their middle.
        apart = (high - low) / 2 * math.hypot(*sensor.shape) * sensor.pitch / 2
        gain = gain * np.clip(1 - 2 * np.pi * k * apart, 0, 1) ** 2
    if s.camera.vibration:
        gain = gain * np.exp(-((2 * np.pi * image_vibration(s) * k) ** 2))
    return gain


def _power(s: Situation, light: torch.Tensor) -> RadialProfile | None:
    """Return a picture's radial power spectrum; None without light."""
    return (
        RadialProfile.of(spectrum_of_samples(light), s.picture_probe.plane) if light.any() else None
    )
