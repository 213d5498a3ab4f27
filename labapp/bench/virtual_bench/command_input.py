"""Commands read from standard input until the instruments are stopped."""

from __future__ import annotations

import os
import select
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from labapp.bench.virtual_bench.command_interpreter import CommandInterpreter
from labapp.common.command_end import note_interrupt
from labapp.common.console import handle_stop_signals, print_message


@contextmanager
def catch_stop_requests() -> Iterator[Callable[[], bool]]:
    """Yield a function that tells whether a signal has asked to stop.

    A second signal ends the block at once by KeyboardInterrupt.
    """
    asked = False

    def stop(number: int, frame: Any) -> None:
        nonlocal asked
        if number == signal.SIGINT:
            note_interrupt()
        if asked:
            raise KeyboardInterrupt
        asked = True

    with handle_stop_signals(stop):
        yield lambda: asked


def read_commands(
    talk: CommandInterpreter, stop_requested: Callable[[], bool], *, until_eof: bool
) -> None:
    """Execute typed command lines until a stop is requested.

    If `until_eof` is true, the end of standard input stops it as well.
    """
    source = None if sys.stdin is None else sys.stdin.fileno()
    rest = b""
    while not (stop_requested() or talk.is_over):
        waiting = [] if source is None or not _may_read(source) else [source]
        # After 0.2 s without input the loop checks whether it has to stop.
        if not select.select(waiting, [], [], 0.2)[0]:
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
    """Return whether commands may be read from standard input.

    They may not if the process runs in the background of a terminal: the shell would then stop it
    for reading, and all instruments with it.
    """
    try:
        return os.tcgetpgrp(source) == os.getpgrp()
    except OSError:
        return True  # standard input isn't a terminal


def _execute_line(talk: CommandInterpreter, line: str) -> None:
    try:
        answer = talk.execute(line)
    except ValueError as error:
        answer = f"{error}."
    if answer:
        print_message(answer)
