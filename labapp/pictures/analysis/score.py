"""Score pictures, restored or not, against a reference by PSNR and SSIM."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from optics import metrics
from optics.threads import single_threaded

CENTRAL_SHARE = 0.9
"""Share of each side of the frame over which pictures of a record are scored."""

Light = NDArray[np.floating]


@dataclass(frozen=True)
class Score:
    """PSNR in dB, and SSIM; SSIM is NaN for pictures smaller than its window."""

    psnr: float
    ssim: float

    @property
    def as_data(self) -> dict[str, float | None]:
        """Return PSNR and SSIM for JSON; None stands for values that aren't finite."""
        named = {"psnr_db": self.psnr, "ssim": self.ssim}
        return {name: value if math.isfinite(value) else None for name, value in named.items()}


@dataclass(frozen=True, eq=False)
class ReferencePicture:
    """What a perfect restoration would give.

    light: (bands, rows, columns).
    white: light that is white, the peak of PSNR and the range of SSIM.
    share: share of each side of the frame over which pictures are scored.
    source: where it is from, in words.
    """

    light: Light
    white: float
    share: float
    source: str

    @property
    def crop(self) -> str:
        """Say in words which part of the frame is scored."""
        return "full frame" if self.share == 1 else f"central {self.share:.0%}".replace("%", " %")

    def score(self, light: Light) -> Score:
        """Score light of the reference's shape and unit."""
        return score(light, self.light, self.white, self.share)


@single_threaded
def score(
    image: Light, reference: Light, white: float = 1.0, share: float = CENTRAL_SHARE
) -> Score:
    """Return the PSNR over all bands and the mean SSIM of the bands, in the centre only.

    image, reference: (..., rows, columns) of equal shape; values that aren't finite count as 0.
    white: peak of PSNR and range of SSIM.
    share: share of each side that is scored.
    """
    a, b = (_central_part(picture, share) for picture in (image, reference))
    psnr = metrics.psnr(a, b, white)
    # The window of metrics.ssim is 11 x 11 pixels.
    if min(a.shape[-2:]) < 11:
        return Score(psnr, math.nan)
    ssim = [metrics.ssim(one, other, white) for one, other in zip(a, b, strict=True)]
    return Score(psnr, float(np.mean(ssim)))


@single_threaded
def score_present(
    image: Light, reference: Light, missing: NDArray[np.bool_], white: float
) -> Score:
    """Score the whole frame, but for pixels that the reference lacks.

    PSNR is of the other pixels, and SSIM the mean of the other windows; NaN where there are none.

    image, reference: (rows, columns).
    missing: (rows, columns), pixels that are left out, and with them each window of SSIM that
        touches one.
    white: peak of PSNR and range of SSIM.
    """
    if not missing.any():
        return score(image, reference, white, 1.0)
    if missing.all():
        return Score(math.nan, math.nan)
    a, b = (torch.from_numpy(one.astype(np.float64)) for one in (image, reference))
    absent = torch.from_numpy(missing)
    psnr = metrics.psnr(a[~absent], b[~absent], white)
    if min(a.shape) < 11:
        return Score(psnr, math.nan)
    marked, wanted = (one.masked_fill(absent, math.nan)[None] for one in (a, b))
    return Score(psnr, float(metrics.similarity_map(marked, wanted, white).nanmean()))


def _central_part(picture: Light, share: float) -> torch.Tensor:
    """Cut out the centre, as (bands, rows, columns) in float64."""
    bands = np.nan_to_num(picture).astype(np.float64).reshape(-1, *picture.shape[-2:])
    return metrics.crop_central_share(torch.from_numpy(bands), share)
