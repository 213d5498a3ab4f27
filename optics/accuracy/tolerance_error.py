"""Build the errors for tolerances that no method can keep, each with its remedy."""

from __future__ import annotations

from collections.abc import Sequence

from optics.validation import rounded_up


class ToleranceError(ValueError):
    """Raised if no method keeps the tolerance within the budget.

    The message names the smallest tolerance that can be kept, and the remedy.

    Parameters
    ----------
    reason : str
        Why the tolerance can't be kept.
    remedy : str, optional
        What helps, as a command: "ask for tol 1e-3 or more".

    Attributes
    ----------
    floor : float or None
        The smallest tolerance that could be kept; None if something else is the obstacle.
    needed_bytes : int or None
        The bytes that would be enough; None if memory isn't the obstacle.
    needed_seconds : float or None
        The processor seconds that would be enough; None if time isn't the obstacle.
    reason : str
        The message without its remedy.
    """

    floor: float | None = None
    needed_bytes: int | None = None
    needed_seconds: float | None = None

    def __init__(self, reason: str, remedy: str = "") -> None:
        super().__init__(f"{reason}; {remedy}" if remedy else reason)
        self.reason = reason


def unreachable_tolerance_error(tol: float, floor: float) -> ToleranceError:
    """Build the ToleranceError for a tolerance that is smaller than can be kept.

    Parameters
    ----------
    tol : float
        The tolerance that was requested.
    floor : float
        The smallest tolerance that can be kept. If it is 1 or more, the message says that hardly
        any light reaches the window.

    Returns
    -------
    ToleranceError
        The error, to be raised by the caller. Its `floor` is set if it is below 1.
    """
    if not floor < 1:
        return ToleranceError(f"tol {tol:g} can't be kept: hardly any light reaches the window")
    reason, remedy = f"tol {tol:g} can't be kept", f"ask for tol {rounded_up(floor)} or more"
    refusal = ToleranceError(reason, remedy)
    refusal.floor = floor
    return refusal


def require_memory(what: str, needed_bytes: float, allowed_bytes: int, remedy: str) -> None:
    """Raise ToleranceError if a method needs more memory than its budget allows.

    Parameters
    ----------
    what : str
        What needs the memory, for the error message.
    needed_bytes : float
        Bytes that it needs.
    allowed_bytes : int
        Bytes that are allowed.
    remedy : str
        What else helps, as a command: "ask for fewer samples".

    Raises
    ------
    ToleranceError
        If more bytes are needed than are allowed.
    """
    if needed_bytes <= allowed_bytes:
        return
    needed, allowed = (
        f"{count / 1e6:.0f} MB" if count < 1e15 else f"{count / 1e15:.3g} PB"
        for count in (needed_bytes, allowed_bytes)
    )
    refusal = ToleranceError(
        f"{what} needs {needed} at least and {allowed} are allowed",
        f"allow more memory, or {remedy}",
    )
    refusal.needed_bytes = int(min(needed_bytes, 1e300))
    raise refusal


def require_time(what: str, needed_seconds: float, allowed_seconds: float, remedy: str) -> None:
    """Raise ToleranceError if a method needs more processor time than its budget allows.

    Parameters
    ----------
    what : str
        What needs the time, for the error message.
    needed_seconds : float
        Processor seconds that it is predicted to need.
    allowed_seconds : float
        Processor seconds that are allowed.
    remedy : str
        What else helps, as a command: "ask for fewer samples".

    Raises
    ------
    ToleranceError
        If more time is needed than is allowed.
    """
    if needed_seconds <= allowed_seconds:
        return
    needed = min(needed_seconds, 1e300)
    told = f"{rounded_up(needed)} s" if needed < 3600 else f"{rounded_up(needed / 3600)} h"
    refusal = ToleranceError(
        f"{what} would take about {told} of processor time and {allowed_seconds:g} s are allowed",
        f"allow more time, or {remedy}",
    )
    refusal.needed_seconds = needed_seconds
    raise refusal


def _least(refusals: Sequence[ToleranceError], needed: str) -> list[ToleranceError]:
    """Return the refusal of the method whose need is least; none if no method has that need."""
    needing = [one for one in refusals if getattr(one, needed)]
    return sorted(needing, key=lambda one: float(getattr(one, needed)))[:1]


def combine_refusals(refusals: Sequence[ValueError], tol: float) -> ValueError:
    """Combine the refusals of several methods into one error for a tolerance.

    The error names the smallest tolerance that any method can keep. Without one, it gives every
    reason once; of the methods that need more memory, or more time, it names only the one that
    needs least.
    ValueErrors that aren't ToleranceErrors come from methods that aren't meant for the request.
    They count only if there is nothing else.
    """
    if len(refusals) == 1:
        return refusals[0]
    strict = [one for one in refusals if isinstance(one, ToleranceError)]
    floors = [one.floor for one in strict if one.floor is not None]
    if floors:
        return unreachable_tolerance_error(tol, min(floors))
    thriftiest, quickest = _least(strict, "needed_bytes"), _least(strict, "needed_seconds")
    others = [one for one in strict if not (one.needed_bytes or one.needed_seconds)]
    told: Sequence[ValueError] = thriftiest + quickest + others or refusals
    if len(told) == 1:
        return told[0]
    told_once = "; ".join(dict.fromkeys(map(str, told)))
    if not strict:
        return ValueError(told_once)
    refusal = ToleranceError(told_once)
    refusal.reason = "; ".join(dict.fromkeys(one.reason for one in strict if one in told))
    refusal.needed_bytes = thriftiest[0].needed_bytes if thriftiest else None
    refusal.needed_seconds = quickest[0].needed_seconds if quickest else None
    return refusal
