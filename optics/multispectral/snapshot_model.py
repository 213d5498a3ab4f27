"""The model of a snapshot camera, whose PSFs and response follow from parameters."""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any

import torch

from optics.inverse import filter_weights
from optics.inverse.observation import require_psf
from optics.validation import as_finite_array, require_positive


@dataclass(frozen=True)
class ModelUncertainty:
    """How well the nominal model of a camera is known: standard deviations.

    Parameters
    ----------
    zeroth_order, zeroth_order_of_band : float, default 0.05, 0.015
        Of the zeroth order's share, an error that all bands have in common, and of each by itself.
    scale : float, default 0.01
        Of the common size of all coded PSFs, relative.
    centre : float, default 0.5
        Of each coordinate of each band's PSF centre, in pixels.
    response : float, default 0.06
        Of each channel's response to each band, relative.

    Raises
    ------
    ValueError
        For a number that isn't positive and finite.
    """

    zeroth_order: float = 0.05
    zeroth_order_of_band: float = 0.015
    scale: float = 0.01
    centre: float = 0.5
    response: float = 0.06

    def __post_init__(self) -> None:
        for one in fields(self):
            require_positive(one.name, getattr(self, one.name), "")


@dataclass(frozen=True)
class ParameterLayout:
    """Where each parameter of a model stands in a vector of deviations from nominal.

    The vector holds the zeroth order's share of each band, the relative size of all coded PSFs, the
    centres' y and then x of each band in pixels, and the natural logarithms of each band's response
    of each other channel over that of its strongest channel: `ratios` of them for each band.
    """

    bands: int
    ratios: int

    @property
    def count(self) -> int:
        return (3 + self.ratios) * self.bands + 1

    @property
    def zeroth_orders(self) -> slice:
        return slice(0, self.bands)

    @property
    def scale(self) -> int:
        return self.bands

    @property
    def centres(self) -> slice:
        return slice(self.bands + 1, 3 * self.bands + 1)

    @property
    def log_ratios(self) -> slice:
        return slice(3 * self.bands + 1, self.count)

    @cached_property
    def band_places(self) -> torch.Tensor:
        """Places of what each band's PSF depends on, (4, bands).

        The rows are zeroth order, size of the coded PSF, centre's y and centre's x.
        """
        band = torch.arange(self.bands)
        y = self.centres.start + band
        return torch.stack([band, torch.full_like(band, self.scale), y, y + self.bands])

    @cached_property
    def ratio_places(self) -> torch.Tensor:
        """Places of the response's ratios, (ratios, bands)."""
        return torch.arange(self.log_ratios.start, self.count).reshape(self.ratios, self.bands)

    def prior_covariance(self, uncertainty: ModelUncertainty) -> torch.Tensor:
        """Return the covariance of the nominal parameters, (count, count), float64.

        Errors of a band's channels are independent, so that the ratios to one channel share its
        error.
        """
        covariance = torch.zeros(self.count, self.count, dtype=torch.float64)
        one = torch.eye(self.bands, dtype=torch.float64)
        orders, centres, ratios = self.zeroth_orders, self.centres, self.log_ratios
        covariance[orders, orders] = uncertainty.zeroth_order**2
        covariance[orders, orders] += uncertainty.zeroth_order_of_band**2 * one
        covariance[self.scale, self.scale] = uncertainty.scale**2
        covariance[centres, centres] = uncertainty.centre**2 * torch.eye(2 * self.bands).to(one)
        shared = torch.ones(self.ratios, self.ratios, dtype=torch.float64)
        own = torch.eye(self.ratios, dtype=torch.float64)
        covariance[ratios, ratios] = uncertainty.response**2 * torch.kron(shared + own, one)
        return covariance

    def shift_removal(self, shares: Sequence[torch.Tensor]) -> torch.Tensor:
        """Return the matrix that takes the common shift off, (count, count).

        `shares` are the bands' shares, (bands,), in what counts as the common shift along y and
        along x; each sums to 1.
        """
        matrix = torch.eye(self.count, dtype=torch.float64)
        for axis, share in enumerate(shares):
            first = self.centres.start + axis * self.bands
            matrix[first : first + self.bands, first : first + self.bands] -= share
        return matrix


