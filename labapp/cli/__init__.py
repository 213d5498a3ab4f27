"""The command line: `labapp --help` teaches it.

A module is a command, or a group of them, and help lists them in the order in which they are
imported here. Commands import what they need when they run, so that help is instant.
"""

from __future__ import annotations

import os
import sys
from functools import cache
from typing import Any

from typer.main import get_command

# isort: off
from labapp.cli.app import app
from labapp.cli import demo, runs, records, calibrate  # noqa: F401
from labapp.cli import psf_command, beam_command, patterns, refine, simulated_pictures  # noqa: F401
from labapp.cli import reconstruct, study, train, gui  # noqa: F401
from labapp.cli import accuracy, plans, devices, bench, virtual_bench, guide  # noqa: F401
from labapp.common.memory import keep_freed_memory

# isort: on

__all__ = ["app", "build_command_line", "main"]


@cache
def build_command_line() -> Any:
    """The command line with all its verbs. It takes .05 s to build, so it's built once."""
    return get_command(app)


def main() -> None:
    """Run the command line; errors are one or two lines, and a traceback with --debug."""
    debug = "--debug" in sys.argv
    arguments = [argument for argument in sys.argv[1:] if argument != "--debug"]
    keep_freed_memory()
    try:
        build_command_line()(args=arguments, prog_name="labapp")
    except (Exception, KeyboardInterrupt) as error:
        if debug:
            raise
        raise SystemExit(_report_error(error)) from None


def _report_error(error: BaseException) -> int:
    """Print an error for a person; the exit code that says what kind it was."""
    from labapp.common.console import print_error
    from optics.progress import Cancelled

    if isinstance(error, BrokenPipeError):
        # Whoever read our output has gone; closing it again would complain.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 141
    if isinstance(error, Cancelled | KeyboardInterrupt):
        print_error("cancelled")
        return 130
    print_error(_error_message(error))
    return 1


def _error_message(error: Any) -> str:
    from drivers.errors import DeviceError
    from labapp.common.errors import UserError

    if isinstance(error, UserError | DeviceError | ValueError):
        return str(error)
    if isinstance(error, OSError):
        return f"{error.filename or 'file'}: {error.strerror or error}. Check the path and disk."
    return f"unexpected {type(error).__name__}: {error}\nAdd --debug to see where, and report it."
