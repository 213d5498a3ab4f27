"""The one chooser: the cheapest method that answers a request, or the best in a given time.

A method is offered before it's prepared: an offer knows its name, its bytes, its processor time
and its error without having made anything large.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Generic, TypeVar

from optics.accuracy.budget import Budget, MachineSpeed
from optics.accuracy.tolerance_error import ToleranceError, combine_refusals, require_memory
from optics.validation import rounded_up

_ROUNDING = 1e-9
"""Of a time: predictions that differ by less are the same."""


class CandidateMethod(ABC):
    """A way to compute something, known by its name and predicted cost."""

    name: str

    @property
    @abstractmethod
    def bytes(self) -> int:
        """The largest arrays."""

    @abstractmethod
    def cpu_seconds(self, speed: MachineSpeed) -> float:
        """Predicted processor time of one call, on a machine of such a speed."""

    def prepare(self) -> None:  # noqa: B027 (many keep nothing)
        """Make what is kept between calls; ToleranceError if that doesn't keep the promise."""


O = TypeVar("O", bound=CandidateMethod)  # noqa: E741


def select_methods(methods: Collection[str], method: str | None, what: str = "") -> list[str]:
    """All methods, or the one that is asked for; ValueError with their names for any other.

    what: that is computed, for the message.
    """
    if method is None:
        return list(methods)
    if method not in methods:
        names = ", ".join(repr(name) if "," in name else name for name in methods)
        wanted = f"for {what} choose" if what else "choose"
        raise ValueError(f"method is {method!r}; {wanted} one of {names}")
    return [method]


class MethodChoice(Generic[O]):
    """The candidates that fit a budget, the cheapest first, and why the others don't serve.

    makers: what makes each offer; it raises ValueError where its method isn't made for the
    request, and ToleranceError where it can't keep the promise. what: is computed. remedy: what
    helps besides memory, as a command. longest: seconds of a call beyond which an offer is
    refused.
    """

    def __init__(
        self,
        makers: Iterable[Callable[[], O]],
        budget: Budget,
        what: str,
        *,
        remedy: str = "ask for fewer samples",
        longest: float = math.inf,
    ) -> None:
        self._budget, self._what, self._remedy, self._longest = budget, what, remedy, longest
        self._refusals: list[ValueError] = []
        self.candidates: list[O] = []
        for make in makers:
            try:
                offer = make()
                self._require_affordable(offer)
            except ValueError as error:
                self._refusals.append(error)
            else:
                self.candidates.append(offer)
        self.candidates.sort(key=self._seconds_of)

    def _seconds_of(self, offer: O) -> float:
        return offer.cpu_seconds(self._budget.speed)

    def _require_affordable(self, offer: O) -> None:
        what = f"{self._what} by {offer.name}"
        require_memory(what, offer.bytes, self._budget.memory, self._remedy)
        seconds = self._seconds_of(offer)
        if seconds > self._longest:
            raise ToleranceError(
                f"{what} would take {seconds / 3600:.0f} h; {self._remedy}, or for "
                f"method={offer.name!r} to have it all the same"
            )

    @property
    def seconds(self) -> float:
        """Of the cheapest, in a call; infinite if none serves."""
        return self._seconds_of(self.candidates[0]) if self.candidates else math.inf

    def prepared_candidates(self) -> Iterator[O]:
        """The candidates that keep their promise, each prepared when it's asked for."""
        for offer in self.candidates:
            try:
                offer.prepare()
            except ToleranceError as error:
                self._refusals.append(error)
                continue
            yield offer

    def refusal(self, tol: float) -> ValueError:
        """Why no offer keeps a tolerance, with the one that could be kept or what it takes."""
        return combine_refusals(self._refusals, tol)


def cheapest_candidate(candidates: Iterable[O], budget: Budget, what: str) -> O:
    """The one of least predicted processor time that fits in memory.

    Raises ToleranceError that names the memory the thriftiest needs.
    """
    choice = MethodChoice([partial(_itself, one) for one in candidates], budget, what)
    if not choice.candidates:
        raise choice.refusal(math.nan)
    return choice.candidates[0]


def _itself(offer: O) -> O:
    return offer


@dataclass(frozen=True)
class IterationOption:
    """An iterative method with a number of iterations: what they take, and how much they gain
    compared to other settings. description: for a person; the method's name if empty."""

    method: str
    count: int
    seconds: float
    gain: float
    description: str = ""


def best_within(budget: float, settings: Sequence[IterationOption]) -> IterationOption:
    """The setting that gains most in so many seconds.

    Raises ValueError that names the quickest, and what it takes.
    """
    fitting = [one for one in settings if one.seconds <= budget * (1 + _ROUNDING)]
    if not fitting:
        quickest = min(settings, key=lambda one: one.seconds)
        raise ValueError(
            f"budget is {budget:g} s; the quickest, {quickest.description or quickest.method}, "
            f"takes about {rounded_up(quickest.seconds)} s; allow more"
        )
    return max(fitting, key=lambda one: one.gain)