def move_psf(
    psf: torch.Tensor, scale: torch.Tensor | float, centre: torch.Tensor, margin: int
) -> torch.Tensor:
    """Scale and move a PSF by cubic B-splines, differentiably in `scale` and `centre`.

    `psf` is (rows, columns), float64, with its origin at n // 2, and `centre` is the place (y, x)
    of the result's origin relative to the middle pixel. The result is `margin` pixels larger on
    every side. Its sum is that of `psf`, unless light leaves the array.

    Of PSFs that are sharper than the sampling theorem asks for, as measured ones are, cubic splines
    shift the pixels' light more exactly than phases of the spectrum: with a ring or peak of a
    Gaussian profile of 0.5 or 0.6 pixels, integrated over pixels, the measured relative error is 5
    or 3 % instead of 15 or 7 %. See M. Unser, "Splines: a perfect fit for signal and image
    processing", 1999, doi 10.1109/79.799930.
    """

    def axis_matrix(length: int, shift: torch.Tensor) -> torch.Tensor:
        knots = torch.arange(length, dtype=torch.float64) - length // 2
        pixels = torch.arange(length + 2 * margin, dtype=torch.float64) - length // 2 - margin
        places = (pixels - shift) / scale
        # The light per pixel falls as the PSF grows, once for each axis.
        return _cubic_spline(places[:, None] - knots) @ _coefficient_matrix(length) / scale

    rows, columns = psf.shape
    return axis_matrix(rows, centre[0]) @ psf @ axis_matrix(columns, centre[1]).mT


@functools.lru_cache(maxsize=16)
def _coefficient_matrix(length: int) -> torch.Tensor:
    """Return the matrix from samples along an axis to coefficients of cubic splines."""
    knots = torch.arange(length, dtype=torch.float64)
    return torch.linalg.inv(_cubic_spline(knots[:, None] - knots))


def _cubic_spline(distance: torch.Tensor) -> torch.Tensor:
    """Return the cubic B-spline at distances in pixels from its knot."""
    far = distance.abs()
    near = 2 / 3 - far.square() + far**3 / 2
    return torch.where(far < 1, near, (2 - far).clamp(min=0) ** 3 / 6)


# Pixels, and share of half a side, by which modelled PSFs are larger than the nominal ones on every
# side: room for shifts and for growth by a few percent.
_MARGIN, _MARGIN_SHARE = 2, 0.03


