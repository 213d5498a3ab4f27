"""Search for the pattern from whose captures linear restoration is expected to get most.

The search needs no picture: it lowers the expected error of `optics.edof.spectral_criterion`, by
stochastic gradient descent (Adam) on the unwrapped phase.

For a known depth, the error is a mean over depth, and a few random depths give an unbiased
gradient. The error of one filter for all depths isn't: it is the least, over filters, of a mean
over depth. At the best filter the derivative by the filter is zero, so that the gradient by the
pattern is that of the mean with the filter held fixed. The search therefore remembers the OTFs of
one depth in each of many equal parts of the range, takes the best filter for these, and draws
depths from a few parts a step, replacing what it remembers of them. The filter lags by some steps,
over which the pattern hardly changes.

A pattern for several wavelengths has a filter for each. The steps take the wavelengths in turn, and
those with larger errors count for more: the search lowers a power mean of their errors.

A pattern for several conditions of the panel at one wavelength has one filter for all of them,
because a decoder doesn't know the condition; the search lowers the plain mean of their errors.

See thesis section 5.4; D. P. Kingma and J. Ba, Adam, arXiv 1412.6980, 2015; for the memory, M.
Schmidt et al., Math. Program. 162, 83, 2017, doi 10.1007/s10107-016-1030-6.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import torch

from optics.edof.dioptres import DEPTH_RANGE, midpoint_dioptres, require_depth_range
from optics.edof.pattern_rating import (
    DepthMemory,
    DesignResult,
    PatternRating,
    SearchSettings,
    SearchState,
    rate_pattern,
)
from optics.edof.pattern_transfer import DepthTransfer
from optics.edof.spectral_criterion import error_level, filter_error, known_depth_error
from optics.progress import Progress
from optics.threads import single_threaded
from optics.validation import require_count

RATED_DEPTHS = 64
"""Depths at which a design is rated, the middles of equal parts of the range. With 2 dioptres a
wave's quarter of defocus at the panel's edge is .0088; ratings at 64 other, random depths differ by
.1 dB at most (measured)."""

MOST_FAILURES = 5
"""Steps in a row without a finite gradient after which the search stops; chosen."""

_REPORT_INTERVAL = 10  # steps between two reports of progress and entries of the history; chosen

# Rates in radians with which a search starts. With the depth known, larger steps are better:
# measured from a cubic pattern, .3 radians gained 1.25 dB in 250 steps, 1.5 radians 1.1 dB, and
# .1 radians 1.1 dB in 500. Large steps lose the start's level at first, and gain more once the
# rate has fallen.
_RATES = {"blind": SearchSettings.rate, "known": 0.4}


@single_threaded
def design_pattern(
    transfer: DepthTransfer,
    start: torch.Tensor,
    spectrum: torch.Tensor,
    noise: float,
    *,
    steps: int,
    generator: torch.Generator,
    criterion: Literal["blind", "known"] = "blind",
    pattern: Callable[[torch.Tensor], torch.Tensor] | None = None,
    further_bands: Sequence[DesignBand] = (),
    depth_range: tuple[float, float] = DEPTH_RANGE,
    settings: SearchSettings | None = None,
    progress: Progress | None = None,
    state: SearchState | None = None,
) -> DesignResult:
    """Search for the pattern whose captures are expected to be restored best over a depth range.

    The start decides a lot. Measured for the thesis' camera, 2 dioptres and noise of .008: for the
    blind criterion, rings of ten foci bring a pattern of a quarter to 21.3 dB in 600 steps; for the
    known depth, a cubic pattern of 20 waves one of the whole panel from 21.9 to 23.3 dB in 1700
    steps, and a lattice-focal lens from 22.9 to 23.0 dB in 500.

    Parameters
    ----------
    transfer : DepthTransfer
        Computes OTFs of patterns: `QuarterTransfer` or `FullTransfer`.
    start : torch.Tensor
        Parameters to start from; the phase itself in radians unless `pattern` is given.
    spectrum : torch.Tensor
        Power spectrum of the pictures on the frequencies of `transfer.grid`.
    noise : float
        Standard deviation of a pixel's noise, where white is 1.
    steps : int
        Steps in all, those in `state` included.
    generator : torch.Generator
        Source of the random depths.
    criterion : {"blind", "known"}, optional
        Whether one filter restores all depths, or the depth is known to the restoration.
    pattern : callable, optional
        Differentiable function from parameters to the phase of the transfer's shape; of a symmetric
        pattern, `optics.quarter_symmetry.crop_quarter` for a `QuarterTransfer`.
    further_bands : sequence of DesignBand, optional
        Further wavelengths, at which the same parameters make other phases, and further conditions
        of the panel.
    depth_range : tuple of (float, float), optional
        Farthest and nearest depth in dioptres.
    settings : SearchSettings, optional
        What tunes the search; by default the rate is that of the criterion.
    progress : Progress, optional
        Receives reports, and can cancel the work.
    state : SearchState, optional
        A state to go on from, and to change in place. All other arguments must then be as before.

    Returns
    -------
    DesignResult
        The design after the last step.

    Raises
    ------
    ValueError
        If a number is out of range, shapes don't fit, or a band takes the filter of one that isn't
        before it.
    FloatingPointError
        If `MOST_FAILURES` steps in a row have no finite gradient.
    """
    require_count("steps", steps)
    require_depth_range(depth_range)
    if criterion not in ("blind", "known"):
        raise ValueError(f"criterion is {criterion!r}; choose blind or known")
    rated = midpoint_dioptres(RATED_DEPTHS, depth_range)
    make = pattern or (lambda parameters: parameters)
    bands = (DesignBand(transfer, spectrum, make), *further_bands)
    problems = _pose_problems(bands, start.device, noise, depth_range)
    start_rating = problems[0].rate(start.detach().double(), rated)
    settings = settings or SearchSettings(rate=_RATES[criterion])
    search = _Search(problems, criterion, start, steps, generator, settings, state)
    search.run(progress or Progress())
    reached = search.state
    assert reached.parameters is not None
    with torch.no_grad():
        phase = make(reached.parameters).detach().clone()
    ratings = [one.rate(reached.parameters, rated) for one in problems]
    return DesignResult(
        phase,
        reached.parameters.clone(),
        ratings[0],
        start_rating,
        tuple(reached.history),
        reached.skipped,
        reached,
        tuple(ratings[1:]),
    )


@dataclass(frozen=True, eq=False)
class DesignBand:
    """A further wavelength, or condition of the panel, for which a pattern is designed.

    Parameters
    ----------
    transfer, spectrum, pattern
        As for `design_pattern`, at the wavelength and in the condition.
    filter_of : int, optional
        Number of the band whose filter restores this one too; 0 is the search's own, and 1 the
        first further one. By default the band has a filter of its own.
    """

    transfer: DepthTransfer
    spectrum: torch.Tensor
    pattern: Callable[[torch.Tensor], torch.Tensor]
    filter_of: int | None = None


@dataclass(frozen=True, eq=False)
class _Problem:
    """What a pattern is designed for: the optics, the pictures, the noise and the depths."""

    transfer: DepthTransfer
    spectrum: torch.Tensor
    noise: float
    pattern: Callable[[torch.Tensor], torch.Tensor]
    depth_range: tuple[float, float]
    filter: int
    """Number of the filter that restores it; several conditions of a panel share one."""

    def rate(self, parameters: torch.Tensor, dioptres: tuple[float, ...]) -> PatternRating:
        """Rate the pattern of some parameters at depths."""
        with torch.no_grad():
            phase = self.pattern(parameters)
        return rate_pattern(self.transfer, phase, self.spectrum, self.noise, dioptres)


def _pose_problems(
    bands: Sequence[DesignBand],
    device: torch.device,
    noise: float,
    depth_range: tuple[float, float],
) -> list[_Problem]:
    """Return the problem of each band, with the number of its filter.

    Raises ValueError for a band that takes the filter of one that isn't before it.
    """
    found: list[_Problem] = []
    for number, band in enumerate(bands):
        own = max((one.filter for one in found), default=-1) + 1
        if band.filter_of is not None:
            if not 0 <= band.filter_of < number:
                raise ValueError(
                    f"filter_of of band {number} is {band.filter_of}; name a band before it, from 0"
                )
            own = found[band.filter_of].filter
        spectrum = band.spectrum.to(device, torch.float64)
        found.append(_Problem(band.transfer, spectrum, noise, band.pattern, depth_range, own))
    return found


class _Search:
    """The optimiser, and the OTFs that it remembers."""

    def __init__(
        self,
        problems: Sequence[_Problem],
        criterion: str,
        start: torch.Tensor,
        steps: int,
        generator: torch.Generator,
        settings: SearchSettings,
        state: SearchState | None,
    ) -> None:
        self._problems, self._blind, self._steps = problems, criterion == "blind", steps
        self._generator, self._settings = generator, settings
        first = problems[0]
        self._shares = first.transfer.grid.shares().to(start.device)
        self.state = SearchState() if state is None else state
        reached = self.state.parameters
        self._parameters = (start if reached is None else reached).detach().double().clone()
        self._parameters.requires_grad_()
        self._optimiser = torch.optim.Adam(
            [self._parameters],
            lr=settings.rate,
            betas=(settings.momentum, settings.square_momentum),
            foreach=False,
        )
        self._failures = 0
        # The error per pixel is tiny; Adam's guard against zero is made for gradients near 1.
        self._scale = start.numel() / float((self._shares * first.spectrum).sum())
        self._memories: list[DepthMemory] = []
        if self._blind:
            filters = [one.filter for one in problems]
            for number in range(max(filters) + 1):
                one = problems[filters.index(number)]
                count = settings.parts * filters.count(number)
                self._memories.append(DepthMemory(count, one.spectrum, one.noise))
        if reached is not None:
            self._restore()
        elif self._blind:
            self._remember_all_parts()

    def _restore(self) -> None:
        """Put optimiser, generator and remembered OTFs back to the given state."""
        if self.state.optimiser:
            self._optimiser.load_state_dict(self.state.optimiser)
        if self.state.generator is not None:
            self._generator.set_state(self.state.generator)
        for memory, (total, power) in zip(self._memories, self.state.sums, strict=True):
            memory.total, memory.power = total.clone(), power.clone()

    @torch.no_grad()
    def _remember_all_parts(self) -> None:
        """Compute the OTFs of all parts of the depth range, for the first filters."""
        for problem in self._problems:
            phase, kept = problem.pattern(self._parameters), []
            for dioptre in midpoint_dioptres(self._settings.parts, problem.depth_range):
                kept.append(problem.transfer(phase, (dioptre,))[0])
                self._memories[problem.filter].add(kept[-1])
            self.state.remembered.append(torch.stack(kept))

    def run(self, progress: Progress) -> None:
        """Take the steps that are left."""
        state = self.state
        while state.step < self._steps:
            progress.raise_if_cancelled()
            self._take_step()
            if state.step % _REPORT_INTERVAL == 0 or state.step == self._steps:
                level = self._estimated_level()
                state.history.append((state.step, level))
                message = f"step {state.step} of {self._steps}: {level:.2f} dB"
                progress.report(state.step / self._steps, message)

    def _take_step(self) -> None:
        """Draw depths, change the parameters along the error's gradient, and note the state."""
        state, parts = self.state, self._draw_parts()
        band = state.step % len(self._problems)
        problem = self._problems[band]
        self._optimiser.zero_grad()
        phase = problem.pattern(self._parameters)
        found = problem.transfer(phase, self._draw_dioptres(parts))
        error = self._error(found, band, parts)
        torch.autograd.backward(error)
        gradient, value = self._parameters.grad, float(error.detach())
        assert gradient is not None
        # A sum isn't finite if any of its terms isn't, and is computed faster than a test of each.
        if math.isfinite(float(gradient.sum()) + value):
            self._failures = 0
            gradient.mul_(self._scale * self._band_weight(band, value))
            self._optimiser.param_groups[0]["lr"] = self._rate()
            self._optimiser.step()
        else:
            self._count_failure()
        state.step += 1
        state.parameters = self._parameters.detach()
        state.optimiser = self._optimiser.state_dict()
        state.generator = self._generator.get_state()
        state.sums = [(one.total, one.power) for one in self._memories]

    def _draw_parts(self) -> list[int]:
        """Draw the parts of the depth range for one step, each once before any comes again."""
        pending, wanted = list(self.state.pending), self._settings.depths
        if len(pending) < wanted:
            order = torch.randperm(self._settings.parts, generator=self._generator).tolist()
            pending = pending + [one for one in order if one not in pending]
        self.state.pending = pending[wanted:]
        return pending[:wanted]

    def _draw_dioptres(self, parts: list[int]) -> tuple[float, ...]:
        """Draw a random depth in each of some parts of the range, in dioptres."""
        low, high = self._problems[0].depth_range
        width = (high - low) / self._settings.parts
        drawn = torch.rand(len(parts), generator=self._generator, dtype=torch.float64).tolist()
        return tuple(low + width * (part + one) for part, one in zip(parts, drawn, strict=True))

    def _error(self, found: torch.Tensor, band: int, parts: list[int]) -> torch.Tensor:
        """Return the error whose gradient the search follows, from a band's OTFs of some parts."""
        problem = self._problems[band]
        arguments = (found, problem.spectrum, self._shares, problem.noise)
        if not self._blind:
            error = known_depth_error(*arguments)
            value = float(error.detach())
            if math.isfinite(value):
                turns = -(-self._settings.parts // self._settings.depths) * len(self._problems)
                self.state.errors = [*self.state.errors, value][-turns:]
            return error
        memory = self._memories[problem.filter]
        if bool(torch.isfinite(found.detach()).all()):
            remembered = self.state.remembered[band]
            for part, one in zip(parts, found.detach(), strict=True):
                memory.add(remembered[part], -1.0)
                memory.add(one)
                remembered[part] = one
        return filter_error(memory.filter(), *arguments)

    def _band_weight(self, band: int, error: float) -> float:
        """Return the weight of a band's gradient, and remember its error.

        It is the derivative of the power mean of the filters' errors by this one's, relative to
        that of the plain mean. A filter's error is the mean over its bands.
        """
        kept, memory = self.state.band_errors, self._settings.square_momentum
        while len(kept) <= band:
            kept.append(error)
        kept[band] = memory * kept[band] + (1 - memory) * error
        number = self._problems[band].filter
        # Bands that had no turn yet have no error.
        seen = zip(kept, self._problems[: len(kept)], strict=True)
        own = [one for one, problem in seen if problem.filter == number]
        relative = (sum(own) / len(own)) / (sum(kept) / len(kept))
        return relative ** (self._settings.band_power - 1)

    def _rate(self) -> float:
        """Return the rate of the next step: it grows linearly, then falls as a cosine."""
        settings, step = self._settings, self.state.step
        warm = min(1.0, (step + 1) / settings.warm_up)
        fall = 0.5 * (1 + math.cos(math.pi * step / self._steps))
        return settings.rate * warm * (settings.last_rate + (1 - settings.last_rate) * fall)

    def _count_failure(self) -> None:
        """Count a step without a finite gradient; raise FloatingPointError after too many."""
        self._failures += 1
        self.state.skipped += 1
        if self._failures >= MOST_FAILURES:
            raise FloatingPointError(
                f"{MOST_FAILURES} steps in a row had no finite gradient, up to step "
                f"{self.state.step}; check the start and the pattern's function for NaN"
            )

    def _estimated_level(self) -> float:
        """Return the level in dB of the criterion, at the depths drawn last."""
        errors = self.state.errors
        if self._blind:
            errors = [one.error(self._shares) for one in self._memories]
        return error_level(sum(errors) / len(errors)) if errors else math.nan
