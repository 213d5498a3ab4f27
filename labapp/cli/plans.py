"""Checking, showing and listing acquisition plans: `labapp plan ...`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from labapp.cli.app import app
from labapp.cli.shared_options import BenchOption, JsonOption, SceneOption

plan = typer.Typer(no_args_is_help=True, rich_markup_mode="markdown")
app.add_typer(plan, name="plan")

PlanArgument = Annotated[
    Path, typer.Argument(metavar="PLAN", help="Plan file (TOML, JSON) or name of a ready plan.")
]


@plan.callback()
def plan_() -> None:
    """Check, show and list acquisition plans by command, without acquiring anything."""


@plan.command("check")
def plan_check_(
    plan: PlanArgument,
    bench: BenchOption = None,
    scene: SceneOption = None,
    json: JsonOption = False,
) -> None:
    """Check what PLAN needs, and whether a bench (--bench) can run it; no device moves.

    The command prints the number of frames, the expected duration, the prompts, the disk space, and
    each requirement beside what the bench has. Patterns are computed. The exit code is 1 if the run
    can't start, or if its pictures can't be reconstructed as the plan says. For instance

    **labapp plan check psf-over-wavelengths**
    """
    from labapp.files.plan_file import read_plan

    asked = read_plan(plan)
    from labapp.runs.plan_preview import check_plan

    check_plan(asked, bench, scene, as_json=json)


@plan.command("show")
def plan_show_(
    plan: PlanArgument,
    bench: BenchOption = None,
    scene: SceneOption = None,
    every_row: Annotated[
        bool, typer.Option("--all", help="Print every row, however many there are.")
    ] = False,
    json: JsonOption = False,
) -> None:
    """Print the steps of PLAN in order, with the time at which each is due (--all for every row).

    Frames that differ only in exposure time and repeat share a row. Dark frames and prompts are
    listed where they come. **--json** gives every frame. For instance

    **labapp plan show psf-over-wavelengths**
    """
    from labapp.files.plan_file import read_plan

    asked = read_plan(plan)
    from labapp.runs.plan_preview import show_plan

    show_plan(asked, bench, scene, every_row=every_row, as_json=json)


@plan.command("list")
def plan_list_(json: JsonOption = False) -> None:
    """List the ready plans that commands take by name: what each is for, and what it needs.

    They run unchanged on the virtual bench. The comments in each file say what to change for your
    own bench: copy the file, and pass the path of the copy.
    """
    from labapp.runs.bundled_plans import list_plans

    list_plans(as_json=json)
