"""Messages between a process and its child: requests, their results, and notifications."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from drivers.hosted.failures import RemoteFailure


class CallRequest(NamedTuple):
    """Request to the other process to call a function, which is answered by a CallResult."""

    name: str
    arguments: Sequence[Any] = ()


class Notification(NamedTuple):
    """Message to the other process that gets no answer."""

    name: str
    arguments: Sequence[Any] = ()


class CallResult(NamedTuple):
    """Result of a request or of the whole child process: a value, or an exception."""

    value: Any = None
    failure: RemoteFailure | None = None

    def result(self) -> Any:
        """Return the value from the other process, such as a hosted device's, or raise its error.

        An exception of a class that this process doesn't know becomes a RuntimeError.
        """
        if self.failure is None:
            return self.value
        raise self.failure.to_exception() or RuntimeError(self.failure.message)


def capture_result(act: Callable[..., Any], *given: Any) -> CallResult:
    """Call a function for another process, such as a hosted device's; return the CallResult.

    The CallResult contains the function's value or exception.
    """
    try:
        return CallResult(act(*given))
    except BaseException as error:
        return CallResult(failure=RemoteFailure.from_exception(error))