@dataclass(frozen=True, eq=False)
class SnapshotModel:
    """A snapshot spectral camera as it is meant to be, and how it may differ from that.

    A band's PSF is ``z_n p_n + (1 - z_n) q_n``, with the zeroth order's share z_n, the neutral PSF
    p_n, which is that without a pattern, and the coded PSF q_n. Both are moved to the band's
    centre, and the coded PSFs are stretched by a common scale. A band's response keeps its sum over
    the channels, while the ratios between the channels vary. `create` makes a model of arrays of
    any kind, and describes them; here all are float64.

    Attributes
    ----------
    coded, neutral : torch.Tensor, (bands, rows, columns)
        Coded part of the PSF of each band, and its neutral PSF, each with a sum of 1.
    zeroth_order : torch.Tensor, (bands,)
        Nominal share of the zeroth order.
    response : torch.Tensor, (channels, bands)
        Nominal response of each channel to each band.
    pattern, channels : tuple of str, str
        Rows of one letter per pixel that repeat; the channels' letters in the response's order.
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
        """Describe a camera by its nominal PSFs and response.

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
        pattern, channels : sequence of str, str, default ("RG", "GB"), "RGB"
            Rows of one letter per pixel that repeat from the first pixel on; the channels' letters.

        Returns
        -------
        SnapshotModel
            The model, whose deviation of 0 gives these PSFs and this response.

        Raises
        ------
        ValueError
            For shapes that don't fit, or values that aren't finite or in their range.
        """
        whole = as_finite_array("psfs", psfs, "(bands, rows, columns)")
        shares = as_finite_array("response", response, "(channels, bands)")
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
            point = as_finite_array("neutral", neutral, "(bands, rows, columns)")
        if point.shape != whole.shape:
            raise ValueError(
                f"neutral is {tuple(point.shape)} and psfs {tuple(whole.shape)}; they must be alike"
            )
        for one in (*whole, *point):
            require_psf(one)
        whole, point = (one / one.sum((1, 2), keepdim=True) for one in (whole, point))
        order = order.expand(bands)
        coded = (whole - order[:, None, None] * point) / (1 - order[:, None, None])
        # This raises for a pattern with other letters than the channels'.
        filter_weights(pattern, shares, channels, (len(pattern), len(pattern[0])))
        return cls(coded, point, order, shares, tuple(pattern), channels)

    @property
    def bands(self) -> int:
        return len(self.coded)

    @cached_property
    def layout(self) -> ParameterLayout:
        return ParameterLayout(self.bands, len(self.response) - 1)

    @property
    def margin(self) -> int:
        """Number of pixels by which moved PSFs are larger on every side."""
        return _MARGIN + math.ceil(_MARGIN_SHARE * max(self.coded.shape[1:]) / 2)

    @cached_property
    def strongest(self) -> torch.Tensor:
        """Index of the channel with the strongest nominal response to each band, (bands,)."""
        return self.response.argmax(0)

    @cached_property
    def others(self) -> torch.Tensor:
        """Indices of each band's other channels, (channels - 1, bands)."""
        every = torch.arange(len(self.response))
        return torch.stack([every[every != one] for one in self.strongest]).mT

    def psfs(self, deviation: torch.Tensor) -> torch.Tensor:
        """Compute the PSFs for a vector of deviations from nominal, (layout.count,), float64.

        The result is (bands, rows + 2 margin, columns + 2 margin), float64, and differentiable.
        """
        return self._psfs_of_bands(deviation[self.layout.band_places])

    def _psfs_of_bands(self, deviations: torch.Tensor) -> torch.Tensor:
        """Compute the PSFs for each band's own deviations, those of band_places."""
        stack = []
        for band, (order, growth, y, x) in enumerate(deviations.mT):
            centre, share = torch.stack([y, x]), self.zeroth_order[band] + order
            coded = move_psf(self.coded[band], 1 + growth, centre, self.margin)
            neutral = move_psf(self.neutral[band], 1.0, centre, self.margin)
            stack.append(share * neutral + (1 - share) * coded)
        return torch.stack(stack)

    def psf_slopes(self, deviation: torch.Tensor) -> torch.Tensor:
        """Compute the derivatives of the PSFs by each band's own parameters.

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
        """Compute the response for a vector of deviations from nominal.

        The result is (channels, bands), float64, and differentiable; each band keeps its sum.
        """
        logs = deviation[self.layout.log_ratios].reshape(-1, self.bands)
        factors = torch.ones_like(self.response).scatter(0, self.others, logs.exp())
        changed = self.response * factors
        return changed * (self.response.sum(0) / changed.sum(0))

    def response_slopes(self, deviation: torch.Tensor) -> torch.Tensor:
        """Compute the derivatives of the response by each band's log ratios.

        The result is (channels - 1, channels, bands), in the order of `others`.
        """
        response = self.response_at(deviation)
        own = torch.eye(len(response), dtype=torch.float64)[self.others].transpose(1, 2)
        share = response.gather(0, self.others) / response.sum(0)
        return response * (own - share[:, None])

    def filters(self, response: torch.Tensor, shape: Sequence[int]) -> torch.Tensor:
        """Return the share of each band that each pixel transmits, (bands, rows, columns)."""
        return filter_weights(self.pattern, response, self.channels, shape)

    def channel_masks(self, shape: Sequence[int]) -> torch.Tensor:
        """Return 1 where pixels have each channel's filter, else 0; (channels, rows, columns)."""
        return self.filters(torch.eye(len(self.response), dtype=torch.float64), shape)
