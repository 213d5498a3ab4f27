"""What a sensor with colour filters measured, and through which filters."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import torch

from optics.deconvolution.observation import require_psf
from optics.operators.blur import blur_shape, transfer_function
from optics.plane import centred_crop
from optics.validation import require_finite

_MARGIN = (8, 8)
"""Pixels by which the scene goes on around a sharp frame, so that its edges don't meet."""


@dataclass(frozen=True, eq=False)
class MosaicObservation:
    """One number a pixel, (rows, columns) light, of a scene's bands.

    filters: (bands, rows, columns), what each pixel's filter lets through of each band. noise:
    standard deviation of a pixel. psf: (rows, columns) of all bands, or one for each; origin at
    n // 2; None for a sharp picture. pixel_weights: 0 where a pixel tells nothing, else its weight.
    clipped: True where the light is at least what was measured, at weight 0. Beyond the frame the
    scene is unknown. Raises ValueError for what doesn't fit, or isn't finite.
    """

    raw: torch.Tensor
    filters: torch.Tensor
    noise: float
    psf: torch.Tensor | None = None
    pixel_weights: torch.Tensor | None = None
    clipped: torch.Tensor | None = None

    def __post_init__(self) -> None:
        require_finite("filters", self.filters)
        if self.filters.ndim != 3 or self.filters.shape[1:] != self.raw.shape:
            raise ValueError(
                f"filters are {tuple(self.filters.shape)} and raw is {tuple(self.raw.shape)}; give "
                "(bands, rows, columns) for (rows, columns)"
            )
        if not (self.noise >= 0 and math.isfinite(self.noise)):
            raise ValueError(f"noise is {self.noise:g}; it must be finite, and not negative")
        if self.psf is not None:
            self._require_psf(self.psf)
        if self.pixel_weights is not None:
            require_finite("pixel_weights", self.pixel_weights)
            if float(self.pixel_weights.min()) < 0:
                raise ValueError("pixel_weights must be negative nowhere")
        self._require_bands()

    def _require_psf(self, psf: torch.Tensor) -> None:
        if psf.ndim not in (2, 3) or (psf.ndim == 3 and len(psf) != len(self.filters)):
            raise ValueError(
                f"psf is {tuple(psf.shape)}; give (rows, columns), or that for each of "
                f"{len(self.filters)} bands"
            )
        for one in psf.reshape(-1, *psf.shape[-2:]):
            require_psf(one)

    def _require_bands(self) -> None:
        trusted = 1.0 if self.pixel_weights is None else self.pixel_weights
        for number, band in enumerate(self.filters.square() * trusted):
            if not float(band.max()) > 0:
                raise ValueError(
                    f"no trusted pixel sees band {number}; the frame must hold the whole pattern"
                )

    @property
    def frame_shape(self) -> tuple[int, int]:
        return self.raw.shape[0], self.raw.shape[1]

    @cached_property
    def period_shape(self) -> tuple[int, int]:
        """(rows, columns) of the period on which the scene is looked for."""
        return blur_shape(self.frame_shape, _MARGIN if self.psf is None else self.psf.shape[-2:])

    @cached_property
    def filter_gain(self) -> float:
        """Of the filters, rms over the pixels."""
        return math.sqrt(float(self.filters.square().sum(0).mean()))

    @cached_property
    def scale(self) -> float:
        """Of the scene's light: standard deviation, or a share of the mean; 1 where it is dark."""
        raw = self.raw.to(torch.float64)
        spread = max(float(raw.std(correction=0)), 1e-3 * float(raw.abs().mean()))
        return spread / self.filter_gain if spread > 0 else 1.0

    @cached_property
    def otf(self) -> torch.Tensor | None:
        """Of the PSF on that period, (1 or bands, rows, columns // 2 + 1); None if sharp."""
        if self.psf is None:
            return None
        psf = self.psf if self.psf.ndim == 3 else self.psf[None]
        return transfer_function(psf.to(self.raw), self.period_shape)

    def crop_to_frame(self, period_image: torch.Tensor) -> torch.Tensor:
        """What of the period lies in the frame, a view."""
        return centred_crop(period_image, self.frame_shape)

    def initial_bands(self, period: Sequence[int]) -> torch.Tensor:
        """Each band from the pixels around that see it, (bands, rows, columns); right where the
        scene is even and grey."""
        trust = torch.ones_like(self.raw) if self.pixel_weights is None else self.pixel_weights
        told = _tent_filter(self.filters * (self.raw * trust), period)
        share = _tent_filter(self.filters * self.filters.sum(0) * trust, period)
        known = share.abs() > 1e-6 * float(share.abs().max())
        mean = told.sum((-2, -1), keepdim=True) / share.sum((-2, -1), keepdim=True)
        return torch.where(known, told / torch.where(known, share, 1.0), mean)


def _tent_filter(pictures: torch.Tensor, period: Sequence[int]) -> torch.Tensor:
    """Summed with weights that fall evenly to 0 at a period's distance."""
    kernels = [1 - torch.arange(1 - n, n).abs() / n for n in (max(int(m), 2) for m in period)]
    down, along = (kernel.to(pictures) for kernel in kernels)
    rows = torch.nn.functional.conv2d(
        pictures[:, None], down[None, None, :, None], padding=(len(down) // 2, 0)
    )
    return torch.nn.functional.conv2d(
        rows, along[None, None, None, :], padding=(0, len(along) // 2)
    )[:, 0]
