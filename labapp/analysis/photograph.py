"""The coded photograph undone, and judged against the neutral one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch

from labapp.analysis.brackets import Bracket, Picture
from labapp.stopwatch import Stopwatch
from optics import metrics
from optics.deconvolution.richardson_lucy import richardson_lucy
from optics.deconvolution.wiener import best_noise_to_signal, wiener
from optics.progress import Progress

_CENTRAL = 0.9
"""Share of the frame's sides over which reconstructions are judged."""

_WHITE = 99.9
"""Percentile of the neutral photograph that counts as white, 1 on the common scale."""


@dataclass(frozen=True)
class Score:
    """PSNR in dB with peak 1 and SSIM with data range 1, over the central 90 %."""

    psnr: float
    ssim: float


def reconstruct(
    neutral: Bracket,
    coded: Bracket,
    psf: Picture,
    iterations: int,
    watch: Stopwatch,
    progress: Progress,
) -> dict[str, Picture]:
    """The neutral, the coded and the restored photographs, all on the neutral one's scale.

    psf: the full PSF, relative to the neutral one's light, origin at n // 2.
    """
    white = float(np.percentile(neutral.rate, _WHITE))
    image = (coded.rate / white).astype(np.float32)
    variance = (coded.variance / white**2).astype(np.float32)
    kernel = psf.astype(np.float32)
    progress.report(0, "Wiener")
    with watch.stage("Wiener"):
        sharp = wiener(image, kernel, best_noise_to_signal(image, kernel, variance))
    with watch.stage("Richardson-Lucy"):
        deblurred = richardson_lucy(image, kernel, iterations, progress=progress.part(0.1, 1))
    return {
        "neutral": neutral.rate / white,
        "coded": coded.rate / white,
        "wiener": sharp.astype(np.float64),
        "richardson-lucy": deblurred.astype(np.float64),
    }


def score(image: Picture, reference: Picture) -> Score:
    """PSNR (peak 1) and SSIM (data range 1) over the central 90 % of each side."""
    a, b = (metrics.central(torch.from_numpy(picture), _CENTRAL) for picture in (image, reference))
    return Score(metrics.psnr(a, b), metrics.ssim(a, b))
