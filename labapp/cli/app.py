"""The Typer application that all commands of labapp belong to."""

from __future__ import annotations

from typing import Annotated

import typer

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode="markdown",
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _print_version(requested: bool) -> None:
    """Print the version and exit, if `requested`."""
    if requested:
        from labapp.common.program_version import describe_version

        print(f"labapp {describe_version()}")
        raise typer.Exit


@app.callback()
def labapp_(
    version: Annotated[
        bool,
        typer.Option(
            "--version",
            callback=_print_version,
            is_eager=True,
            help="Print version and commit, and exit.",
        ),
    ] = False,
    debug: Annotated[
        bool, typer.Option("--debug", help="Show the traceback of an error; for any command.")
    ] = False,
) -> None:
    """Control programmable optics for computational photography from the command line.

    A phase-only SLM in front of a camera lens makes the optics programmable. labapp computes its
    patterns, runs acquisitions on a real or simulated bench, and undoes the coding. Start with
    **labapp demo**, which needs no hardware, then open **labapp gui**.
    """
