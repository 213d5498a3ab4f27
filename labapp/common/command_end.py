"""How the command line ends: by Ctrl-C at any moment, with a document for --json, and honestly.

This is the first module that a command imports, so it imports little itself.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from types import FrameType

CANCELLED_CODE = 130
"""Exit code of a command that Ctrl-C has ended: 128 and the number of the signal, as shells do."""

_CANCELLED_DOCUMENT = f'{{\n  "error": "cancelled",\n  "exit_code": {CANCELLED_CODE}\n}}\n'


class _Command:
    """What is known of the running command when it ends.

    owes_document: whether --json asks for a document that hasn't been printed.
    unsafe_devices: why devices of a bench couldn't be made safe.
    """

    def __init__(self, owes_document: bool = False) -> None:
        self.owes_document, self.was_interrupted = owes_document, False
        self.unsafe_devices: list[str] = []


_command = _Command()


def begin_command(arguments: Sequence[str]) -> None:
    """Begin a command: nothing has happened yet. arguments: of the command line."""
    global _command
    _command = _Command(owes_document="--json" in arguments)


def note_document() -> None:
    """Note that the JSON document has been printed."""
    _command.owes_document = False


def note_interrupt() -> None:
    """Note that Ctrl-C was pressed, so that the command doesn't end with 0."""
    _command.was_interrupted = True


def note_unsafe(reason: str) -> None:
    """Note why a device couldn't be made safe, so that the command doesn't end with 0."""
    _command.unsafe_devices.append(reason)


def unsafe_devices() -> list[str]:
    """Return why devices that the command has used couldn't be made safe."""
    return list(_command.unsafe_devices)


def end_code(code: int) -> int:
    """Return the exit code: 0 only if the command wasn't cancelled and has left its bench safe."""
    if code == 0 and _command.was_interrupted:
        return CANCELLED_CODE
    return code or int(bool(_command.unsafe_devices))


def print_owed_document(error: str, code: int) -> None:
    """Print the JSON document of a command that failed before it printed its own.

    It has the keys `error` and `exit_code`.
    """
    if _command.owes_document and code:
        import json

        _command.owes_document = False
        print(json.dumps({"error": error, "exit_code": code}, indent=2), flush=True)


def quit_on_interrupt() -> None:
    """Let Ctrl-C end this command at once, from now on.

    KeyboardInterrupt would be printed with a traceback while modules are imported and while Python
    ends, and lost where Python calls back. Child processes end when they lose their parent.
    """
    signal.signal(signal.SIGINT, _quit)


def _quit(number: int, frame: FrameType | None) -> None:
    words = [(2, "cancelled\n")]
    if _command.owes_document:
        words.append((1, _CANCELLED_DOCUMENT))
    for stream, text in words:
        try:
            os.write(stream, text.encode())
        except OSError:
            # Nobody reads it.
            continue
    os._exit(CANCELLED_CODE)


@contextmanager
def raise_on_interrupt() -> Iterator[None]:
    """Let Ctrl-C raise KeyboardInterrupt in the block, for commands that must clean up.

    Only the first Ctrl-C does, so that the second doesn't end the cleaning up. Nothing changes
    outside of labapp's command line.
    """

    def stop(number: int, frame: FrameType | None) -> None:
        if not _command.was_interrupted:
            note_interrupt()
            raise KeyboardInterrupt

    if not _is_main_thread() or signal.getsignal(signal.SIGINT) is not _quit:
        yield
        return
    signal.signal(signal.SIGINT, stop)
    try:
        yield
    finally:
        quit_on_interrupt()


@contextmanager
def delay_interrupts() -> Iterator[None]:
    """Let Ctrl-C during the block take effect after it, so that a bench is left safe."""
    before = signal.getsignal(signal.SIGINT)
    if not _is_main_thread() or not callable(before):
        yield
        return
    pressed: list[int] = []
    signal.signal(signal.SIGINT, lambda number, frame: pressed.append(number))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
        if pressed:
            signal.raise_signal(signal.SIGINT)


def _is_main_thread() -> bool:
    """Whether this thread may handle signals."""
    return threading.current_thread() is threading.main_thread()


def flush_output() -> None:
    """Write what is left in the output's buffers, so that Python has nothing to do when it ends."""
    for stream in (sys.stdout, sys.stderr):
        if stream is not None:
            stream.flush()
