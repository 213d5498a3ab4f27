"""Lower bounds and estimates of a picture's norms, which errors are relative to."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.ndimage import minimum_filter1d

from optics.camera.ghost import total_share
from optics.formation import spectrum_of_samples
from optics.plane import centred_crop
from optics.sensor.readout import row_starts
from optics.sensor.stages import max_contrast_loss
from simulator.effects.electron_bounds import (
    area_change,
    dark_current_electrons,
    peak_electrons,
    pixel_count,
    sqrt_pixel_count,
)
from simulator.effects.landed_light import detail_factor, landed_light
from simulator.effects.psf_bounds import has_occlusion, is_uniform_scene
from simulator.effects.result_cache import cached_across_exposures, cached_across_patterns
from simulator.effects.spectra import angle_shares, spectral_measure
from simulator.effects.vignetting_bounds import vignetting_samples
from simulator.formation.distorting import lateral_scales, moved_frame
from simulator.formation.dust_shadows import dust_shadows
from simulator.formation.mean_picture import image_vibration
from simulator.planning.effect import MinimumNorms
from simulator.probing.picture_probe import MARGIN
from simulator.probing.sampled_frequencies import RadialProfile
from simulator.situation import Situation
from simulator.speckle import speckle_variance


class DustLosses(NamedTuple):
    """Sums over pixels of the shares of light that dust takes, as if shadows added up."""

    deepest: float  # of any pixel
    total: float
    norm: float  # root of the sum of squares
    pixels: float  # number that are shaded


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


def minimum_norms(s: Situation) -> MinimumNorms:
    """Bound the norms of mean, variance and σ over the sensor's pixels from below, in electrons.

    The norm of the mean is the largest of three bounds. First, a pixel has at least the light of
    the darkest place within the reach of its PSF. Second, the light that surely stays on the sensor
    has the least norm if it is uniform (Cauchy-Schwarz). Third, the least of the transfer function
    leaves at least so much of the sharp picture at each frequency. The noise is the shot noise of
    that light, with dark current and read noise. An overexposed picture is compared as if it
    weren't clipped.
    """
    sensor, pixels = s.camera.sensor, pixel_count(s)
    dark = dark_current_electrons(s)
    total, norm = 0.0, 0.0
    if not s.picture_probe.is_dark:
        seconds, lamp = s.exposure, s.target.lamp
        if lamp is not None and not lamp.is_constant:
            begins = row_starts(sensor, s.exposure_start).numpy()
            seconds *= float(lamp.mean(begins, begins + s.exposure).min())
        total, norm = (seconds * one for one in _min_light(s))
        losses = dust_losses(s)
        if losses.deepest:
            left, most = 1 - losses.deepest, peak_electrons(s)
            total = max(left * total, total - losses.total * most)
            norm = max(left * norm, norm - losses.norm * most)
    noise = dark + sensor.read_noise**2
    found = MinimumNorms(
        math.hypot(norm, dark * math.sqrt(pixels)),
        math.hypot(norm, noise * math.sqrt(pixels)),
        math.sqrt(total + noise * pixels),
    )
    return _with_speckle(s, found, norm)


def _with_speckle(s: Situation, norms: MinimumNorms, light: float) -> MinimumNorms:
    """Add what speckle of variance v m² adds to the least norms of pictures, for a mean m.

    The norm of m² is least where all pixels are alike. light: least norm of m.
    """
    squared = speckle_variance(s) * light**2
    variance = math.hypot(norms.variance, squared / sqrt_pixel_count(s))
    return MinimumNorms(norms.mean, variance, math.sqrt(norms.sigma**2 + squared))


def estimated_norms(s: Situation) -> MinimumNorms:
    """Estimate the norms that estimated errors are relative to.

    The norm of the mean is that of the sharp picture, whose power at each frequency falls by the
    mean square of the transfer function. Full wells count as in minimum_norms().
    """
    pixels, dark = pixel_count(s), dark_current_electrons(s)
    noise = dark + s.camera.sensor.read_noise**2
    total, norm = (s.exposure * one for one in estimated_light(s))

    def with_offset(offset: float) -> float:
        return math.sqrt(norm**2 + 2 * offset * total + offset**2 * pixels)

    found = MinimumNorms(with_offset(dark), with_offset(noise), math.sqrt(total + noise * pixels))
    return _with_speckle(s, found, norm)


def light_share(s: Situation, *, least: bool = False) -> float:
    """Return the mean or least share of light that vignetting, filters and panel leave."""
    distances = set(s.picture_probe.distances)
    seen, passed = vignetting_samples(s, s.camera.sensor.shape, distances), angle_shares(s)
    left = float(seen.min() if least else seen.mean())
    left *= float(passed.min() if least else passed.mean())
    return left * _min_channel_share(s) * min(s.pattern_probe.min_relative_power, 1.0)


@cached_across_exposures
def estimated_light(s: Situation) -> tuple[float, float]:
    """Estimate the sum and norm of all light in the frame, electrons/s."""
    power = None if s.picture_probe.is_dark else _power_within(s, 0)
    if power is None:
        return 0.0, 0.0
    left = light_share(s)
    if is_uniform_scene(s):
        # As much light is blurred into the frame as out of it.
        return left * s.picture_probe.total, left * math.sqrt(float(power.power.sum()))
    probe = s.pattern_probe
    transfer = probe.transfer_bounds.mean_square_between(power.low, power.high)
    norm = math.sqrt(float((power.power * transfer * _pixel_power_gain(s, power.high)).sum()))
    half = min(s.camera.sensor.shape) / 2 * s.camera.sensor.pitch
    kept = 1 - probe.share_beyond(half) / 2 - probe.side_order_share
    total = max(kept, 0.0) * s.picture_probe.total
    landed = landed_light(s)
    if landed is not None:
        total, norm = landed.total, min(norm, landed.norm * detail_factor(s))
    return left * total, left * (1 - total_share(s.camera.ghosts)) * norm


@cached_across_exposures
def _min_light(s: Situation) -> tuple[float, float]:
    """Bound the sum and norm of the frame's light from below, electrons/s, in several ways."""
    pattern, occluded, total, norm = s.pattern_probe, has_occlusion(s), 0.0, 0.0
    for share in (0.5, 0.3, 0.2, 0.1, 0.05):
        edge, kept = _blur_margin(s, share), max(1 - share - pattern.side_order_share, 0.0)
        lit, sides = _lit_within(s, edge)
        if lit:
            frame = zip(s.camera.sensor.shape, sides, strict=True)
            area = math.prod(min(n, side + 2 * edge + 2) for n, side in frame)
            total, norm = max(total, kept * lit), max(norm, kept * lit / math.sqrt(area))
        if edge <= MARGIN and not occluded:
            norm = max(norm, kept * _neighbourhood_min_norm(s, edge))
        if share > 0.2 or s.target.is_moving or occluded:
            continue
        if (power := _power_within(s, edge)) is not None:
            least = pattern.transfer_bounds.least_between(power.low, power.high)
            mean = pattern.transfer_bounds.mean_square_between(power.low, power.high)
            squares = np.maximum(power.power * least**2, power.least * mean)
            passed = float((squares * _pixel_power_gain(s, power.high)).sum())
            # At most `share` of the light falls beyond the frame.
            norm = max(norm, math.sqrt(passed) * (1 - share))
    # The factor 0.8 is from audits: it allows for effects that blur the picture further.
    attenuated = 0.8 * light_share(s, least=True) / area_change(s)
    # What ghosts take may fall beside the frame.
    attenuated *= 1 - total_share(s.camera.ghosts)
    return attenuated * total, attenuated * norm


