"""The model of a snapshot spectral camera, whose PSFs and response follow from parameters."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import torch

from optics.inverse import filter_weights
from optics.inverse.observation import require_psf
from optics.multispectral.model_parameters import ParameterLayout
from optics.multispectral.psf_interpolation import move_psf
from optics.validation import require_finite, require_unmasked

_MARGIN, _MARGIN_SHARE = 2, 0.03
"""Pixels, and share of half a side, by which modelled PSFs are larger than the nominal ones on
every side: room for shifts and for growth by a few percent."""


@dataclass(frozen=True, eq=False)
class SnapshotModel:
    """Describe a snapshot spectral camera as it is meant to be, and how it may differ from that.

    A band's PSF is ``z_n p_n + (1 - z_n) q_n``, with the zeroth order's share z_n, the neutral PSF
    p_n, which is that without a pattern, and the coded PSF q_n. Both are moved to the band's
    centre, and the coded PSFs are stretched by a common scale. A band's response keeps its sum over
    the channels, while the ratios between the channels vary. `create` makes a model of arrays of
    any kind.

    Attributes
    ----------
    coded : torch.Tensor, (bands, rows, columns), float64
        Coded part of the PSF of each band, origin at n // 2, with a sum of 1.
    neutral : torch.Tensor, (bands, rows, columns), float64
        Neutral PSF of each band, with a sum of 1.
    zeroth_order : torch.Tensor, (bands,), float64
        Nominal share of the zeroth order, 0 to 1.
    response : torch.Tensor, (channels, bands), float64
        Nominal response of each channel to each band, positive.
    pattern : tuple of str
        Rows of one letter per pixel, as ``("RG", "GB")``.
    channels : str
        Letters of the channels, in the order of `response`.
    """

    coded: torch.Tensor
    neutral: torch.Tensor
    zeroth_order: torch.Tensor
    response: torch.Tensor
    pattern: tuple[str, ...]
    channels: str

    @classmethod
    def create(
        cls,
        psfs: Any,
        response: Any,
        *,
        zeroth_order: Any,
        neutral: Any = None,
        pattern: Sequence[str] = ("RG", "GB"),
        channels: str = "RGB",
    ) -> SnapshotModel:
        """Describe a snapshot spectral camera by its nominal PSFs and response.

        Parameters
        ----------
        psfs : torch.Tensor or numpy.ndarray, (bands, rows, columns)
            PSF of each band with its zeroth order, origin at n // 2.
        response : torch.Tensor or numpy.ndarray, (channels, bands)
            Share of each band that the filter of each channel transmits, above 0.
        zeroth_order : float, torch.Tensor or numpy.ndarray, (bands,)
            Share of the light in `psfs` that is the zeroth order, for all bands or for each, from 0
            to less than 1.
        neutral : torch.Tensor or numpy.ndarray, (bands, rows, columns), optional
            PSF of each band without a pattern. The middle pixel alone if None.
        pattern : sequence of str, default ("RG", "GB")
            Rows of one letter per pixel that repeat from the first pixel on.
        channels : str, default "RGB"
            Letters of the channels.

        Returns
        -------
        SnapshotModel
            The model, whose deviation of 0 gives these PSFs and this response.

        Raises
        ------
        ValueError
            For shapes that don't fit, values that aren't finite, a response that isn't positive, or
            a zeroth order outside 0 to 1.
        """
        whole = _as_double("psfs", psfs, 3)
        shares = _as_double("response", response, 2)
        bands = len(whole)
        if shares.shape != (len(channels), bands) or len(channels) < 2:
            raise ValueError(
                f"response is {tuple(shares.shape)}; give (channels, bands) for {len(channels)} "
                f"channels {channels!r}, two or more, and {bands} bands"
            )
        if not bool((shares > 0).all()):
            raise ValueError(
                "response has entries that aren't positive; give a small share, such as 1e-3 of "
                "the band's largest, where a filter transmits next to nothing"
            )
        order = torch.as_tensor(zeroth_order, dtype=torch.float64)
        if order.ndim > 1 or (order.ndim == 1 and len(order) != bands):
            raise ValueError(f"zeroth_order is {tuple(order.shape)}; give one number, or {bands}")
        if not bool(((order >= 0) & (order < 1)).all()):
            raise ValueError(f"zeroth_order is {order.tolist()}; it must be 0 or more, below 1")
        if neutral is None:
            point = torch.zeros_like(whole)
            point[:, whole.shape[1] // 2, whole.shape[2] // 2] = 1
        else:
            point = _as_double("neutral", neutral, 3)
        if point.shape != whole.shape:
            raise ValueError(
                f"neutral is {tuple(point.shape)} and psfs {tuple(whole.shape)}; they must be alike"
            )
        for one in (*whole, *point):
            require_psf(one)
        return cls._of_parts(whole, point, order.expand(bands), shares, tuple(pattern), channels)

    @classmethod
    def _of_parts(
        cls,
        whole: torch.Tensor,
        neutral: torch.Tensor,
        order: torch.Tensor,
        response: torch.Tensor,
        pattern: tuple[str, ...],
        channels: str,
    ) -> SnapshotModel:
        """Take the zeroth order off snapshot PSFs of any sum, and gather a model of the rest."""
        whole, neutral = (one / one.sum((1, 2), keepdim=True) for one in (whole, neutral))
        share = order[:, None, None]
        # This raises for a pattern with other letters than the channels'.
        filter_weights(pattern, response, channels, (len(pattern), len(pattern[0])))
        return cls(
            (whole - share * neutral) / (1 - share), neutral, order, response, pattern, channels
        )

    @property
    def bands(self) -> int:
        """The number of spectral bands of the snapshot camera."""
        return len(self.coded)

    @cached_property
    def layout(self) -> ParameterLayout:
        """The layout of the vector of the snapshot camera's deviations from nominal."""
        return ParameterLayout(self.bands, len(self.response) - 1)

    @property
    def margin(self) -> int:
        """The number of pixels by which the model's PSFs are larger on every side."""
        return _MARGIN + math.ceil(_MARGIN_SHARE * max(self.coded.shape[1:]) / 2)

    @cached_property
    def strongest(self) -> torch.Tensor:
        """The index of the channel with the strongest nominal response to each band, (bands,)."""
        return self.response.argmax(0)

    @cached_property
    def others(self) -> torch.Tensor:
        """The indices of each band's other channels, (channels - 1, bands)."""
        every = torch.arange(len(self.response))
        return torch.stack([every[every != one] for one in self.strongest]).mT

    def psfs(self, deviation: torch.Tensor) -> torch.Tensor:
        """Compute the snapshot camera's PSFs for a vector of deviations from nominal.

        Parameters
        ----------
        deviation : torch.Tensor, (layout.count,), float64
            See ParameterLayout.

        Returns
        -------
        torch.Tensor, (bands, rows + 2 margin, columns + 2 margin), float64
            PSF of each band, differentiable in `deviation`.
        """
        return self._psfs_of_bands(deviation[self.layout.band_places])

    def _psfs_of_bands(self, deviations: torch.Tensor) -> torch.Tensor:
        """Compute the snapshot camera's PSFs for each band's own deviations, (4, bands)."""
        stack = []
        for band, (order, growth, y, x) in enumerate(deviations.mT):
            centre, share = torch.stack([y, x]), self.zeroth_order[band] + order
            coded = move_psf(self.coded[band], 1 + growth, centre, self.margin)
            neutral = move_psf(self.neutral[band], 1.0, centre, self.margin)
            stack.append(share * neutral + (1 - share) * coded)
        return torch.stack(stack)

    def psf_slopes(self, deviation: torch.Tensor) -> torch.Tensor:
        """Compute the derivatives of the snapshot camera's PSFs by each band's own parameters.

        The result is (4, bands, rows, columns); see ParameterLayout.band_places. The pull-back of
        reverse differentiation is linear in the derivative of the output, so that its own
        derivative is the one along a parameter.
        """
        with torch.enable_grad():
            at = deviation.detach()[self.layout.band_places].requires_grad_()
            psfs = self._psfs_of_bands(at)
            output = torch.zeros_like(psfs, requires_grad=True)
            (pulled,) = torch.autograd.grad(psfs, at, output, create_graph=True)
            slopes = [
                torch.autograd.grad(one.sum(), output, retain_graph=True)[0] for one in pulled
            ]
        return torch.stack(slopes)

    def response_at(self, deviation: torch.Tensor) -> torch.Tensor:
        """Compute the snapshot camera's response for a vector of deviations from nominal.

        The result is (channels, bands), float64, and differentiable; each band keeps its sum.
        """
        logs = deviation[self.layout.log_ratios].reshape(-1, self.bands)
        factors = torch.ones_like(self.response).scatter(0, self.others, logs.exp())
        changed = self.response * factors
        return changed * (self.response.sum(0) / changed.sum(0))

    def response_slopes(self, deviation: torch.Tensor) -> torch.Tensor:
        """Compute the derivatives of the snapshot camera's response by each band's log ratios.

        The result is (channels - 1, channels, bands), in the order of `others`.
        """
        response = self.response_at(deviation)
        own = torch.eye(len(response), dtype=torch.float64)[self.others].transpose(1, 2)
        share = response.gather(0, self.others) / response.sum(0)
        return response * (own - share[:, None])

    def filters(self, response: torch.Tensor, shape: Sequence[int]) -> torch.Tensor:
        """Return the snapshot camera's share of each band at each pixel, (bands, rows, columns)."""
        weights: torch.Tensor = filter_weights(self.pattern, response, self.channels, shape)
        return weights

    def channel_masks(self, shape: Sequence[int]) -> torch.Tensor:
        """Return which pixels of the snapshot have each channel's filter, 1 or 0.

        The result is (channels, rows, columns), float64.
        """
        return self.filters(torch.eye(len(self.response), dtype=torch.float64), shape)


def _as_double(name: str, value: Any, axes: int) -> torch.Tensor:
    """Return a snapshot model's array as a tensor in double precision, with so many axes."""
    require_unmasked(value)
    tensor = torch.as_tensor(value).detach().to(torch.float64)
    require_finite(name, tensor)
    if tensor.ndim != axes:
        wanted = "(bands, rows, columns)" if axes == 3 else "(channels, bands)"
        raise ValueError(f"{name} is {tuple(tensor.shape)}; give {wanted}")
    return tensor
