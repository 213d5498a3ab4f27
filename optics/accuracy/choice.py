"""Choose the cheapest method for a request, or the best one within a given time.

Methods are candidates before they are prepared: a candidate knows its name, its bytes, its
processor time and its error before it allocates anything large.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from operator import itemgetter
from typing import Generic, TypeVar

from optics.accuracy.budget import Budget, MachineSpeed, require_planning_time
from optics.accuracy.tolerance_error import (
    ToleranceError,
    combine_refusals,
    require_memory,
    require_time,
)
from optics.validation import rounded_up


class DearerThanOthersError(Exception):
    """Tells that the preparation of a method would take longer than another one altogether."""


class CandidateMethod(ABC):
    """Base class of methods to choose from, each with a name and a predicted cost.

    A candidate is created before it is prepared: it knows its name, its bytes and its processor
    time before it allocates anything large.

    Attributes
    ----------
    name : str
        The method's name.
    others_seconds : float
        Predicted processor time of the next method, of planning and all calls; infinite if there is
        none. A method whose preparation proves to be dearer may end it with DearerThanOthersError.
    """

    name: str
    others_seconds: float = math.inf

    @property
    @abstractmethod
    def bytes(self) -> int:
        """The size of the largest arrays, in bytes."""

    @abstractmethod
    def cpu_seconds(self, speed: MachineSpeed) -> float:
        """Predict the processor time of a call at a machine's speed, in seconds."""

    def planning_seconds(self, speed: MachineSpeed) -> float:
        """Predict the processor time before the calls at a machine's speed, in seconds.

        It is the processor time of `prepare()` and of what the first call computes for all later
        ones. Zero unless a method states more.
        """
        return 0.0

    def total_seconds(self, budget: Budget) -> float:
        """Predict the processor time of planning and all of a budget's calls, in seconds."""
        planning = self.planning_seconds(budget.speed)
        return planning + budget.calls * self.cpu_seconds(budget.speed)

    def prepare(self) -> None:  # noqa: B027 (many methods prepare nothing)
        """Compute what is reused between calls, or raise ToleranceError if the tolerance is missed.

        Raises
        ------
        ToleranceError
            If the preparation shows that the method doesn't keep its tolerance.
        """


O = TypeVar("O", bound=CandidateMethod)  # noqa: E741


def select_methods(methods: Collection[str], method: str | None, what: str = "") -> list[str]:
    """List the names of all methods, or the requested one alone.

    Parameters
    ----------
    methods : collection of str
        The names of all methods.
    method : str or None
        The requested one; None for all.
    what : str, optional
        What is computed, for the error message.

    Returns
    -------
    list of str
        The names, in the order given.

    Raises
    ------
    ValueError
        If the requested name isn't among the methods; the message lists them.
    """
    if method is None:
        return list(methods)
    if method not in methods:
        names = ", ".join(repr(name) if "," in name else name for name in methods)
        wanted = f"for {what} choose" if what else "choose"
        raise ValueError(f"method is {method!r}; {wanted} one of {names}")
    return [method]


