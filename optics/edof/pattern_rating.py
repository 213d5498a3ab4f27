"""Rate a pattern without a picture, and hold a search for a better one."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import torch

from optics.edof.dioptres import require_dioptres
from optics.edof.pattern_transfer import DepthTransfer
from optics.edof.spectral_criterion import error_level, known_depth_error, noise_variance
from optics.validation import require_count, require_finite, require_positive


@dataclass(frozen=True)
class PatternRating:
    """What linear restoration is expected to give behind a pattern, over depths.

    Attributes
    ----------
    blind, known_depth, least_known_depth : float
        Expected PSNR in dB: of one filter for all depths, if the depth is known, and the same at
        the worst of the depths.
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

    Parameters
    ----------
    transfer : DepthTransfer
        Computes the OTFs, one by one, so that any number of depths fits in memory.
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
        What linear restoration is expected to give.

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
    """Compute the expected PSNR of linear restoration from OTFs at `count` depths, one by one.

    transfers: OTF at each depth, (rows, columns), relative to the light of the open pupil; the
        depths weigh the same.
    spectrum, shares: power spectrum of the pictures, float64, and the frequencies' shares.
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
    """Sums over `count` depths of OTFs and of their squared moduli, for the blind filter.

    spectrum: power spectrum of the pictures, (rows, columns), float64.
    noise: standard deviation of a pixel's noise, where white is 1.
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
        """Return the linear filter of least expected error at the summed depths."""
        spectrum, mean = self._spectrum, self.total / self.count
        return spectrum * mean.conj() / (spectrum * self.power / self.count + self._variance)

    def error(self, shares: torch.Tensor) -> float:
        """Return the expected squared error per pixel of that filter at the summed depths."""
        spectrum, mean = self._spectrum, self.total / self.count
        signal = spectrum * (mean * mean.conj()).real
        lost = spectrum * (1 - signal / (spectrum * self.power / self.count + self._variance))
        return float((shares * lost).sum())


@dataclass(frozen=True)
class SearchSettings:
    """Tune the search for a pattern.

    Attributes
    ----------
    rate : float
        Largest change of a parameter per step, about; radians for phases. Measured for the blind
        criterion, a quarter of a panel and rings to start from, after 600 steps: .05, .1 and .2
        reach the same to .04 dB, .1 the most.
    depths, parts : int
        Depths per step, and equal parts of the depth range from which they are drawn in turn.
        Measured as above, in equal time: 1 and 6 depths are .07 dB worse than 2.
    warm_up : int
        Steps over which the rate grows from zero; chosen.
    last_rate : float
        Rate of the last step, relative to the largest; it falls as a cosine. Chosen.
    momentum, square_momentum : float
        Adam's decay rates per step of the gradient's mean and mean square. Measured: .8 to .9 and
        .95 to .999 give the same to .01 dB.
    band_power : float
        Power of the mean of several wavelengths' errors; 1 is the plain mean. Chosen: an error that
        is a tenth larger counts nine times as much.
    """

    rate: float = 0.1
    depths: int = 2
    parts: int = 48
    warm_up: int = 20
    last_rate: float = 0.02
    momentum: float = 0.9
    square_momentum: float = 0.99
    band_power: float = 24.0

    def __post_init__(self) -> None:
        require_positive("rate", self.rate, "")
        for name in ("depths", "parts", "warm_up"):
            require_count(name, getattr(self, name))
        if self.depths > self.parts:
            raise ValueError(f"depths is {self.depths}; choose at most the {self.parts} parts")


@dataclass(eq=False)
class SearchState:
    """The state of a search, with which it goes on bit by bit as it would have.

    `design_pattern` changes it in place after each step, so that it is current when the search is
    cancelled. All entries are numbers, lists, tensors and dictionaries of these, for `torch.save`.

    Attributes
    ----------
    step, skipped : int
        Steps taken, and those without a finite gradient.
    parameters : torch.Tensor
        Current parameters, float64.
    optimiser, generator : dict and torch.Tensor
        The states of Adam and of the random generator.
    pending : list of int
        Parts of the depth range that are still to be drawn from in this turn.
    remembered : list of torch.Tensor
        For each wavelength and condition, the OTF of each part of the range; empty for the known
        depth.
    sums : list of tuple of torch.Tensor
        For each filter, their sum, and that of their squared moduli.
    band_errors, errors : list of float
        Errors of the wavelengths and conditions, each averaged over its last steps; and those of
        the last steps with the depth known, from which `history` is estimated.
    history : list of tuple of (int, float)
        Step and estimated level in dB, from the depths drawn last.
    """

    step: int = 0
    parameters: torch.Tensor | None = None
    optimiser: dict[str, Any] = field(default_factory=dict)
    generator: torch.Tensor | None = None
    pending: list[int] = field(default_factory=list)
    remembered: list[torch.Tensor] = field(default_factory=list)
    sums: list[tuple[torch.Tensor, torch.Tensor]] = field(default_factory=list)
    band_errors: list[float] = field(default_factory=list)
    errors: list[float] = field(default_factory=list)
    history: list[tuple[int, float]] = field(default_factory=list)
    skipped: int = 0


@dataclass(frozen=True, eq=False)
class DesignResult:
    """A designed pattern, with its ratings and its search.

    Attributes
    ----------
    phase, parameters : torch.Tensor
        Unwrapped phase in radians, (rows, columns), float64, of the shape that the transfer takes;
        and what makes it.
    rating, start_rating : PatternRating
        Expected PSNR at fixed depths, `optics.edof.pattern_search.RATED_DEPTHS`, of the pattern and
        of the one that the search started from.
    history : tuple of tuple of (int, float)
        Step and estimated level in dB, from the depths drawn last. It lags: see `rating`.
    skipped : int
        Steps that were skipped because the gradient wasn't finite.
    state : SearchState
        The state after the last step.
    further_ratings : tuple of PatternRating
        Expected PSNR at the further wavelengths.
    """

    phase: torch.Tensor
    parameters: torch.Tensor
    rating: PatternRating
    start_rating: PatternRating
    history: tuple[tuple[int, float], ...]
    skipped: int
    state: SearchState
    further_ratings: tuple[PatternRating, ...] = ()
