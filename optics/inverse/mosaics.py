"""Estimate all colours of each pixel of a sensor with colour filters, blurred or not."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Self

import numpy as np
import torch

from optics.inverse.band_coupling import BandCoupling
from optics.inverse.blur import Border, blur_shape, transfer_function
from optics.inverse.frequency_step import frequency_step
from optics.inverse.noise import PowerLaw, flat_block_noise
from optics.inverse.observation import Observation, extend_periodically, require_psf
from optics.inverse.pixel_operators import filter_weights
from optics.inverse.priors import CURVATURE, DerivativePenalty
from optics.inverse.psf_origin import about_offset
from optics.inverse.splitting import SplittingSettings, solve_by_splitting
from optics.plane import centred_pad
from optics.progress import Progress
from optics.threads import single_threaded
from optics.validation import (
    accepts_numpy,
    as_floating_point,
    needs_gradient,
    require_count,
    require_finite,
    require_positive,
    split_mask,
)

# Share of a mosaic's blocks that are taken to be flat. Each filter's pixels lie apart, so that a
# block of them shows more of the scene.
_FLAT_SHARE = 0.02

_MARGIN = 8  # least number of pixels that keep opposite edges of the frame apart on the period


@dataclass(frozen=True, eq=False)
class MosaicObservation(Observation):
    """The raw picture of a mosaic of colour filters, whose scene has several bands.

    `image` is the light of each pixel, y = sum_n S_n (h_n * x_n) with the filters S_n and PSFs h_n,
    of which `psf` is the mean. Raises ValueError if an argument has the wrong shape or isn't
    finite, or if no pixel sees one of the bands.

    psfs: PSF of each band, (bands, rows, columns), or one for all, (1, rows, columns).
    filters: share of each band that each pixel's filter transmits, (bands, rows, columns).
    filter_period: period of the filter pattern in (rows, columns).
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
    def is_fully_measured(self) -> bool:
        return False

    @property
    def records_derivatives(self) -> bool:
        recorded = torch.is_grad_enabled() and needs_gradient(self.psfs)
        return recorded or super().records_derivatives

    @cached_property
    def filter_gain(self) -> float:
        """The filters' norm over the bands, as an rms over the pixels."""
        return math.sqrt(float(self.filters.square().sum(0).mean()))

    @property
    def psf_sum(self) -> float:
        return super().psf_sum * self.filter_gain

    @cached_property
    def period_shape(self) -> tuple[int, int]:
        if self.border == "periodic":
            return super().period_shape
        return blur_shape(self.image.shape, [max(n, _MARGIN) for n in self.psfs.shape[-2:]])

    @cached_property
    def otf(self) -> torch.Tensor:
        # That of each band, (1 or bands, rows, columns).
        light = self._psf_light / self.filter_gain
        return transfer_function(self.psfs / light, self.period_shape)

    @cached_property
    def relative_filters(self) -> torch.Tensor:
        return self.filters / self.filter_gain

    @cached_property
    def channels(self) -> tuple[Observation, torch.Tensor]:
        # The light behind each kind of filter is a mosaic of its own, if fewer than the bands.
        down, along = self.filter_period
        first = self.relative_filters[:, :down, :along].flatten(1).mT
        mixing, kinds = torch.unique(first, dim=0, return_inverse=True)
        rows, columns = self.image.shape
        place = torch.arange(rows)[:, None] % down * along + torch.arange(columns) % along
        kind = kinds[place]
        repeats = torch.equal(mixing[kind].movedim(-1, 0), self.relative_filters)
        if not repeats or len(mixing) >= self.bands:
            return super().channels
        masks = torch.stack([kind == one for one in range(len(mixing))]).to(self.image)
        # With these filters, the channels' light has the scale of the bands'.
        own = replace(self, psfs=self.psf[None], filters=masks * self.filter_gain)
        return own, mixing

    def _fitted_power_law(self) -> PowerLaw:
        # The noise alone is estimated: the spectrum of a mosaic isn't modelled.
        down, along = self.filter_period
        planes = [self.image[y::down, x::along] for y in range(down) for x in range(along)]
        return PowerLaw(0.0, 2.0, flat_block_noise(planes, _FLAT_SHARE) ** 2)

    @property
    def inpainted_image(self) -> torch.Tensor:
        # Neighbouring pixels have other filters, and tell nothing.
        return self.normalised_image

    @cached_property
    def extended_image(self) -> torch.Tensor:
        # Each band is interpolated from the pixels around that see it, which is exact where the
        # scene is even and grey.
        known = self.effective_weights
        trust = torch.ones_like(self.image) if known is None else known
        filters, period = self.relative_filters, self.filter_period
        told = _tent_filter(filters * (self.normalised_image * trust), period)
        share = _tent_filter(filters * filters.sum(0) * trust, period)
        seen = share.abs() > 1e-6 * float(share.abs().max())
        mean = told.sum((-2, -1), keepdim=True) / share.sum((-2, -1), keepdim=True)
        bands = torch.where(seen, told / torch.where(seen, share, 1.0), mean)
        if self.border == "dark":
            return centred_pad(bands, self.period_shape)
        return torch.stack([extend_periodically(one, self.period_shape) for one in bands])


