"""The command line of labapp; `labapp --help` lists its commands.

Each module defines a command or a group of commands. Help lists them in the order in which they
are imported here. Commands import what they need when they run, so that help appears at once.
"""

from __future__ import annotations

import os
import sys
from functools import cache
from typing import Any

from typer.main import get_command

# isort: off
from labapp.cli.app import app
from labapp.cli import demo, runs, records, brackets, calibrate  # noqa: F401
from labapp.cli import psf_command, patterns, simulated_pictures, reconstruct, study, train  # noqa: F401
from labapp.cli import gui, accuracy, accuracy_pictures, plans, devices, guide  # noqa: F401
from labapp.cli.number_options import read_numbers_as_typed
from labapp.common.command_end import (
    CANCELLED_CODE,
    begin_command,
    end_code,
    flush_output,
    print_owed_document,
    unsafe_devices,
)
from labapp.common.memory_shortage import explain_shortage, guard_library_memory, reserved_memory
from labapp.common.memory import collect_garbage_rarely, keep_freed_memory

# isort: on

__all__ = ["app", "build_command_line", "main"]


@cache
def build_command_line() -> Any:
    """Build the group of all commands, once, because it takes 0.05 s.

    Returns
    -------
    click.Command
        The group of all commands.
    """
    command = get_command(app)
    read_numbers_as_typed(command)
    return command


def main() -> None:
    """Run labapp on the arguments of the process, and exit.

    Errors are printed in one or two lines, or with a traceback if --debug is given. The exit code
    is 0 only if all that was asked was done, and the bench was left safe.
    """
    debug = "--debug" in sys.argv
    arguments = [argument for argument in sys.argv[1:] if argument != "--debug"]
    keep_freed_memory()
    collect_garbage_rarely()
    begin_command(arguments)
    guard_library_memory()
    code, words = 0, "see standard error"
    try:
        with reserved_memory():
            build_command_line()(args=arguments, prog_name="labapp")
    except SystemExit as stop:
        code = stop.code if isinstance(stop.code, int) else int(stop.code is not None)
    except (Exception, KeyboardInterrupt) as error:
        if debug:
            raise
        code, words = _report_error(error)
    raise SystemExit(_end_command(code, words))


def _end_command(code: int, words: str) -> int:
    """Print what is still owed, and return the exit code."""
    for reason in unsafe_devices():
        from labapp.common.console import print_error

        print_error(f"not left safe: {reason}")
    code = end_code(code)
    words = "cancelled" if code == CANCELLED_CODE else words
    try:
        print_owed_document(words, code)
        flush_output()
    except BrokenPipeError:
        _write_to_nobody()
        return 141
    return code


def _report_error(error: BaseException) -> tuple[int, str]:
    """Print an error for the user; return the exit code of its kind, and the words."""
    from optics.progress import Cancelled

    if isinstance(error, BrokenPipeError):
        _write_to_nobody()
        return 141, ""
    if isinstance(error, Cancelled | KeyboardInterrupt):
        _print_error("cancelled")
        return CANCELLED_CODE, "cancelled"
    words = _error_message(error)
    _print_error(words)
    return getattr(error, "exit_code", 1), words


def _print_error(words: str) -> None:
    """Print an error; where even the terminal's library lacks memory, as it is."""
    try:
        from labapp.common.console import print_error

        print_error(words)
    except (MemoryError, ImportError):
        from labapp.common.plain_text import printable

        os.write(2, f"{printable(words)}\n".encode())


def _write_to_nobody() -> None:
    """Replace standard output by the null device, because its reader has closed the pipe.

    Python would fail to flush it at exit.
    """
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _error_message(error: Any) -> str:
    """Say an exception in words for the user."""
    from drivers.errors import DeviceError
    from labapp.common.errors import UserError

    if isinstance(error, UserError | ValueError):
        return str(error)
    if shortage := explain_shortage(error):
        return shortage
    if isinstance(error, DeviceError):
        return str(error)
    if isinstance(error, OSError):
        return f"{error.filename or 'file'}: {error.strerror or error}. Check the path and disk."
    return f"unexpected {type(error).__name__}: {error}\nAdd --debug to see where, and report it."
