"""Restoration by splitting: priors, data and blur each in the domain where it is easy."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import torch

from optics.deconvolution.blurred import Blurred
from optics.deconvolution.noise import squared
from optics.deconvolution.priors import Penalty, Prior
from optics.deconvolution.restored import Restored, relative_change
from optics.fourier import half_counts, irfft2, rfft2
from optics.progress import Progress

_TINY = 1e-9
"""Of the data's own denominator: where no light gets through and no prior looks, nothing is asked
for."""

_HELD = 2.0
"""Coupling of the data's split, over the root of the prior's weight on the picture's scale: the
fastest of 0.5 to 4 for kernels and noise of all kinds."""

_SETTLING, _DAMPED, _FARTHEST = 5, 0.3, 2.5
"""Iterations after which a weight that is looked for moves; the share of its way, in logarithms,
that it goes in each; and how far it goes, as a factor, from what it was at first."""

LEAST_FREEDOM = 3e-3
"""Share of the data that a picture explains at least: its mean and its coarsest features."""

Fit = Callable[[torch.Tensor, float], torch.Tensor]
"""The light in the frame with the least misfit + coupling / 2 * its squared distance to a light
that is given, pixel by pixel; of a light and a coupling."""


@dataclass(frozen=True)
class Steps:
    """How a splitting goes on.

    iterations: at most. tol: change of the picture, relative, below which it ends. weight: of the
    penalty; `first` to begin with, then what is found, if None.
    """

    iterations: int
    tol: float = 0.0
    weight: float | None = None
    first: float = 0.0


def towards(wanted: float, weight: float, first: float, farthest: float = _FARTHEST) -> float:
    """The next weight on the way to one that is wanted, not too far from the first."""
    wanted = min(max(wanted, first / farthest), first * farthest)
    return weight * (wanted / weight) ** _DAMPED


class _Data(ABC):
    """What the photograph wants of the picture."""

    def __init__(self, seen: Blurred) -> None:
        self.seen = seen

    @abstractmethod
    def pull(self, held: float) -> torch.Tensor:
        """Spectrum of what it wants, times the coupling; not to be written over."""

    @abstractmethod
    def coupling(self, held: float) -> float: ...

    @abstractmethod
    def take(self, spectrum: torch.Tensor, held: float) -> None:
        """The next picture's spectrum, which may be written over."""

    @property
    @abstractmethod
    def squares(self) -> float:
        """Mean square of what the last picture leaves unexplained, over the noise's."""


class _Everywhere(_Data):
    """All of a period was measured: nothing has to be split off."""

    def __init__(self, seen: Blurred) -> None:
        super().__init__(seen)
        self._data = rfft2(seen.data)
        self._wanted = self._data * seen.back
        self._left = self._data

    def pull(self, held: float) -> torch.Tensor:
        return self._wanted

    def coupling(self, held: float) -> float:
        return 1.0

    def take(self, spectrum: torch.Tensor, held: float) -> None:
        self._left = spectrum

    @property
    def squares(self) -> float:
        left = squared(self._left * self.seen.transfer - self._data)
        rows, columns = self.seen.whole
        total = float((left * half_counts(columns)).sum())
        return total / (rows * columns) ** 2 / self.seen.deviation**2


class _Framed(_Data):
    """H x is split off: some of the period was measured, or its misfit isn't of squares."""

    def __init__(self, seen: Blurred, fit: Fit | None) -> None:
        super().__init__(seen)
        self._fit = fit or self._least_squares
        self._light = seen.continued.clone()
        self._dual = torch.zeros_like(seen.data)
        self._squares = 1.0

    def pull(self, held: float) -> torch.Tensor:
        return rfft2(self._light).mul_(self.seen.back).mul_(held)

    def coupling(self, held: float) -> float:
        return held

    def take(self, spectrum: torch.Tensor, held: float) -> None:
        seen = self.seen
        self._light = irfft2(spectrum.mul_(seen.transfer), seen.whole)
        self._squares = seen.unexplained(self._light)
        light = seen.frame(self._light)
        light.add_(self._dual)
        wanted = self._fit(light, held)
        if seen.clipped is not None:
            # There the light is at least what was measured.
            wanted = torch.where(seen.clipped, torch.maximum(light, seen.data), wanted)
        torch.sub(light, wanted, out=self._dual)
        torch.sub(wanted, self._dual, out=light)

    def _least_squares(self, light: torch.Tensor, held: float) -> torch.Tensor:
        data, trust = self.seen.data, self.seen.trust
        if trust is None:
            return torch.lerp(light, data, 1 / (1 + held))
        return (trust * data + held * light) / (trust + held)

    @property
    def squares(self) -> float:
        return self._squares


