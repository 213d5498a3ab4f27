"""Rate a pattern without a picture: expected PSNR after linear restoration over a depth range."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import torch

from optics.edof.dioptres import require_dioptres
from optics.edof.pattern_transfer import DepthTransfer
from optics.edof.spectral_criterion import error_level, known_depth_error, noise_variance
from optics.validation import require_finite


@dataclass(frozen=True)
class PatternRating:
    """Describe what linear restoration is expected to give behind a pattern, over depths.

    Attributes
    ----------
    blind : float
        Expected PSNR in dB of one filter for all depths.
    known_depth : float
        Expected PSNR in dB if the depth is known.
    least_known_depth : float
        The same at the worst of the depths.
    light : float
        Mean share of the light that reaches the window, 0 to 1.
    """

    blind: float
    known_depth: float
    least_known_depth: float
    light: float


@torch.no_grad()
def rate_pattern(
    transfer: DepthTransfer,
    phase: torch.Tensor,
    spectrum: torch.Tensor,
    noise: float,
    dioptres: Sequence[float],
) -> PatternRating:
    """Compute the expected PSNR of linear restoration behind a pattern, over depths.

    The OTFs are computed one by one, so that any number of depths fits in memory.

    Parameters
    ----------
    transfer : DepthTransfer
        Computes the OTFs.
    phase : torch.Tensor, (rows, columns)
        The pattern, radians.
    spectrum : torch.Tensor
        Power spectrum of the pictures on the frequencies of `transfer.grid`.
    noise : float
        Standard deviation of a pixel's noise, where white is 1.
    dioptres : sequence of float
        Depths, equally weighted.

    Returns
    -------
    PatternRating
        The rating.

    Raises
    ------
    ValueError
        If there is no depth, shapes don't fit, the pattern isn't finite, or the spectrum has no
        power.
    """
    require_dioptres("dioptres", dioptres)
    require_finite("phase", phase)
    shares, spectrum = (
        one.to(phase.device, torch.float64) for one in (transfer.grid.shares(), spectrum)
    )
    if not float(spectrum.sum()) > 0:
        raise ValueError("spectrum has no power; give that of pictures that aren't constant")
    found = (transfer(phase, (one,))[0] for one in dioptres)
    return rate_transfers(found, len(dioptres), spectrum, shares, noise)


def rate_transfers(
    transfers: Iterable[torch.Tensor],
    count: int,
    spectrum: torch.Tensor,
    shares: torch.Tensor,
    noise: float,
) -> PatternRating:
    """Compute the expected PSNR of linear restoration from OTFs at depths, taken one by one.

    Parameters
    ----------
    transfers : iterable of torch.Tensor, each (rows, columns)
        OTF at each depth, relative to the light of the open pupil; the depths weigh the same.
    count : int
        Number of the depths.
    spectrum, shares : torch.Tensor, (rows, columns)
        Power spectrum of the pictures, float64, and the frequencies' shares.
    noise : float
        Standard deviation of a pixel's noise, where white is 1.

    Returns
    -------
    PatternRating
        The rating.
    """
    memory = DepthMemory(count, spectrum, noise)
    known, light = [], 0.0
    for one in transfers:
        known.append(float(known_depth_error(one[None], spectrum, shares, noise)))
        light += float(one[0, 0].real) / count
        memory.add(one)
    blind, mean = memory.error(shares), sum(known) / len(known)
    return PatternRating(error_level(blind), error_level(mean), error_level(max(known)), light)


class DepthMemory:
    """Sums over depth of OTFs and of their squared moduli, of which the blind filter is made.

    Parameters
    ----------
    count : int
        Number of depths that are summed.
    spectrum : torch.Tensor, (rows, columns)
        Power spectrum of the pictures, float64.
    noise : float
        Standard deviation of a pixel's noise.
    """

    def __init__(self, count: int, spectrum: torch.Tensor, noise: float) -> None:
        self.count, self._spectrum, self._variance = count, spectrum, noise_variance(noise)
        self.total: torch.Tensor = torch.zeros_like(spectrum)
        self.power: torch.Tensor = torch.zeros_like(spectrum)

    def add(self, transfer: torch.Tensor, sign: float = 1.0) -> None:
        """Add one depth's OTF to the sums, or with a sign of -1 take it away again."""
        wide = transfer.to(torch.complex128 if transfer.is_complex() else torch.float64)
        self.total = self.total + sign * wide
        self.power += sign * (wide * wide.conj()).real

    def filter(self) -> torch.Tensor:
        """Return the linear filter of least expected error at the depths of the sums of OTFs."""
        spectrum, mean = self._spectrum, self.total / self.count
        return spectrum * mean.conj() / (spectrum * self.power / self.count + self._variance)

    def error(self, shares: torch.Tensor) -> float:
        """Return the expected squared error per pixel of that filter at the depths of the sums."""
        spectrum, mean = self._spectrum, self.total / self.count
        signal = spectrum * (mean * mean.conj()).real
        lost = spectrum * (1 - signal / (spectrum * self.power / self.count + self._variance))
        return float((shares * lost).sum())
