"""Hold what tunes the search for a pattern, its state, and its result."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import torch

from optics.edof.pattern_rating import PatternRating
from optics.validation import require_count, require_positive

_KNOWN_DEPTH_RATE = 0.4
"""Rate in radians for the known-depth criterion; chosen, between .3 and .6 of `settings_for`."""


@dataclass(frozen=True)
class SearchSettings:
    """Tune the search for a pattern.

    Attributes
    ----------
    rate : float
        Largest change of a parameter per step, about; radians for phases. Measured for the blind
        criterion, a quarter of a panel and rings to start from, after 600 steps: .05, .1 and .2
        reach the same to .04 dB, .1 the most. See also `settings_for`.
    depths : int
        Depths per step. Measured as above, in equal time: 1 and 6 are .07 dB worse than 2.
    parts : int
        Equal parts of the depth range from which depths are drawn in turn. Chosen: 24 steps go
        through all of them.
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


def settings_for(criterion: str) -> SearchSettings:
    """Return the settings with which the search for a pattern starts for a criterion.

    With the depth known, larger steps are better. Measured from a cubic pattern: .3 radians gained
    1.25 dB in 250 steps, 1.5 radians 1.1 dB, and .1 radians 1.1 dB in 500. Large steps lose the
    start's level at first, and gain more once the rate has fallen.
    """
    rate = _KNOWN_DEPTH_RATE if criterion == "known" else SearchSettings.rate
    return SearchSettings(rate=rate)


@dataclass(eq=False)
class SearchState:
    """The state of a search for a pattern; with it, a search goes on bit by bit as it would have.

    `design_pattern` changes it in place after each step, so that it is current when the search is
    cancelled. All entries are numbers, lists, tensors and dictionaries of these, for `torch.save`.

    Attributes
    ----------
    step : int
        Steps taken.
    parameters : torch.Tensor
        Current parameters, float64.
    optimiser : dict
        The state of Adam.
    generator : torch.Tensor
        The state of the random generator.
    pending : list of int
        Parts of the depth range that are still to be drawn from in this turn.
    remembered : list of torch.Tensor
        For each wavelength and condition, the OTF of each part of the range; empty for the known
        depth.
    sums : list of tuple of torch.Tensor
        For each filter, their sum, and that of their squared moduli.
    band_errors : list of float
        Errors of the wavelengths and conditions, each averaged over its last steps.
    errors : list of float
        Errors of the last steps with the depth known, from which `history` is estimated.
    history : list of tuple of (int, float)
        Step and estimated level in dB, from the depths drawn last.
    skipped : int
        Steps without a finite gradient so far.
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
    """Describe a designed pattern.

    Attributes
    ----------
    phase : torch.Tensor, (rows, columns), float64
        Unwrapped phase in radians, of the shape that the transfer takes.
    parameters : torch.Tensor
        The parameters that make it.
    rating : PatternRating
        Expected PSNR at fixed depths, `optics.edof.pattern_search.RATED_DEPTHS`.
    start_rating : PatternRating
        That of the pattern that the search started from.
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
