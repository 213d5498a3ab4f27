"""Lines from standard input until the end is asked for: by a word, Ctrl-C or a polite kill."""

from __future__ import annotations

import os
import select
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from labapp.bench.virtual_bench.talking import Talk
from labapp.common.console import hearing_wishes_to_end, say

_LOOK = 0.2
"""Seconds between looks at whether the end was asked for."""


@contextmanager
def asked_to_end() -> Iterator[Callable[[], bool]]:
    """Whether somebody has asked to end, while the block runs; asked twice, it ends at once."""
    asked = False

    def stop(number: int, frame: Any) -> None:
        nonlocal asked
        if asked:
            raise KeyboardInterrupt
        asked = True

    with hearing_wishes_to_end(stop):
        yield lambda: asked


def listen(talk: Talk, ended: Callable[[], bool], *, until_eof: bool) -> None:
    """Obey lines until the end. until_eof: the end of standard input is one, too."""
    source = None if sys.stdin is None else sys.stdin.fileno()
    rest = b""
    while not (ended() or talk.over):
        waiting = [] if source is None or not _may_read(source) else [source]
        if not select.select(waiting, [], [], _LOOK)[0]:
            continue
        data = os.read(source or 0, 65536)
        *lines, rest = (rest + data).split(b"\n")
        if not data:
            lines, rest, source = [rest], b"", None
        for line in lines:
            if not talk.over:
                _obey(talk, line.decode(errors="replace"))
        if source is None and until_eof:
            return


def _may_read(source: int) -> bool:
    """Whether it isn't a terminal that somebody else reads just now.

    A shell in whose background this process runs would have it stopped for reading, and with
    it all instruments.
    """
    try:
        return os.tcgetpgrp(source) == os.getpgrp()
    except OSError:
        return True  # no terminal


def _obey(talk: Talk, line: str) -> None:
    try:
        answer = talk.obey(line)
    except ValueError as error:
        answer = f"{error}."
    if answer:
        say(answer)
