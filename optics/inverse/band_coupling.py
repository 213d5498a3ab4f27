"""How a prior couples the bands of a picture: axes, weights and joint lengths."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import torch

from optics.validation import require_finite

# Power of a component's typical size whose inverse is its scale. Of 0, 0.5, 0.75 and 1, the best
# for three measured scenes of 24 and 11 bands, which served no other purpose.
_WHITENING = 0.75

# Least mean square of a component that counts for its weight, relative to the largest one's.
_LEAST_POWER = 1e-6


@dataclass(frozen=True, eq=False)
class BandCoupling:
    """Axes and weights by which a prior penalises the bands of a picture jointly.

    The bands are transformed to components. The joint length of the derivatives of each group of
    components is penalised, times the group's weight. Raises ValueError if weights differ within a
    group.

    weights: weight of each component, (bands,), float64, the same within a group.
    groups: number of components in each group, in the components' order.
    axes: orthonormal matrix from bands to components, (bands, bands), float64; if None, the
        components are the bands.
    scales: factor of each component, (bands,), float64: what is rare among spectra has a larger
        one. All are 1 if None.
    """

    weights: torch.Tensor
    groups: tuple[int, ...]
    axes: torch.Tensor | None = None
    scales: torch.Tensor | None = None

    def __post_init__(self) -> None:
        for part in torch.split(self.weights, list(self.groups)):
            if not bool((part == part[0]).all()):
                raise ValueError(
                    f"weights of a group are {part.tolist()}; they must be equal. Give scales to "
                    "the components"
                )

    @classmethod
    def separate(cls, bands: int) -> BandCoupling:
        """Treat each band on its own."""
        return cls(torch.ones(bands, dtype=torch.float64), (1,) * bands)

    @classmethod
    def luminance_chrominance(cls, bands: int, luminance: float) -> BandCoupling:
        """Penalise the luminance, with this weight, and jointly all colour differences.

        The colour differences have the weight 1 (Condat and Mosaddegh 2012, doi
        10.1109/ICIP.2012.6467476), and so has a single band.
        """
        if bands == 1:
            return cls.separate(1)
        weights = torch.ones(bands, dtype=torch.float64)
        weights[0] = luminance
        return cls(weights, (1, bands - 1), helmert_matrix(bands))

    @classmethod
    def spectral(cls, spectra: torch.Tensor) -> BandCoupling:
        """Penalise the joint length of the spectra's principal components, rarer ones more.

        Raises ValueError for spectra of another shape, fewer of them than bands, or that aren't
        finite or are all 0.

        spectra: (samples, bands), of any unit; of materials that differ from each other.
        """
        require_finite("spectra", spectra)
        if spectra.ndim != 2 or not float(spectra.abs().max()) > 0:
            raise ValueError(
                f"spectra are {tuple(spectra.shape)}; give (samples, bands) that aren't all 0"
            )
        samples, bands = spectra.shape
        if samples < bands:
            raise ValueError(f"spectra are {samples} of {bands} bands; give {bands} or more")
        spectra = spectra.to(torch.float64) / spectra.abs().max()
        return cls.of_covariance(spectra.mT @ spectra)

    @classmethod
    def of_covariance(cls, covariance: torch.Tensor) -> BandCoupling:
        """Do so by the spectra's covariance or second moments, (bands, bands), on any scale."""
        sizes, axes = torch.linalg.eigh(covariance.to(torch.float64))
        sizes, axes = sizes.flip(0), axes.flip(1).mT.contiguous()
        power = (sizes / sizes[0]).clamp(min=_LEAST_POWER)
        scales = power ** (-_WHITENING / 2)
        # With a geometric mean of 1, the weight of the whole prior means the same for all spectra.
        scales = scales / scales.log().mean().exp()
        return cls(torch.ones_like(scales), (len(scales),), axes, scales)

    @property
    def bands(self) -> int:
        return len(self.weights)

    @cached_property
    def _matrix(self) -> torch.Tensor | None:
        """The matrix from bands to scaled components; None for the identity."""
        if self.scales is None:
            return self.axes
        return torch.diag(self.scales) if self.axes is None else self.scales[:, None] * self.axes

    def components(self, x: torch.Tensor) -> torch.Tensor:
        """Return the scaled components of a picture, (bands, rows, columns)."""
        return x if self._matrix is None else transform_bands(self._matrix, x)

    def components_adjoint(self, components: torch.Tensor) -> torch.Tensor:
        return components if self._matrix is None else transform_bands(self._matrix.mT, components)

    def lengths(self, squares: torch.Tensor) -> torch.Tensor:
        """Return the weighted joint length of each group, (groups, ...).

        squares: squared derivatives of each component, (bands, ...).
        """
        if self.bands == 1:
            return squares.sqrt() * float(self.weights[0])
        weights = self.weights.square().to(squares.dtype).reshape(-1, *(1,) * (squares.ndim - 1))
        return torch.stack(
            [part.sum(0) for part in torch.split(squares * weights, list(self.groups))]
        ).sqrt_()

    def group_totals(self, values: torch.Tensor) -> torch.Tensor:
        """Return the sum of its group's values for each component."""
        each = [
            part.sum(0, keepdim=True).expand_as(part)
            for part in torch.split(values, list(self.groups))
        ]
        return torch.cat(each)

    def removed_share(self, squares: torch.Tensor, threshold: float, power: float) -> torch.Tensor:
        """Return the share of each component that shrinks away, in the place of `squares`.

        It is the proximal step of the joint lengths of derivatives to a power. A length of
        `threshold` or less, for a weight of 1, is set to 0 (Chartrand 2009, doi
        10.1109/ISBI.2009.5192999, for powers below 1). The result has the shape of `squares`, or
        (1, rows, columns) if all components shrink alike.

        squares: squared derivatives, (bands, rows, columns); overwritten.
        """

        def removed(squares: torch.Tensor, weight: float | torch.Tensor) -> torch.Tensor:
            share = squares.rsqrt_().mul_(threshold)
            if power != 1:
                share.pow_(2 - power)
            if isinstance(weight, torch.Tensor) or weight != 1:
                share.mul_(weight**power)
            return share.clamp_(max=1)

        if set(self.groups) == {1}:
            return removed(squares, self.weights.to(squares.dtype)[:, None, None])
        weights = [float(part[0]) for part in torch.split(self.weights, list(self.groups))]
        if len(self.groups) == 1:
            return removed(squares.sum(0, keepdim=True), weights[0])
        for part, weight in zip(torch.split(squares, list(self.groups)), weights, strict=True):
            part.copy_(removed(part.sum(0, keepdim=True), weight))
        return squares


def helmert_matrix(bands: int) -> torch.Tensor:
    """Compute Helmert's orthonormal matrix of colour axes, (bands, bands).

    The first row is the mean of all bands, which is the luminance. Row k is the difference between
    band k and the mean of the bands before it.
    """
    rows = [torch.full((bands,), 1 / math.sqrt(bands), dtype=torch.float64)]
    for k in range(1, bands):
        row = torch.zeros(bands, dtype=torch.float64)
        row[:k], row[k] = 1.0, -float(k)
        rows.append(row / math.sqrt(k * (k + 1)))
    return torch.stack(rows)


def transform_bands(matrix: torch.Tensor, x: torch.Tensor) -> torch.Tensor:
    """Multiply the bands of each pixel by a matrix."""
    return torch.tensordot(matrix.to(x.dtype), x, 1)
