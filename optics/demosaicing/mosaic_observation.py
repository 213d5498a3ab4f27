"""The observation of a sensor with a mosaic of colour filters, with its filters and noise."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Self

import torch

from optics.deconvolution.border import extend_periodically
from optics.deconvolution.noise import PowerLaw, flat_block_noise
from optics.deconvolution.observation import Observation, require_psf
from optics.deconvolution.psf_centring import about_offset
from optics.operators.blur import blur_shape, transfer_function
from optics.plane import centred_pad
from optics.validation import needs_gradient, require_finite

_FLAT_SHARE = 0.02
"""Share of a mosaic's blocks that are taken to be flat. Each filter's pixels lie apart, so that a
block of them shows more of the scene."""

_MARGIN = 8
"""Least number of pixels that keep opposite edges of the frame apart on the period."""


@dataclass(frozen=True, eq=False)
class MosaicObservation(Observation):
    """The raw picture of a mosaic of colour filters, whose scene has several bands.

    `image` is the light of each pixel, y = sum_n S_n (h_n * x_n) with the filters S_n and PSFs h_n.
    `psf` is the mean of all PSFs.

    Attributes
    ----------
    psfs : torch.Tensor
        PSF of each band, (bands, rows, columns), or one for all, (1, rows, columns).
    filters : torch.Tensor
        Share of each band that each pixel's filter transmits, (bands, rows, columns).
    filter_period : tuple of int
        Period of the filter pattern in (rows, columns).

    Raises
    ------
    ValueError
        If an argument has the wrong shape or isn't finite, or if no pixel sees one of the bands.
    """

    psfs: torch.Tensor = field(default_factory=lambda: torch.empty(0))
    filters: torch.Tensor = field(default_factory=lambda: torch.empty(0))
    filter_period: tuple[int, int] = (2, 2)

    def __post_init__(self) -> None:
        require_finite("filters", self.filters)
        if self.filters.ndim != 3 or self.filters.shape[1:] != self.image.shape:
            raise ValueError(
                f"filters are {tuple(self.filters.shape)} and raw is {tuple(self.image.shape)}; "
                "give (bands, rows, columns) for (rows, columns)"
            )
        if self.psfs.ndim != 3 or len(self.psfs) not in (1, self.bands):
            raise ValueError(
                f"psf is {tuple(self.psfs.shape)}; give (rows, columns), or that for each of "
                f"{self.bands} bands"
            )
        for one in self.psfs:
            require_psf(one)
        super().__post_init__()
        trust = 1.0 if self.effective_weights is None else self.effective_weights
        for number, band in enumerate(self.filters.square() * trust):
            if not bool((band > 0).any()):
                raise ValueError(
                    f"no trusted pixel sees band {number}; the frame must hold the whole pattern"
                )

    @property
    def bands(self) -> int:
        return len(self.filters)

    def with_centred_psf(self) -> Self:
        if self.psf_offset == (0, 0) or self.psfs.requires_grad or self.psf.requires_grad:
            return self
        psfs = about_offset(self.psfs, self.psf_offset)
        return replace(self, psf=psfs.mean(0), psfs=psfs, offset=self.psf_offset)

    @property
    def needs_filters(self) -> bool:
        return True

    @property
    def is_fully_measured(self) -> bool:
        return False

    @property
    def records_derivatives(self) -> bool:
        recorded = torch.is_grad_enabled() and needs_gradient(self.psfs)
        return recorded or super().records_derivatives

    @cached_property
    def filter_gain(self) -> float:
        """The gain of the mosaic's filters: the norm over the bands, as an rms over the pixels."""
        return math.sqrt(float(self.filters.square().sum(0).mean()))

    @property
    def psf_sum(self) -> float:
        """The mean share of the scene's light that PSFs and filters of the mosaic let through."""
        return super().psf_sum * self.filter_gain

    @cached_property
    def period_shape(self) -> tuple[int, int]:
        if self.border == "periodic":
            return super().period_shape
        return blur_shape(self.image.shape, [max(n, _MARGIN) for n in self.psfs.shape[-2:]])

    @cached_property
    def otf(self) -> torch.Tensor:
        """The OTF of each band on the period of the demosaicing, (1 or bands, rows, columns)."""
        light = self._psf_light / self.filter_gain
        return transfer_function(self.psfs / light, self.period_shape)

    @cached_property
    def _relative_filters(self) -> torch.Tensor:
        """The mosaic's filters over their gain."""
        return self.filters / self.filter_gain

    @cached_property
    def filter_power(self) -> torch.Tensor:
        return self._relative_filters.square().sum(0)

    @cached_property
    def squared_response(self) -> torch.Tensor:
        return self.squared_mtf * self._relative_filters.square().mean((-2, -1), keepdim=True)

    @cached_property
    def channels(self) -> tuple[Observation, torch.Tensor]:
        """The mosaic as one of the light behind each kind of filter, and how bands mix into it.

        The mixing is (channels, bands). Where there aren't fewer kinds of filters than bands, the
        channels are the bands.
        """
        down, along = self.filter_period
        first = self._relative_filters[:, :down, :along].flatten(1).mT
        mixing, kinds = torch.unique(first, dim=0, return_inverse=True)
        rows, columns = self.image.shape
        place = torch.arange(rows)[:, None] % down * along + torch.arange(columns) % along
        kind = kinds[place]
        repeats = torch.equal(mixing[kind].movedim(-1, 0), self._relative_filters)
        if not repeats or len(mixing) >= self.bands:
            return super().channels
        masks = torch.stack([kind == one for one in range(len(mixing))]).to(self.image)
        # With these filters, the channels' light has the scale of the bands'.
        own = replace(self, psfs=self.psf[None], filters=masks * self.filter_gain)
        return own, mixing

    def sum_bands(self, light: torch.Tensor) -> torch.Tensor:
        return (self._relative_filters * light).sum(0, keepdim=True)

    def spread_to_bands(self, frame: torch.Tensor) -> torch.Tensor:
        return self._relative_filters * frame

    def _fitted_power_law(self) -> PowerLaw:
        """Estimate the noise of the mosaic, whose spectrum isn't modelled in demosaicing."""
        down, along = self.filter_period
        planes = [self.image[y::down, x::along] for y in range(down) for x in range(along)]
        return PowerLaw(0.0, 2.0, flat_block_noise(planes, _FLAT_SHARE) ** 2)

    @property
    def inpainted_image(self) -> torch.Tensor:
        """The normalised mosaic as it is: neighbouring pixels have other filters."""
        return self.normalised_image

    @cached_property
    def extended_image(self) -> torch.Tensor:
        """The interpolated bands of the mosaic, extended to the period of the demosaicing.

        The result is (bands, rows, columns).
        """
        bands = self._interpolated_bands()
        if self.border == "dark":
            return centred_pad(bands, self.period_shape)
        return torch.stack([extend_periodically(one, self.period_shape) for one in bands])

    def _interpolated_bands(self) -> torch.Tensor:
        """Interpolate each band of the mosaic from the pixels around that see it.

        This is the start of the demosaicing, (bands, rows, columns). It is exact where the scene is
        even and grey.
        """
        known = self.effective_weights
        trust = torch.ones_like(self.image) if known is None else known
        filters, period = self._relative_filters, self.filter_period
        told = _tent_filter(filters * (self.normalised_image * trust), period)
        share = _tent_filter(filters * filters.sum(0) * trust, period)
        seen = share.abs() > 1e-6 * float(share.abs().max())
        mean = told.sum((-2, -1), keepdim=True) / share.sum((-2, -1), keepdim=True)
        return torch.where(seen, told / torch.where(seen, share, 1.0), mean)


def _tent_filter(pictures: torch.Tensor, period: tuple[int, int]) -> torch.Tensor:
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
