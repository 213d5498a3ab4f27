"""Requests between a process and its child, their results, and notifications."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from drivers.hosted.failures import RemoteFailure


class CallRequest(NamedTuple):
    """Asks the other process to call a function, and is answered by a CallResult."""

    name: str
    arguments: Sequence[Any] = ()


class Notification(NamedTuple):
    """A message that gets no answer."""

    name: str
    arguments: Sequence[Any] = ()


class CallResult(NamedTuple):
    """What came of a request or of the whole child process: a value, or an exception."""

    value: Any = None
    failure: RemoteFailure | None = None

    def result(self) -> Any:
        """Return the value from the other process, or raise its error.

        An exception of a class that this process doesn't know becomes a RuntimeError.
        """
        if self.failure is None:
            return self.value
        raise self.failure.to_exception() or RuntimeError(self.failure.message)


def capture_result(act: Callable[..., Any], *given: Any) -> CallResult:
    """Call a function; return its value or exception as a CallResult."""
    try:
        return CallResult(act(*given))
    except BaseException as error:
        return CallResult(failure=RemoteFailure.from_exception(error))
