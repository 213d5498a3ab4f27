"""Waits for what the screen or an engine will show: each ends, and says what was never seen."""

from __future__ import annotations

import time
from collections.abc import Callable

from calls import innermost_call
from dialogues import require_none
from PySide6.QtTest import QTest

PATIENCE = 60.0
"""Seconds after which what should have come long ago is given up."""

_LOOK = 10
"""Milliseconds between looks."""


class NeverSeen(AssertionError):
    """What a test waited for didn't come."""


def wait_until(
    seen: Callable[[], bool],
    standing: Callable[[], str] | None = None,
    *,
    patience: float = PATIENCE,
) -> None:
    """Let Qt work until something is seen.

    standing: how things stand, for the error if it never is. A dialogue that nobody expected
    ends the wait at once.
    """
    __tracebackhide__ = True
    late = time.monotonic() + patience
    while not seen():
        require_none()
        if time.monotonic() > late:
            asked = innermost_call("waits.py", "person.py")
            last = f"\nat last: {standing()}" if standing else ""
            raise NeverSeen(f"not seen in {patience:g} s: {asked}{last}")
        QTest.qWait(_LOOK)
