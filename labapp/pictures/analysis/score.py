"""How near a picture comes to the one that it should be."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from optics import metrics
from optics.threads import single_threaded

CENTRAL_SHARE = 0.9
"""Share of the frame's sides over which a record's pictures are judged."""

_WINDOW = 11
"""Pixels of a side that SSIM needs."""

Light = NDArray[np.floating]


@dataclass(frozen=True)
class Score:
    """PSNR in dB, and SSIM; NaN for pictures smaller than its window."""

    psnr: float
    ssim: float

    @property
    def as_data(self) -> dict[str, float | None]:
        """For JSON, which has no infinity."""
        named = {"psnr_db": self.psnr, "ssim": self.ssim}
        return {name: value if math.isfinite(value) else None for name, value in named.items()}


@dataclass(frozen=True, eq=False)
class ReferencePicture:
    """The picture that a photograph should be.

    light: (bands, rows, columns). white: PSNR's peak, and SSIM's range. share: of the frame's
    sides, over which it judges. source: where it is from, in words.
    """

    light: Light
    white: float
    share: float
    source: str

    @property
    def crop(self) -> str:
        return "full frame" if self.share == 1 else f"central {self.share:.0%}".replace("%", " %")

    def score(self, light: Light) -> Score:
        """Of a picture of its shape and unit."""
        return score(light, self.light, self.white, self.share)


@single_threaded
def score(
    image: Light, reference: Light, white: float = 1.0, share: float = CENTRAL_SHARE
) -> Score:
    """PSNR (peak `white`), and the bands' mean SSIM (range `white`), over a share of each side.

    Pictures are (..., rows, columns); where they aren't finite they count as 0.
    """
    a, b = (_central_part(picture, share) for picture in (image, reference))
    psnr = metrics.psnr(a, b, white)
    if min(a.shape[-2:]) < _WINDOW:
        return Score(psnr, math.nan)
    ssim = [metrics.ssim(one, other, white) for one, other in zip(a, b, strict=True)]
    return Score(psnr, float(np.mean(ssim)))


def _central_part(picture: Light, share: float) -> torch.Tensor:
    """(bands, rows, columns) in double precision."""
    bands = np.nan_to_num(picture).astype(np.float64).reshape(-1, *picture.shape[-2:])
    return metrics.crop_central_share(torch.from_numpy(bands), share)
