"""Mix the light that a panel leaves unmodulated into transfer functions and a decoder's front."""

from __future__ import annotations

from dataclasses import dataclass

import torch

from optics.edof.learned.wiener_front import WienerFront
from optics.edof.spectral_criterion import mean_transfer


@dataclass(frozen=True, eq=False)
class DepthStatistics:
    """Hold means over depth, of which the front follows for any share of unmodulated light.

    The unmodulated light adds to the modulated as if incoherent (thesis section 5.6): with a share
    u, a transfer function is (1 - u) H + u H0, where H0 is that of a flat pattern. Its mean and its
    mean squared modulus over depths follow from those of H and H0, and from the mean of H H0*.

    Attributes
    ----------
    mean, power : torch.Tensor, (n, n // 2 + 1)
        Mean over depths of H, complex, and of its squared modulus.
    flat_mean, flat_power : torch.Tensor, (n, n // 2 + 1)
        The same of H0.
    product : torch.Tensor, (n, n // 2 + 1)
        Mean of the real part of H times H0's conjugate.
    spectrum : torch.Tensor, (n, n // 2 + 1)
        Power spectrum of the pictures.
    """

    mean: torch.Tensor
    power: torch.Tensor
    flat_mean: torch.Tensor
    flat_power: torch.Tensor
    product: torch.Tensor
    spectrum: torch.Tensor

    @classmethod
    def of_transfers(
        cls, transfers: torch.Tensor, flat: torch.Tensor, spectrum: torch.Tensor
    ) -> DepthStatistics:
        """Compute the means of a pattern's and a flat pattern's transfer functions over depths.

        transfers, flat: (depths, n, n // 2 + 1), complex.
        """
        mean, power = mean_transfer(transfers)
        flat_mean, flat_power = mean_transfer(flat)
        product = (transfers * flat.conj()).real.double().mean(0)
        return cls(
            mean.to(torch.complex64),
            power.float(),
            flat_mean.to(torch.complex64),
            flat_power.float(),
            product.float(),
            spectrum.to(product.device, torch.float32),
        )

    def front(self, shares: torch.Tensor) -> WienerFront:
        """Return the front for captures with some shares of unmodulated light, (captures,)."""
        kept, added = (one.to(self.power)[:, None, None] for one in (1 - shares, shares))
        return WienerFront(
            kept * self.mean + added * self.flat_mean,
            kept**2 * self.power + 2 * kept * added * self.product + added**2 * self.flat_power,
            self.spectrum,
        )


def add_unmodulated_light(
    transfers: torch.Tensor, flat: torch.Tensor, shares: torch.Tensor | float
) -> torch.Tensor:
    """Return transfer functions of a pattern with shares of unmodulated light added.

    transfers, flat: (..., n, n // 2 + 1), of the pattern and of a flat one at the same depths.
    shares: from 0 to 1, a number or (...).
    """
    if isinstance(shares, torch.Tensor):
        shares = shares.to(transfers.real)[..., None, None]
    return (1 - shares) * transfers + shares * flat
