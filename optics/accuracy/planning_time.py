"""Keep the planning of a computation within the processor time of its budget."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

from optics.accuracy.tolerance_error import ToleranceError

_LIMIT: ContextVar[tuple[float, float] | None] = ContextVar("limit", default=None)
"""The thread's processor time at which planning has to end, and the seconds it was given."""


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
