"""Merge an exposure bracket into one HDR radiance estimate with variance and state."""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple

import torch

from optics.camera import Sensor
from optics.validation import require_finite


class PixelState(IntEnum):
    """State of a merged pixel in a radiance estimate.

    VALID pixels are measured. CLIPPED pixels are clipped in every exposure, so that the value is
    a lower bound. DARK pixels are below three standard deviations of their noise, so that three
    standard deviations are an upper bound.
    """

    VALID = 0
    CLIPPED = 1
    DARK = 2


VALID, CLIPPED, DARK = PixelState


class RadianceEstimate(NamedTuple):
    """Hold the radiance estimate of a merged exposure bracket, one value per pixel.

    rate: electrons per second. variance: that of the rate. state: numbers of `PixelState`, uint8.
    """

    rate: torch.Tensor
    variance: torch.Tensor
    state: torch.Tensor


def merge_bracket(
    frames: torch.Tensor,
    exposures: torch.Tensor,
    darks: torch.Tensor,
    dark_counts: torch.Tensor,
    sensor: Sensor,
) -> RadianceEstimate:
    """Merge an exposure bracket into an HDR radiance estimate, weighted by inverse variance.

    frames: (exposures, rows, columns), digital numbers. exposures: seconds. darks: mean of
    the dark frames of each exposure, the same shape as frames. dark_counts: number of dark frames
    in each mean. The weights follow Granados et al. (CVPR 2010, doi
    10.1109/CVPR.2010.5540208): the variance of an exposure is the sum of those of its photons, its
    dark current, the read noise, quantisation, and the subtracted dark frame. The photon
    variance is predicted from the merged value itself, in two passes.
    Raises ValueError for exposures that aren't positive, numbers that aren't finite, or
    shapes that don't match.
    """
    if exposures.numel() == 0:
        raise ValueError("there are no exposures to merge; give at least one")
    if frames.shape != darks.shape or frames.shape[0] != exposures.numel():
        raise ValueError(
            f"frames {tuple(frames.shape)}, darks {tuple(darks.shape)} and "
            f"{exposures.numel()} exposures don't match"
        )
    if not (exposures > 0).all():
        raise ValueError(f"exposures are {exposures.tolist()} s; all must be positive")
    if dark_counts.shape != exposures.shape or not (dark_counts >= 1).all():
        raise ValueError(f"dark_counts are {dark_counts.tolist()}; each exposure needs at least 1")
    require_finite("frames", frames)
    require_finite("darks", darks)
    t = exposures.to(torch.float64)[:, None, None]
    n = dark_counts.to(torch.float64)[:, None, None]
    usable = frames < sensor.full_scale
    electrons = (frames.to(torch.float64) - darks.to(torch.float64)) * sensor.gain
    floor = sensor.read_noise**2 + sensor.gain**2 / 12 + sensor.dark_current * t
    rate = _least_squares_rate(electrons, t, usable / floor)
    for _ in range(2):
        weight = usable / (rate.clamp(min=0) * t + floor * (1 + 1 / n))
        rate = _least_squares_rate(electrons, t, weight)
    information = (weight * t**2).sum(0)
    seen = information > 0
    variance = torch.where(seen, 1 / information.masked_fill(~seen, 1), torch.inf)
    shortest = int(torch.argmin(exposures))
    bound = electrons[shortest] / exposures[shortest]
    rate = torch.where(seen, rate, bound)
    state = torch.where(rate < 3 * variance.sqrt(), DARK, VALID)
    return RadianceEstimate(rate, variance, torch.where(seen, state, CLIPPED).to(torch.uint8))


def _least_squares_rate(
    electrons: torch.Tensor, t: torch.Tensor, weight: torch.Tensor
) -> torch.Tensor:
    """Fit each HDR pixel's rate, electrons = rate x t, to a bracket by weighted least squares.

    The rate is zero where no exposure is usable.
    """
    information = (weight * t**2).sum(0)
    seen = information > 0
    return torch.where(
        seen, (weight * t * electrons).sum(0) / information.masked_fill(~seen, 1), 0.0
    )
