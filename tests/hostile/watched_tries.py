"""Try many things in forks of this process: each is watched for crashes, hangs and memory."""

from __future__ import annotations

import json
import os
import resource
import select
import signal
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

from figures.own_memory import own_memory

T = TypeVar("T")

HUNG, DIED = "hung", "died by signal"


@dataclass(frozen=True)
class Watch:
    """Limits of a try: seconds by the clock, and bytes beyond those in use before."""

    seconds: float = 120.0
    memory: int = 1 << 30


def watched(
    tries: Sequence[T], attempt: Callable[[T], Any], watch: Watch
) -> Iterator[tuple[T, Any]]:
    """Yield each try with what the attempt returned as plain data, or with how it ended.

    One fork does them in turn; after one that hangs or dies, another fork goes on.
    """
    done = 0
    while done < len(tries):
        for found in _forked(tries[done:], attempt, watch):
            yield tries[done], found
            done += 1


def _forked(tries: Sequence[T], attempt: Callable[[T], Any], watch: Watch) -> Iterator[Any]:
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(reading)
        os.setsid()
        try:
            _attempt_all(tries, attempt, watch, writing)
        finally:
            os._exit(0)
    os.close(writing)
    ended = yield from _follow(child, reading, len(tries), watch)
    os.close(reading)
    if ended:
        yield ended


def _attempt_all(tries: Any, attempt: Any, watch: Watch, writing: int) -> None:
    """Attempt in this fork, and write a line of JSON after each."""
    room = own_memory("VmSize") + watch.memory
    resource.setrlimit(resource.RLIMIT_AS, (room, room))
    signal.signal(signal.SIGPROF, signal.SIG_DFL)
    for one in tries:
        os.write(writing, json.dumps(attempt(one)).encode() + b"\n")


def _follow(child: int, reading: int, count: int, watch: Watch) -> Any:
    """Yield what a fork writes; return how it ended if that was before its last try."""
    rest, seen, begun = b"", 0, time.monotonic()
    while seen < count:
        if select.select([reading], [], [], 0.5)[0]:
            data = os.read(reading, 1 << 16)
            if not data:
                break
            *lines, rest = (rest + data).split(b"\n")
            for line in lines:
                yield json.loads(line)
            seen += len(lines)
            begun = time.monotonic()
        elif time.monotonic() - begun > watch.seconds:
            os.killpg(child, signal.SIGKILL)
            break
    _, status = os.waitpid(child, 0)
    if seen == count:
        return None
    ended = os.WTERMSIG(status)
    return HUNG if ended in (signal.SIGPROF, signal.SIGKILL) else f"{DIED} {ended}"


def allow_seconds(seconds: float) -> None:
    """From now on this fork may take so much processor time; it ends as hung if it takes more."""
    signal.setitimer(signal.ITIMER_PROF, seconds)
