"""Define the progress object that every long computation takes."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable


class Cancelled(Exception):
    """Raised in a computation that its user or caller has cancelled."""


class Progress:
    """Report the progress of a long computation, and tell the computation to stop or pause.

    `listener(fraction, message)` is called at every report, in the computing thread; fraction
    runs from 0 to 1. `teller(message)` is called with what a person must learn at once, such as why
    a computation waits. `wait_limit` is the seconds for which it may wait for somebody to mend what
    stops it. `cancel()`, `pause()` and `resume()` may be called from any thread or from a signal
    handler.
    """

    def __init__(
        self,
        listener: Callable[[float, str], None] | None = None,
        *,
        teller: Callable[[str], None] | None = None,
        wait_limit: float = math.inf,
    ) -> None:
        self._listener, self._teller = listener, teller
        self.wait_limit = wait_limit
        self._cancel_event = threading.Event()
        self._pause_event = threading.Event()

    def report(self, fraction: float, message: str = "") -> None:
        """Report how far the computation is; raise Cancelled if it should stop."""
        self.raise_if_cancelled()
        if self._listener is not None:
            self._listener(min(max(fraction, 0.0), 1.0), message)

    def tell(self, message: str) -> None:
        """Tell a person at once what the computation needs of them."""
        if self._teller is not None:
            self._teller(message)

    def raise_if_cancelled(self) -> None:
        """Raise Cancelled if the computation should stop."""
        if self.is_cancelled:
            raise Cancelled("cancelled")

    @property
    def is_cancelled(self) -> bool:
        return self._cancel_event.is_set()

    def cancel(self) -> None:
        self._cancel_event.set()

    @property
    def is_paused(self) -> bool:
        """Whether the computation should pause at the next place where it can, until `resume()`."""
        return self._pause_event.is_set()

    def pause(self) -> None:
        self._pause_event.set()

    def resume(self) -> None:
        self._pause_event.clear()

    def part(self, start: float, stop: float) -> Progress:
        """Return the Progress of one part of the computation, from `start` to `stop`."""
        part = Progress(
            lambda f, m: self.report(start + f * (stop - start), m),
            teller=self._teller,
            wait_limit=self.wait_limit,
        )
        part._cancel_event, part._pause_event = self._cancel_event, self._pause_event
        return part