class MethodChoice(Generic[O]):
    """Sort the candidates that fit a budget, the cheapest first, and keep the others' refusals.

    Parameters
    ----------
    makers : iterable of callable
        Each makes one candidate. It raises ValueError if its method isn't meant for the request,
        and ToleranceError if it can't keep the tolerance.
    budget : Budget
        The memory and time allowed, and the machine's speed.
    what : str
        What is computed, for error messages.
    remedy : str, optional
        What helps other than more memory or time, as a command.

    Attributes
    ----------
    candidates : list of CandidateMethod
        The candidates that fit, in order of predicted processor time for planning and all calls.
    wasted_seconds : float
        Predicted processor time of the candidates that were prepared and missed the tolerance.
    """

    def __init__(
        self,
        makers: Iterable[Callable[[], O]],
        budget: Budget,
        what: str,
        *,
        remedy: str = "ask for fewer samples",
    ) -> None:
        self._budget, self._what = budget, what
        self._refusals: list[ValueError] = []
        self.wasted_seconds = 0.0
        found: list[tuple[float, O]] = []
        for make in makers:
            try:
                require_planning_time(what)
                offer = make()
                named = f"{what} by {offer.name}"
                require_memory(named, offer.bytes, budget.memory, remedy)
                call = offer.cpu_seconds(budget.speed)
                planning = offer.planning_seconds(budget.speed)
                require_time(named, planning + call, budget.seconds, remedy)
                found.append((planning + budget.calls * call, offer))
            except ValueError as error:
                self._refusals.append(error)
        found.sort(key=itemgetter(0))
        self.candidates: list[O] = [offer for _, offer in found]

    @property
    def seconds(self) -> float:
        """The predicted seconds of a call of the first method; infinite if there is none."""
        if not self.candidates:
            return math.inf
        return self.candidates[0].cpu_seconds(self._budget.speed)

    @property
    def total_seconds(self) -> float:
        """The predicted seconds of the first method, of planning and all calls; may be infinite."""
        if not self.candidates:
            return math.inf
        return self.candidates[0].total_seconds(self._budget)

    def prepared_candidates(self) -> Iterator[O]:
        """Yield the candidates that keep their tolerance, the cheapest first.

        Each is prepared only when the iteration reaches it. One that proves to be dearer than the
        next one comes last.
        """
        waiting = list(self.candidates)
        while waiting:
            offer = waiting.pop(0)
            given_up = offer.others_seconds < math.inf
            offer.others_seconds = math.inf
            if waiting and not given_up:
                offer.others_seconds = waiting[0].total_seconds(self._budget)
            try:
                require_planning_time(self._what)
                offer.prepare()
            except ToleranceError as error:
                self._refusals.append(error)
                self.wasted_seconds += offer.planning_seconds(self._budget.speed)
            except DearerThanOthersError:
                self.wasted_seconds += offer.planning_seconds(self._budget.speed)
                waiting.append(offer)
            else:
                yield offer

    def refusal(self, tol: float) -> ValueError:
        """Return the error that says why no candidate keeps a tolerance.

        Its message names the tolerance that could be kept, or what the candidates need.
        """
        return combine_refusals(self._refusals, tol)


def cheapest_candidate(candidates: Iterable[O], budget: Budget, what: str) -> O:
    """Choose the method of least predicted time for planning and all calls within the budget.

    Parameters
    ----------
    candidates : iterable of CandidateMethod
        The candidates.
    budget : Budget
        The memory allowed, the machine's speed, and the number of calls.
    what : str
        What is computed, for the error message.

    Returns
    -------
    CandidateMethod
        The cheapest candidate. It isn't prepared.

    Raises
    ------
    ToleranceError
        If no candidate fits; the message names the memory that the smallest one needs.
    """

    def maker(one: O) -> Callable[[], O]:
        return lambda: one

    choice = MethodChoice(map(maker, candidates), budget, what)
    if not choice.candidates:
        raise choice.refusal(math.nan)
    return choice.candidates[0]


@dataclass(frozen=True)
class IterationOption:
    """State the time and the gain of an iterative method with some number of iterations.

    Parameters
    ----------
    method : str
        The method's name.
    count : int
        The number of iterations.
    seconds : float
        Time that the iterations take.
    gain : float
        How much the iterations gain, to be compared with other options.
    description : str, optional
        Words for an error message; the method's name is used if it is empty.
    """

    method: str
    count: int
    seconds: float
    gain: float
    description: str = ""


def best_within(budget: float, settings: Sequence[IterationOption]) -> IterationOption:
    """Choose the iterative method that gains most within a time budget, by predicted times.

    Parameters
    ----------
    budget : float
        Seconds.
    settings : sequence of IterationOption
        The options, at least one.

    Returns
    -------
    IterationOption
        The option with the largest gain that takes no longer than `budget`.

    Raises
    ------
    ValueError
        If none is quick enough; the message names the quickest and its time.
    """
    # Predicted times whose relative difference is below 1e-9 count as the same.
    fitting = [one for one in settings if one.seconds <= budget * (1 + 1e-9)]
    if not fitting:
        quickest = min(settings, key=lambda one: one.seconds)
        raise ValueError(
            f"budget is {budget:g} s; the quickest, {quickest.description or quickest.method}, "
            f"takes about {rounded_up(quickest.seconds)} s; allow more"
        )
    return max(fitting, key=lambda one: one.gain)
