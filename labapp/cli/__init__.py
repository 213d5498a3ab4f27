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
from labapp.cli import demo, runs, records, bracket_command, merge_command, calibrate  # noqa: F401
from labapp.cli import psf_command, beam_command, patterns, design, refine, simulated_pictures  # noqa: F401
from labapp.cli import reconstruct, study, train, gui  # noqa: F401
from labapp.cli import accuracy, accuracy_hdr, plans, devices, bench, virtual_bench, guide  # noqa: F401
from labapp.common.memory import keep_freed_memory

# isort: on

__all__ = ["app", "build_command_line", "main"]


@cache
def build_command_line() -> Any:
    """Build the command line with all its commands, once, because it takes 0.05 s.

    Returns
    -------
    click.Command
        The group of all commands.
    """
    return get_command(app)


def main() -> None:
    """Run the command line of labapp on the arguments of the process.

    Errors are printed in one or two lines, or with a traceback if --debug is given.
    """
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
    """Print a command's error for the user, and return the exit code of its kind."""
    from labapp.common.console import print_error
    from optics.progress import Cancelled

    if isinstance(error, BrokenPipeError):
        # The reader of the output has closed its pipe. Python would fail to flush standard output
        # at exit, so that it is replaced by the null device.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 141
    if isinstance(error, Cancelled | KeyboardInterrupt):
        print_error("cancelled")
        return 130
    print_error(_error_message(error))
    return 1


def _error_message(error: Any) -> str:
    """Return what the command line prints for an exception."""
    from drivers.errors import DeviceError
    from labapp.common.errors import UserError

    if isinstance(error, UserError | DeviceError | ValueError):
        return str(error)
    if isinstance(error, OSError):
        return f"{error.filename or 'file'}: {error.strerror or error}. Check the path and disk."
    return f"unexpected {type(error).__name__}: {error}\nAdd --debug to see where, and report it."
