"""What is asked over a line, and what comes back. All else is news, which isn't answered."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from drivers.hosted.failures import RemoteFailure


class CallRequest(NamedTuple):
    """Something that the other process shall do."""

    name: str
    arguments: Sequence[Any] = ()


class Notification(NamedTuple):
    """The same, but nobody waits for what comes of it."""

    name: str
    arguments: Sequence[Any] = ()


class CallResult(NamedTuple):
    """What came of it, or of the whole process: a value, or an exception."""

    value: Any = None
    failure: RemoteFailure | None = None

    def result(self) -> Any:
        """The value. What was raised there is raised here if it is known, else RuntimeError."""
        if self.failure is None:
            return self.value
        raise self.failure.to_exception() or RuntimeError(self.failure.message)


def capture_result(act: Callable[..., Any], *given: Any) -> CallResult:
    """What a call gives back or raises, to be sent."""
    try:
        return CallResult(act(*given))
    except BaseException as error:
        return CallResult(failure=RemoteFailure.from_exception(error))
