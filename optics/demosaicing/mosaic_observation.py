"""The observation of a sensor with a mosaic of colour filters, with its filters and noise."""

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


@dataclass(frozen=True, eq=False)
class MosaicObservation:
    """The raw picture of a mosaic of colour filters, (rows, columns), with filters and noise.

    The scene beyond the frame is unknown.

    Attributes
    ----------
    raw : torch.Tensor
        Light of each pixel, (rows, columns).
    filters : torch.Tensor
        Share of each band that each pixel's filter transmits, (bands, rows, columns).
    noise : float
        Standard deviation of a pixel, in the unit of `raw`.
    psf : torch.Tensor, optional
        PSF with its origin at n // 2: (rows, columns) for all bands, or (bands, rows, columns).
        None for a picture without blur.
    pixel_weights : torch.Tensor, optional
        Weight of each pixel in the data term, (rows, columns); 0 where a pixel isn't used. All 1 if
        None.
    clipped : torch.Tensor, optional
        True where the light is at least what was measured. The weight is 0 there.

    Raises
    ------
    ValueError
        If an argument has the wrong shape or isn't finite, or if no pixel sees one of the bands.
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
        """The (rows, columns) of the mosaic's frame."""
        return self.raw.shape[0], self.raw.shape[1]

    @cached_property
    def period_shape(self) -> tuple[int, int]:
        """The (rows, columns) of the period on which the demosaiced scene is estimated."""
        # Without a PSF, a margin of 8 pixels keeps opposite edges of the frame apart.
        return blur_shape(self.frame_shape, (8, 8) if self.psf is None else self.psf.shape[-2:])

    @cached_property
    def filter_gain(self) -> float:
        """The gain of the mosaic's filters: the norm over the bands, as an rms over the pixels."""
        return math.sqrt(float(self.filters.square().sum(0).mean()))

    @cached_property
    def scale(self) -> float:
        """The scale of the scene's light, which sets the weights of the demosaicing prior.

        It is the standard deviation of the raw picture over the gain of the filters, but at least
        1e-3 of the mean; 1 for a dark picture.
        """
        raw = self.raw.to(torch.float64)
        spread = max(float(raw.std(correction=0)), 1e-3 * float(raw.abs().mean()))
        return spread / self.filter_gain if spread > 0 else 1.0

    @cached_property
    def otf(self) -> torch.Tensor | None:
        """The OTF on the period of the demosaicing, or None without a PSF.

        The OTF is (1 or bands, rows, columns // 2 + 1).
        """
        if self.psf is None:
            return None
        psf = self.psf if self.psf.ndim == 3 else self.psf[None]
        return transfer_function(psf.to(self.raw), self.period_shape)

    def crop_to_frame(self, period_image: torch.Tensor) -> torch.Tensor:
        """Crop a picture on the whole period to the mosaic's frame; the result is a view."""
        return centred_crop(period_image, self.frame_shape)

    def initial_bands(self, period: Sequence[int]) -> torch.Tensor:
        """Interpolate each band of the mosaic from the pixels around that see it.

        This is the start of the demosaicing, (bands, rows, columns). It is exact where the scene is
        even and grey. `period` is the period of the filter pattern.
        """
        trust = torch.ones_like(self.raw) if self.pixel_weights is None else self.pixel_weights
        told = _tent_filter(self.filters * (self.raw * trust), period)
        share = _tent_filter(self.filters * self.filters.sum(0) * trust, period)
        known = share.abs() > 1e-6 * float(share.abs().max())
        mean = told.sum((-2, -1), keepdim=True) / share.sum((-2, -1), keepdim=True)
        return torch.where(known, told / torch.where(known, share, 1.0), mean)


def _tent_filter(pictures: torch.Tensor, period: Sequence[int]) -> torch.Tensor:
    """Interpolate a mosaic's samples by convolution with a tent-shaped kernel.

    The kernel falls linearly from its middle to 0 at a distance of the filter pattern's period.
    """
    kernels = [1 - torch.arange(1 - n, n).abs() / n for n in (max(int(m), 2) for m in period)]
    down, along = (kernel.to(pictures) for kernel in kernels)
    rows = torch.nn.functional.conv2d(
        pictures[:, None], down[None, None, :, None], padding=(len(down) // 2, 0)
    )
    return torch.nn.functional.conv2d(
        rows, along[None, None, None, :], padding=(0, len(along) // 2)
    )[:, 0]
