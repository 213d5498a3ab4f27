"""Define what a merged picture is: radiance, its variance, and the state of each pixel."""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple

import torch


class PixelState(IntEnum):
    """State of a merged pixel in a radiance estimate.

    VALID pixels are measured. CLIPPED pixels are clipped in every exposure, so that the value is
    a lower bound. DARK pixels are below three standard deviations of their noise, so that three
    standard deviations are an upper bound. MAY_CLIP pixels lie within five standard deviations of
    the clip level of the shortest exposure: whether that clipped decides their value, which is
    biased. MOVED pixels contradict themselves, and exposures were left out. DEFECTIVE pixels were
    named as such, and aren't measured.
    """

    VALID = 0
    CLIPPED = 1
    DARK = 2
    MAY_CLIP = 3
    MOVED = 4
    DEFECTIVE = 5


VALID, CLIPPED, DARK, MAY_CLIP, MOVED, DEFECTIVE = PixelState


class RadianceEstimate(NamedTuple):
    """Hold the radiance estimate of a merged exposure bracket, one value per pixel.

    rate: electrons per second, float32. variance: that of the rate, float32; infinite where
    nothing is measured. state: numbers of `PixelState`, uint8.
    """

    rate: torch.Tensor
    variance: torch.Tensor
    state: torch.Tensor
