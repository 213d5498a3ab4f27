"""The operator A^T A of a forward operator A, and its inverses, where they have a closed form."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import torch

from optics.fourier import irfft2, rfft2

Domain = Literal["pixels", "frequencies", "bands"]


@dataclass(frozen=True, eq=False)
class GramOperator:
    """The operator A^T A of a forward operator A, where it is diagonal or an outer product.

    Parameters
    ----------
    domain : {"pixels", "frequencies", "bands"}
        "pixels": each pixel is multiplied by its weight. "frequencies": each coefficient of the
        picture's rfft2 is multiplied by its weight. "bands": at each pixel, the bands are
        multiplied by the outer product of the pixel's weights with themselves.
    weights : torch.Tensor
        The weights: (..., rows, columns) for "pixels", (..., rows, columns // 2 + 1) for
        "frequencies", (bands, rows, columns) for "bands".
    shape : tuple of int
        The picture's (rows, columns).
    diagonal : torch.Tensor, optional
        Only for "bands", where it makes the operator an inverse: the factor of each value, from
        which the outer product is subtracted. The outer product alone if None.
    """

    domain: Domain
    weights: torch.Tensor
    shape: tuple[int, int]
    diagonal: torch.Tensor | None = None

    @property
    def largest_eigenvalue(self) -> float:
        """The largest eigenvalue of the operator A^T A."""
        each = self.weights.square().sum(-3) if self.domain == "bands" else self.weights
        return float(each.max())

    def __call__(self, x: torch.Tensor) -> torch.Tensor:
        """Apply the operator A^T A to `x`."""
        if self.domain == "frequencies":
            return irfft2(rfft2(x) * self.weights, self.shape)
        if self.domain == "pixels":
            return x * self.weights
        product = self.weights * (self.weights * x).sum(-3, keepdim=True)
        return product if self.diagonal is None else self.diagonal * x - product

    def inverse(self, penalty: float | torch.Tensor) -> GramOperator:
        """Compute the inverse of A^T A + penalty, with A a forward operator.

        Parameters
        ----------
        penalty : float or torch.Tensor
            Positive; one number, or one for each band, pixel or frequency, of a shape that
            broadcasts to that of `weights`.

        Returns
        -------
        GramOperator
            The inverse, which needs no more memory than A^T A.

        Raises
        ------
        ValueError
            If `penalty` isn't positive everywhere.
        """
        added = torch.as_tensor(penalty, dtype=self.weights.dtype)
        least = float(added.min())
        if not least > 0:
            raise ValueError(f"penalty is {least:g}; it must be positive for an inverse to exist")
        if self.domain != "bands":
            return GramOperator(self.domain, (self.weights + added).reciprocal_(), self.shape)
        # The Sherman-Morrison formula inverts an outer product plus a diagonal matrix.
        along = self.weights / added
        along = along * (1 + (self.weights * along).sum(-3, keepdim=True)).rsqrt_()
        return GramOperator("bands", along, self.shape, added.reciprocal())

    def after_diagonal(self, domain: Domain, values: torch.Tensor) -> GramOperator | None:
        """Return the Gram operator of A D, where D is diagonal in pixels or in frequencies.

        `values` are D's diagonal. The result is None where it has no closed form.
        """
        if domain == self.domain:
            return GramOperator(domain, self.weights * squared_modulus(values), self.shape)
        if (domain, self.domain) == ("pixels", "bands"):
            return GramOperator("bands", self.weights * values, self.shape)
        return None


def squared_modulus(values: torch.Tensor) -> torch.Tensor:
    """Return the squared modulus of an operator's real diagonal, or of a complex spectrum."""
    if not values.is_complex():
        return values.square()
    return values.real.square().addcmul_(values.imag, values.imag)
