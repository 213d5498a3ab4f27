"""Messages between this process and those of its devices, of which one fails when it is told to."""

from __future__ import annotations

import signal
from collections.abc import Callable
from typing import Any

from drivers.hosted.child_process import ChildProcess
from figures.faulty_calls import CUT, GONE, STUCK, FaultCounter

_FAILURES: dict[int, Callable[[ChildProcess], None]] = {
    GONE: lambda process: process.send_signal(signal.SIGKILL),
    STUCK: lambda process: process.send_signal(signal.SIGSTOP),
    CUT: lambda process: process.line.disconnect(),
}


class FaultyMessages(FaultCounter):
    """Counts requests and replies, and before one of them does its cause to the other process."""

    def install(self) -> None:
        """Put the failing methods into `ChildProcess`, for the rest of this process."""
        for name in ("send", "receive"):
            setattr(ChildProcess, name, self._wrap(name, getattr(ChildProcess, name)))

    def _wrap(self, name: str, call: Callable[..., Any]) -> Callable[..., Any]:
        def ask(process: ChildProcess, *given: Any) -> Any:
            if self._is_due(name):
                _FAILURES[self._fault.cause](process)
            return call(process, *given)

        return ask
