"""What is asked over a line, and what comes back. All else is news, which isn't answered."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from drivers.hosted.failures import Failure


class Request(NamedTuple):
    """Something that the other process shall do."""

    name: str
    given: Sequence[Any] = ()


class News(NamedTuple):
    """The same, but nobody waits for what comes of it."""

    name: str
    given: Sequence[Any] = ()


class Answer(NamedTuple):
    """What came of it, or of the whole process: a value, or an exception."""

    value: Any = None
    failure: Failure | None = None

    def result(self) -> Any:
        """The value. What was raised there is raised here if it is known, else RuntimeError."""
        if self.failure is None:
            return self.value
        raise self.failure.known() or RuntimeError(self.failure.said)


def answer_of(act: Callable[..., Any], *given: Any) -> Answer:
    """What a call gives back or raises, to be sent."""
    try:
        return Answer(act(*given))
    except BaseException as error:
        return Answer(failure=Failure.of(error))