class Splitting:
    """The least of |H x - y|² / 2, trusted pixels alone, + weight * penalty(D x), of the pictures
    that the other priors allow. fit: of another misfit of H x than those squares.

    By the alternating direction method of multipliers (Boyd et al. 2011, doi 10.1561/2200000016)
    with H x and every D x split off (Almeida and Figueiredo 2013, doi 10.1109/TIP.2013.2258354):
    each step has a closed form, the picture's on frequencies, the data's on pixels, whatever the
    border and whichever pixels are missing.
    """

    def __init__(
        self,
        seen: Blurred,
        penalty: Penalty,
        others: Sequence[Prior],
        steps: Steps,
        fit: Fit | None = None,
    ) -> None:
        self._seen, self._penalty, self._steps = seen, penalty, steps
        plain = seen.complete and fit is None
        self._data: _Data = _Everywhere(seen) if plain else _Framed(seen, fit)
        self._priors: list[Prior] = [penalty, *others]
        self._weight = steps.first if steps.weight is None else steps.weight
        self._inverse: torch.Tensor | None = None
        self._inverse_for = 0.0

    def restored(self, method: str, progress: Progress) -> Restored:
        steps, change = self._steps, list[float]()
        picture, converged = self._seen.continued, steps.tol == 0
        for number in range(steps.iterations):
            progress.report(number / steps.iterations, f"{method} {number + 1}/{steps.iterations}")
            before, picture = picture, self._picture()
            for prior in self._priors:
                prior.step(picture)
            if steps.weight is None and number >= _SETTLING:
                self._reweigh()
            change.append(relative_change(picture, before))
            if steps.tol and change[-1] <= steps.tol:
                converged = True
                break
        return Restored(
            self._seen.frame(picture).clamp(min=0),
            method,
            self._seen.noise,
            self._data.squares**0.5,
            self._weight,
            len(change),
            change,
            converged,
            picture,
        )

    def _picture(self) -> torch.Tensor:
        """The one that is nearest to what data and priors want."""
        held = _HELD * (self._weight / self._seen.scale) ** 0.5
        own = self._data.coupling(held)
        spectrum = self._pulled(held, own).mul_(self._share(own))
        picture = irfft2(spectrum, self._seen.whole)
        self._data.take(spectrum, held)
        return picture

    def _pulled(self, held: float, own: float) -> torch.Tensor:
        """What they want, a spectrum that may be written over."""
        first, *others = self._priors
        wanted, pull = first.back, self._data.pull(held)
        if wanted is None:
            return pull.clone()
        coupled = first.coupling(self._weight, own)
        for prior in others:
            if prior.back is not None:
                share = prior.coupling(self._weight, own) / coupled
                wanted = torch.add(wanted, prior.back, alpha=share)
        spectrum = rfft2(wanted)
        return torch.add(pull, spectrum, alpha=coupled, out=spectrum)

    def _share(self, own: float) -> torch.Tensor:
        """By which that is divided, inverse; the same for as long as the weight is."""
        if self._inverse is None or self._inverse_for != self._weight:
            below = self._seen.power * own
            below.add_(_TINY * own)
            for prior in self._priors:
                below.add_(prior.square, alpha=prior.coupling(self._weight, own))
            self._inverse, self._inverse_for = below.reciprocal_(), self._weight
        return self._inverse

    def _reweigh(self) -> None:
        """Towards the weight by the evidence."""
        freedom = max(1 - self._data.squares, LEAST_FREEDOM)
        wanted = self._penalty.weight(self._seen.deviation, freedom)
        self._weight = towards(wanted, self._weight, self._steps.first)
