"""Describe what a computation may use, and keep its planning within that processor time."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from optics.accuracy.tolerance_error import ToleranceError
from optics.validation import require_count

if TYPE_CHECKING:
    import torch


@dataclass(frozen=True)
class MachineSpeed:
    """State the machine's speed: seconds of basic operations, on one thread, in float32.

    The defaults were measured on a 2-core server. Pass your own values where you know them.

    Parameters
    ----------
    call : float, optional
        Overhead of any function call, whatever its size.
    multiply_add : float, optional
        One multiplication and addition in a product of matrices.
    fft : float, optional
        A floating-point operation of an FFT.
    touch : float, optional
        Passing over a complex number once.
    fresh : float, optional
        Allocating one byte of memory beyond what caches and allocators retain.
    gridding : float, optional
        Spreading a sample to one point of a regular grid, row by row.
    spread : float, optional
        Spreading a scattered sample to one point of a regular grid.
    point : float, optional
        Fixed cost of a scattered sample, in addition to `spread`.
    stream : float, optional
        Using an element of a matrix once.
    cosine : float, optional
        One sine or cosine in double precision, with its share of the kernel around it.
    bessel : float, optional
        One Bessel function in double precision.
    step : float, optional
        One short step of Python on a few numbers.
    double : float, optional
        Factor by which double precision is slower.
    """

    call: float = 5e-4
    multiply_add: float = 2e-11
    fft: float = 7.3e-11
    touch: float = 2e-10
    fresh: float = 2.5e-10
    gridding: float = 3.4e-10
    spread: float = 5e-10
    point: float = 2.1e-8
    stream: float = 1.6e-9
    cosine: float = 2.5e-9
    bessel: float = 3.3e-8
    step: float = 1e-5
    double: float = 2.0

    def slowdown(self, dtype: torch.dtype) -> float:
        """Return the time of an operation in a complex dtype over that in complex64."""
        return self.double if dtype.itemsize == 16 else 1.0


@dataclass(frozen=True)
class Budget:
    """What a computation may use: memory, processor time, the machine's speed, and its calls.

    What is predicted to need more memory or time is refused before it is begun.

    Parameters
    ----------
    memory : int, optional
        Bytes; 4 GiB by default.
    speed : MachineSpeed, optional
        The machine's speed.
    calls : int, optional
        How often the planned computation will be called, at least 1. The method is chosen for the
        least time of planning and all calls together.
    seconds : float, optional
        Processor seconds that planning and one call may take together; 10 by default. ``math.inf``
        is allowed.

    Raises
    ------
    ValueError
        If the memory, the calls or the seconds aren't positive.
    """

    memory: int = 4 << 30
    speed: MachineSpeed = field(default_factory=MachineSpeed)
    calls: int = 100
    seconds: float = 10.0

    def __post_init__(self) -> None:
        for name, unit in (("memory", "bytes"), ("seconds", "seconds of processor time")):
            value = getattr(self, name)
            if not value > 0:
                raise ValueError(f"{name} is {value}; give the {unit} that may be used, above 0")
        require_count("calls", self.calls)


def plan_budget(budget: Budget | None, calls: int | None) -> Budget:
    """Return the budget of a plan with a number of calls.

    Parameters
    ----------
    budget : Budget or None
        The memory and time allowed, and the machine's speed; None for the defaults.
    calls : int or None
        How often the planned computation will be called; None for the budget's own number.

    Returns
    -------
    Budget
        The budget with that number of calls.

    Raises
    ------
    ValueError
        If `calls` is less than 1.
    """
    budget = budget or Budget()
    return budget if calls is None else replace(budget, calls=calls)


# The thread's processor time at which planning has to end, and the seconds it was given.
_LIMIT: ContextVar[tuple[float, float] | None] = ContextVar("limit", default=None)


@contextmanager
def limit_planning_time(seconds: float) -> Iterator[None]:
    """Limit the processor time of a plan, in a `with` statement.

    Costs are predicted before a method is prepared. This limit holds where they were predicted too
    low. Inside another limit, the outer one holds.

    Parameters
    ----------
    seconds : float
        Processor seconds of this thread.

    Yields
    ------
    None
        Nothing; the limit holds until the statement ends.
    """
    if _LIMIT.get() is not None:
        yield
        return
    token = _LIMIT.set((time.thread_time() + seconds, seconds))
    try:
        yield
    finally:
        _LIMIT.reset(token)


def require_planning_time(what: str) -> None:
    """Raise ToleranceError if a plan has used up the processor time of its budget.

    Parameters
    ----------
    what : str
        What is planned, for the error message.

    Raises
    ------
    ToleranceError
        If the time is used up. Without a limit, it never is.
    """
    limit = _LIMIT.get()
    if limit is None or time.thread_time() <= limit[0]:
        return
    raise ToleranceError(
        f"{what} took more than the {limit[1]:g} s of processor time that are allowed, before it "
        "was planned; allow more time, ask for a smaller window or a larger tol, or bring the "
        "object closer to the plane in focus"
    )