def _tent_filter(pictures: torch.Tensor, period: tuple[int, int]) -> torch.Tensor:
    """Convolve with a tent, which falls linearly to 0 over the filter pattern's period."""
    m, n = max(period[0], 2), max(period[1], 2)
    down = (1 - torch.arange(1 - m, m).abs() / m).to(pictures)[:, None]
    along = (1 - torch.arange(1 - n, n).abs() / n).to(pictures)
    convolve = torch.nn.functional.conv2d
    rows = convolve(pictures[:, None], down[None, None], padding=(m - 1, 0))
    return convolve(rows, along[None, None, None], padding=(0, n - 1))[:, 0]


def build_mosaic_observation(
    raw: Any,
    pattern: Sequence[str],
    psf: Any = None,
    *,
    channels: str = "RGB",
    response: Any = None,
    noise: float | None = None,
    border: Border = "unknown",
    weights: Any = None,
    clipped: Any = None,
) -> MosaicObservation:
    """Gather the raw picture of a sensor with colour filters, its PSFs and its noise.

    Parameters
    ----------
    raw : torch.Tensor or numpy.ndarray, (rows, columns)
        Light of each pixel less the dark level. Masked pixels of a numpy.ma array count as dead.
    pattern : sequence of str
        Rows of one letter per pixel that repeat from the first pixel on, as ``("RG", "GB")``.
    psf : torch.Tensor or numpy.ndarray, optional
        PSF, origin at n // 2, (rows, columns), or one per band, (bands, rows, columns); no blur if
        None.
    channels : str, default "RGB"
        Letters of the channels. Without a response each channel is a band, in this order.
    response : torch.Tensor or numpy.ndarray, (channels, bands), optional
        Share of each band that the filter of each letter transmits; the identity if None.
    noise : float, optional
        Standard deviation of a pixel, in the unit of `raw`. Estimated if None.
    border : {"unknown", "dark", "periodic"}, default "unknown"
        What the scene does beyond the frame.
    weights : torch.Tensor or numpy.ndarray, (rows, columns), optional
        Weight of each pixel in the data term; 0 where a pixel is dead.
    clipped : torch.Tensor or numpy.ndarray of bool, (rows, columns), optional
        True where the well was full: there the light is at least what was measured.

    Returns
    -------
    MosaicObservation
        The observation that `optics.inverse.restore` takes; it restores (bands, rows,
        columns).

    Raises
    ------
    ValueError
        If an argument has the wrong shape or isn't finite, or if no pixel sees one of the bands.
    """
    rows = (pattern,) if isinstance(pattern, str) else tuple(pattern)
    if isinstance(pattern, str) or not rows or not rows[0] or len({len(row) for row in rows}) > 1:
        raise ValueError(
            f"pattern is {pattern!r}; give rows of one letter a pixel, all as long, as in "
            "('RG', 'GB')"
        )
    raw, weights = split_mask(raw, weights)
    filters = _filters(raw, rows, channels, response)
    period = len(rows), len(rows[0])
    built: MosaicObservation = _build_mosaic_observation(
        raw, psf, noise, border, weights, clipped, filters, period
    )
    return replace(built, is_numpy=isinstance(raw, np.ndarray))


