"""What may be wrong in the model of a snapshot spectral camera: parameters and uncertainty."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cached_property

import torch

from optics.validation import require_positive


@dataclass(frozen=True)
class ModelUncertainty:
    """How well the nominal model of a snapshot camera is known: standard deviations.

    Parameters
    ----------
    zeroth_order : float, default 0.05
        Of the zeroth order's share, an error that all bands have in common.
    zeroth_order_of_band : float, default 0.015
        Of the zeroth order's share, an error of each band on its own.
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
    """Where each parameter of a snapshot model stands in a vector of deviations from nominal.

    The vector holds the zeroth order's share of each band, the relative size of all coded PSFs, the
    centres' y and then x of each band in pixels, and the natural logarithms of each band's response
    of each other channel over that of its strongest channel.

    Attributes
    ----------
    bands : int
        Number of spectral bands.
    ratios : int
        Number of ratios of each band: that of the channels less 1.
    """

    bands: int
    ratios: int

    @property
    def count(self) -> int:
        """The number of parameters of the snapshot model."""
        return (3 + self.ratios) * self.bands + 1

    @property
    def zeroth_orders(self) -> slice:
        """The places of the zeroth orders' shares in the snapshot model's vector."""
        return slice(0, self.bands)

    @property
    def scale(self) -> int:
        """The place of the coded PSFs' relative size in the snapshot model's vector."""
        return self.bands

    @property
    def centres(self) -> slice:
        """The places of the PSFs' centres in the snapshot model's vector: all y, then all x."""
        return slice(self.bands + 1, 3 * self.bands + 1)

    @property
    def log_ratios(self) -> slice:
        """The places of the logarithms of the response's ratios in the snapshot model's vector."""
        return slice(3 * self.bands + 1, self.count)

    @cached_property
    def band_places(self) -> torch.Tensor:
        """The places of what each band's PSF depends on in a snapshot model's vector, (4, bands).

        The rows are zeroth order, size of the coded PSF, centre's y and centre's x.
        """
        band = torch.arange(self.bands)
        first = self.centres.start
        scale = torch.full_like(band, self.scale)
        return torch.stack([band, scale, first + band, first + self.bands + band])

    @cached_property
    def ratio_places(self) -> torch.Tensor:
        """The places of the response's ratios in a snapshot model's vector, (ratios, bands)."""
        every = torch.arange(self.log_ratios.start, self.log_ratios.stop)
        return every.reshape(self.ratios, self.bands)

    def prior_covariance(self, uncertainty: ModelUncertainty) -> torch.Tensor:
        """Return the covariance of a nominal snapshot model's parameters, (count, count), float64.

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

    @cached_property
    def common_shifts(self) -> torch.Tensor:
        """The shifts of all PSF centres together in a snapshot model, (2, count), float64."""
        shifts = torch.zeros(2, self.count, dtype=torch.float64)
        first = self.centres.start
        for axis in (0, 1):
            shifts[axis, first + axis * self.bands : first + (axis + 1) * self.bands] = 1
        return shifts

    def shift_removal(self, shares: Sequence[torch.Tensor]) -> torch.Tensor:
        """Return the matrix that takes a snapshot model's common shift off, (count, count).

        `shares` are the bands' shares, (bands,), in what counts as the common shift along y and
        along x; each sums to 1.
        """
        matrix = torch.eye(self.count, dtype=torch.float64)
        for axis, (share, shift) in enumerate(zip(shares, self.common_shifts, strict=True)):
            first = self.centres.start + axis * self.bands
            matrix[:, first : first + self.bands] -= torch.outer(shift, share)
        return matrix
