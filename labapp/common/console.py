"""Print progress, tables, messages and errors in the terminal."""

from __future__ import annotations

import json
import math
import os
import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table
from rich.text import Text

from labapp.common.command_end import note_document, note_interrupt
from labapp.common.plain_text import printable, printable_line
from optics.progress import Progress


class PlainConsole(Console):
    """A terminal that shows texts, which come from files and devices, as they are.

    `styled_line` has parts in colour.
    """

    def __init__(self, *, stderr: bool = False) -> None:
        super().__init__(stderr=stderr, highlight=False, markup=False, emoji=False)

    def render_str(self, text: str, **look: Any) -> Text:
        return super().render_str(printable(text), **look)


out = PlainConsole()
err = PlainConsole(stderr=True)


def styled_line(*parts: str | tuple[str, str]) -> Text:
    """Return a line for the terminal of texts, and of texts with a style, as ("held", "green")."""
    pairs = ((part, "") if isinstance(part, str) else part for part in parts)
    return Text.assemble(*((printable_line(text), style) for text, style in pairs))


def print_table(title: str, columns: Sequence[str], rows: Sequence[Sequence[Any]]) -> None:
    """Print a table in the terminal; right-align columns whose heading ends in a blank."""
    out.print(styled_line((title, "bold")))
    made = Table(box=SIMPLE_HEAD, pad_edge=False)
    for name in columns:
        made.add_column(
            name.strip(), justify="right" if name.endswith(" ") else "left", overflow="fold"
        )
    for row in rows:
        made.add_row(*(cell if isinstance(cell, Text) else str(cell) for cell in row))
    out.print(made)
    out.print()


def print_json(data: Any) -> None:
    """Print data as plain JSON on standard output, for programs to read."""
    print(json.dumps(data, indent=2, allow_nan=False), flush=True)
    note_document()


def print_message(text: str) -> None:
    """Print a message on standard error; standard output holds only data."""
    err.print(text, soft_wrap=True)


def print_error(text: str) -> None:
    """Print an error on standard error, unwrapped so that it can be searched and copied."""
    err.print(text, style="bold red", soft_wrap=True)


UNATTENDED_WAIT = 3600.0
"""Seconds for which a run waits where no terminal is. Chosen: a disk is freed within the hour, or
when somebody comes, who resumes the run."""


def is_attended() -> bool:
    """Whether a terminal shows what is printed, or somebody may answer."""
    return err.is_terminal or (sys.stdin is not None and sys.stdin.isatty())


@contextmanager
def terminal_progress(wait_limit: float | None = None) -> Iterator[Progress]:
    """Show progress; Ctrl-C cancels, and a second Ctrl-C stops at once.

    What a person must learn at once is printed on standard error in any case. SIGUSR1 lets go on
    what waits for that.
    wait_limit: seconds for which something may wait for a person; by default without end at a
    terminal, otherwise UNATTENDED_WAIT.
    """
    if wait_limit is None:
        wait_limit = math.inf if is_attended() else UNATTENDED_WAIT
    from rich.progress import (
        BarColumn,
        TaskProgressColumn,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )
    from rich.progress import Progress as Bar

    columns = (
        TextColumn("{task.description:<36}", markup=False),
        BarColumn(),
        TaskProgressColumn(),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
    )
    with Bar(*columns, console=err, transient=True, disable=not err.is_terminal) as bar:
        task = bar.add_task("starting", total=1.0)
        progress = Progress(
            lambda fraction, message: bar.update(
                task, completed=fraction, description=printable_line(message)
            ),
            teller=lambda message: _tell(message, progress),
            wait_limit=wait_limit,
        )
        # Without a terminal, no key can resume what is paused.
        before = signal.signal(signal.SIGUSR1, lambda number, frame: progress.resume())
        try:
            with _cancel_on_signals(progress):
                yield progress
        finally:
            signal.signal(signal.SIGUSR1, before)


def _tell(message: str, progress: Progress) -> None:
    """Print a message on standard error, with the key or signal that lets a paused run go on."""
    if progress.is_paused:
        by_key = "r goes on, Ctrl-C ends. Without a terminal, " if is_attended() else ""
        pid = os.getpid()
        message = f"{message}. {by_key}kill -USR1 {pid} goes on, kill {pid} ends."
    # A run doesn't end because nobody reads.
    with suppress(OSError):
        print_message(message)


def _redirect_terminal_to_null() -> None:
    """Send output for a closed terminal to /dev/null: a failure would keep the bench unsafe."""
    nowhere = os.open(os.devnull, os.O_RDWR)
    for stream in (1, 2):
        if os.isatty(stream):
            os.dup2(nowhere, stream)
    os.close(nowhere)


@contextmanager
def _cancel_on_signals(progress: Progress) -> Iterator[None]:
    """Cancel on Ctrl-C, SIGTERM or a closed terminal while the block runs."""
    pressed = 0

    def stop(number: int, frame: Any) -> None:
        nonlocal pressed
        pressed += 1
        if number == signal.SIGINT:
            note_interrupt()
        if number == signal.SIGHUP:
            _redirect_terminal_to_null()
        elif pressed == 2:
            raise KeyboardInterrupt
        elif pressed > 2:
            # What cleans up isn't interrupted.
            return
        progress.cancel()
        print_message("stopping; Ctrl-C again stops at once")

    with handle_stop_signals(stop):
        yield


@contextmanager
def handle_stop_signals(stop: Callable[[int, Any], None]) -> Iterator[None]:
    """Call `stop` on Ctrl-C, SIGTERM or a closed terminal while the block runs."""
    wishes = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    before = {number: signal.signal(number, stop) for number in wishes}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