@accepts_numpy
def _filters(
    raw: torch.Tensor, rows: Sequence[str], channels: str, response: torch.Tensor | None
) -> torch.Tensor:
    """Return what each pixel of a raw picture transmits of each band, in its precision."""
    if raw.ndim != 2:
        raise ValueError(f"raw is {tuple(raw.shape)}; give (rows, columns)")
    require_finite("raw", raw)
    shares = torch.eye(len(channels)) if response is None else response
    require_finite("response", shares)
    if shares.ndim != 2 or len(shares) != len(channels):
        raise ValueError(
            f"response is {tuple(shares.shape)}; give (channels, bands), of {len(channels)} "
            f"channels {channels!r}"
        )
    return filter_weights(rows, shares.to(as_floating_point(raw)), channels, raw.shape)


@accepts_numpy
def _build_mosaic_observation(
    raw: torch.Tensor,
    psf: torch.Tensor | None,
    noise: float | None,
    border: Border,
    weights: torch.Tensor | None,
    clipped: torch.Tensor | None,
    filters: torch.Tensor,
    period: tuple[int, int],
) -> MosaicObservation:
    raw = as_floating_point(raw)
    psfs = torch.ones(1, 1, 1).to(raw) if psf is None else psf.to(raw)
    psfs = psfs[None] if psfs.ndim == 2 else psfs
    return MosaicObservation(
        raw,
        psfs.mean(0),
        noise if noise is None else float(noise),
        border,
        weights if weights is None else weights.to(raw),
        clipped if clipped is None else clipped.to(torch.bool),
        psfs=psfs,
        filters=filters,
        filter_period=period,
    )


# Weight of the luminance's curvature relative to that of the colour differences. Chosen.
_LUMINANCE = 0.4

# Curvature that one iteration sets to zero, over the light's standard deviation. Chosen.
_CURVATURE_THRESHOLD = 1.0

# Regularisation weight of a picture without noise, over the light's scale, and the factor of the
# squared relative noise, which is added. Chosen.
_NOISELESS_WEIGHT, _NOISE_WEIGHT = 1e-3, 1.8


@single_threaded
@torch.no_grad()
def demosaic(
    observation: MosaicObservation,
    weight: float | None = None,
    *,
    iterations: int = 30,
    progress: Progress | None = None,
) -> Any:
    """Estimate all bands of each pixel of a raw picture behind colour filters.

    The result x solves Eq. 4.7 of the thesis. It minimises ``|S G x - y|² / 2 + weight *
    (|w ∇²L| + |∇²C|)``, summed over the pixels, with the filters S and the blur G; the first term
    counts trusted pixels only. ``|∇²L|`` is the length of the second derivatives of the luminance,
    and ``|∇²C|`` the joint length of those of all colour differences. The bands of a white surface
    are taken to be equal. Where there is blur, `restore` undoes it better.

    Parameters
    ----------
    observation : MosaicObservation
        The raw picture with its filters: see `build_mosaic_observation`.
    weight : float, optional
        Regularisation weight. Chosen from the noise and the scale of the light if None.
    iterations : int, default 30
        Number of iterations, 1 or more.
    progress : Progress, optional
        Receives reports, and can cancel the work.

    Returns
    -------
    torch.Tensor or numpy.ndarray, (bands, rows, columns)
        Light of each band, an array of the raw picture's kind. Noise may make it negative.

    Raises
    ------
    ValueError
        For a weight that isn't positive, or no iteration.
    """
    if weight is not None:
        require_positive("weight", weight, "")
    require_count("iterations", iterations)
    unit, observation = observation.unit, observation.in_own_unit
    used = (
        weight / unit if weight else demosaicing_weight(observation.scene_noise, observation.scale)
    )
    prior = DerivativePenalty(
        BandCoupling.luminance_chrominance(observation.bands, _LUMINANCE),
        observation.period_shape, _CURVATURE_THRESHOLD * observation.scale,
        observation.image.dtype, derivative=CURVATURE,
    )  # fmt: skip
    solution = solve_by_splitting(
        frequency_step(observation, iterations), [prior], SplittingSettings(iterations, used),
        "demosaicing", progress or Progress(),
    )  # fmt: skip
    bands = observation.crop_to_frame(solution.picture) * unit
    return bands.numpy() if observation.is_numpy else bands


def demosaicing_weight(noise: float, scale: float) -> float:
    """Return the regularisation weight that `demosaic` takes by default.

    Parameters
    ----------
    noise, scale : float
        Standard deviations of a pixel, and of the light over the picture, in the same unit.

    Returns
    -------
    float
        In that unit. Parts of a picture that are demosaiced by themselves need one in common.
    """
    return scale * (_NOISELESS_WEIGHT + _NOISE_WEIGHT * (noise / scale) ** 2)
