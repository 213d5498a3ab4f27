"""Why nothing at hand keeps a promise, with the remedy."""

from __future__ import annotations

from collections.abc import Sequence

from optics.validation import rounded_up


class ToleranceError(ValueError):
    """Nothing at hand keeps the promise; the message names the floor and the remedy.

    floor: the tolerance that would do, where the refusal is one of tolerance alone.
    needed_bytes: bytes that would do, where it is one of memory.
    """

    floor: float | None = None
    needed_bytes: int | None = None


def unreachable_tolerance_error(tol: float, floor: float) -> ToleranceError:
    """The refusal of a tolerance below a floor, with the one that would do."""
    if not floor < 1:
        return ToleranceError(
            f"tol {tol:g} can't be kept: hardly any light reaches the window; ask for a larger "
            "one, or one that is nearer to the light"
        )
    refusal = ToleranceError(f"tol {tol:g} can't be kept; ask for tol {rounded_up(floor)} or more")
    refusal.floor = floor
    return refusal


def require_memory(what: str, needed_bytes: float, allowed_bytes: int, remedy: str) -> None:
    """Raise ToleranceError for what needs more bytes than are allowed.

    remedy: what else helps, as a command: "ask for fewer samples".
    """
    if needed_bytes <= allowed_bytes:
        return
    refusal = ToleranceError(
        f"{what} needs {needed_bytes / 1e6:.0f} MB at least and {allowed_bytes / 1e6:.0f} MB are "
        f"allowed; allow more memory, or {remedy}"
    )
    refusal.needed_bytes = int(needed_bytes)
    raise refusal


def combine_refusals(refusals: Sequence[ValueError], tol: float) -> ValueError:
    """What several methods say, as one refusal of a tolerance.

    The least floor, if there is any; else every reason once, and of those that need more memory
    only the one that needs least. ValueErrors that aren't ToleranceErrors come from methods that
    aren't made for the request: they count where there is nothing else.
    """
    if len(refusals) == 1:
        return refusals[0]
    strict = [one for one in refusals if isinstance(one, ToleranceError)]
    floors = [one.floor for one in strict if one.floor is not None]
    if floors:
        return unreachable_tolerance_error(tol, min(floors))
    thriftiest = sorted(
        (one for one in strict if one.needed_bytes), key=lambda one: one.needed_bytes or 0
    )[:1]
    told = thriftiest + [one for one in strict if not one.needed_bytes] or refusals
    if len(told) == 1:
        return told[0]
    kind = ToleranceError if strict else ValueError
    return kind("; ".join(dict.fromkeys(map(str, told))))