def _min_channel_share(s: Situation) -> float:
    """Return the least electrons of the mean pixel over those of the best channel, of any part."""
    colour = s.camera.sensor.colour
    if colour is None:
        return 1.0
    masses = spectral_measure(s, "band").electrons.sum(-1)[: len(colour.channels)]
    letters = "".join(colour.pattern)
    shares = np.array([letters.count(name) / len(letters) for name in colour.channels])
    best = masses.max(0)
    lit = best > 0
    return float((shares @ (masses[:, lit] / best[lit])).min()) if lit.any() else 0.0


def _blur_margin(s: Situation, share: float) -> int:
    """Return the pixels beyond which blur sends less than `share` of a point's light.

    The image's motion is added. The result is rounded up to one of four values per octave, so that
    other patterns can use the same results of the picture.
    """
    reach = s.pattern_probe.reach_of_share(share) * s.band.support[1] / s.wavelength
    reach = reach + s.image_motion + moved_frame(s).reach + 3 * image_vibration(s)
    pixels = max(reach / s.camera.sensor.pitch, 1.0) + (1.0 if s.camera.sensor.crosstalk else 0.0)
    return math.ceil(2 ** (math.ceil(4 * math.log2(pixels)) / 4))


def _frame_without_edge(s: Situation, edge: int) -> torch.Tensor:
    """Return the sharp picture, but zero outside the frame and on an edge of pixels within it."""
    rows, columns = s.camera.sensor.shape
    picture = s.picture_probe.sharp_picture
    kept = torch.zeros_like(picture)
    if rows > 2 * edge and columns > 2 * edge:
        first = MARGIN + edge
        part = slice(first, MARGIN + rows - edge), slice(first, MARGIN + columns - edge)
        kept[part] = picture[part].clamp(min=0)
    return kept


@cached_across_patterns
def _lit_within(s: Situation, edge: int) -> tuple[float, tuple[int, int]]:
    """Return the frame's sum without an edge, and how many rows and columns its light spans."""
    light = _frame_without_edge(s, edge)
    rows, columns = (light > 0).any(1).nonzero(), (light > 0).any(0).nonzero()
    if not len(rows):
        return 0.0, (0, 0)
    sides = tuple(int(one[-1] - one[0]) + 1 for one in (rows, columns))
    return float(light.sum(dtype=torch.float64)), (sides[0], sides[1])


@cached_across_patterns
def _neighbourhood_min_norm(s: Situation, edge: int) -> float:
    """Return the frame's norm with the least light up to `edge` pixels away, along each axis."""
    least = s.picture_probe.sharp_picture.clamp(min=0).numpy()
    for axis in (0, 1):
        least = minimum_filter1d(least, 2 * edge + 1, axis, mode="constant")
    frame = centred_crop(torch.from_numpy(least), s.camera.sensor.shape)
    return float(torch.linalg.vector_norm(frame, dtype=torch.float64))


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


@cached_across_patterns
def _power_within(s: Situation, edge: int) -> RadialProfile | None:
    """Return the power spectrum of the frame without an edge; None without light."""
    light = _frame_without_edge(s, edge)
    if not light.any():
        return None
    return RadialProfile.of(spectrum_of_samples(light), s.picture_probe.plane)
