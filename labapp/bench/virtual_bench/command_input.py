"""Lines from standard input until the end is asked for: by a word, Ctrl-C or a polite kill."""

from __future__ import annotations

import os
import select
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from labapp.bench.virtual_bench.command_interpreter import CommandInterpreter
from labapp.common.console import handle_stop_signals, print_message

_POLL_INTERVAL = 0.2
"""Seconds between looks at whether the end was asked for."""


@contextmanager
def catch_stop_requests() -> Iterator[Callable[[], bool]]:
    """Whether somebody has asked to end, while the block runs; asked twice, it ends at once."""
    asked = False

    def stop(number: int, frame: Any) -> None:
        nonlocal asked
        if asked:
            raise KeyboardInterrupt
        asked = True

    with handle_stop_signals(stop):
        yield lambda: asked


def read_commands(
    talk: CommandInterpreter, stop_requested: Callable[[], bool], *, until_eof: bool
) -> None:
    """Obey lines until the end. until_eof: the end of standard input is one, too."""
    source = None if sys.stdin is None else sys.stdin.fileno()
    rest = b""
    while not (stop_requested() or talk.is_over):
        waiting = [] if source is None or not _may_read(source) else [source]
        if not select.select(waiting, [], [], _POLL_INTERVAL)[0]:
            continue
        data = os.read(source or 0, 65536)
        *lines, rest = (rest + data).split(b"\n")
        if not data:
            lines, rest, source = [rest], b"", None
        for line in lines:
            if not talk.is_over:
                _execute_line(talk, line.decode(errors="replace"))
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


def _execute_line(talk: CommandInterpreter, line: str) -> None:
    try:
        answer = talk.execute(line)
    except ValueError as error:
        answer = f"{error}."
    if answer:
        print_message(answer)
