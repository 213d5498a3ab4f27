"""The coded photograph undone, and judged against the neutral one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch

from labapp.common.stopwatch import Stopwatch
from labapp.pictures.analysis.brackets import Bracket, Picture
from optics import metrics
from optics.deconvolution.measured import measured
from optics.deconvolution.richardson_lucy import richardson_lucy
from optics.deconvolution.total_variation import total_variation
from optics.deconvolution.wiener import wiener
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
    known = np.isfinite(coded.variance)
    if not known.any():
        raise ValueError("variance has no finite value; no pixel of the picture was measured")
    # The noise is estimated: what a measured PSF can't explain is in it, as it has to be.
    seen = measured(
        (coded.rate / white).astype(np.float32),
        psf.astype(np.float32),
        weights=None if known.all() else known.astype(np.float32),
    )
    progress.report(0, "Wiener")
    with watch.stage("Wiener"):
        sharp = wiener(seen)
    with watch.stage("Richardson-Lucy"):
        deblurred = richardson_lucy(
            seen, iterations, accelerated=False, past_noise=True, progress=progress.part(0.1, 0.7)
        )
    with watch.stage("total variation"):
        edged = total_variation(seen, progress=progress.part(0.7, 1))
    return {
        "neutral": neutral.rate / white,
        "coded": coded.rate / white,
        "wiener": sharp.image.double().numpy(),
        "richardson-lucy": deblurred.image.double().numpy(),
        "total-variation": edged.image.double().numpy(),
    }


def score(image: Picture, reference: Picture) -> Score:
    """PSNR (peak 1) and SSIM (data range 1) over the central 90 % of each side."""
    a, b = (metrics.central(torch.from_numpy(picture), _CENTRAL) for picture in (image, reference))
    return Score(metrics.psnr(a, b), metrics.ssim(a, b))
