"""Commands that look at plans before they run."""

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
    """Look at acquisition plans before they run, and find ready ones."""


@plan.command("check")
def plan_check_(
    plan: PlanArgument,
    bench: BenchOption = None,
    scene: SceneOption = None,
    json: JsonOption = False,
) -> None:
    """Say what a plan takes, and whether a bench can do it; nothing moves.

    Frames, expected duration, prompts of a person, room on the disk, and what is asked for
    beside what the bench has. Patterns are tried. Exit code 1 if the run could not be begun,
    or its pictures not be reconstructed as the plan says.
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
    """Print a plan's steps in the order in which they are taken, and when each is due.

    Frames that differ in exposure and repeat alone are one row, darks and prompts stand
    where they come. **--json** gives every frame.
    """
    from labapp.files.plan_file import read_plan

    asked = read_plan(plan)
    from labapp.runs.plan_preview import show_plan

    show_plan(asked, bench, scene, every_row=every_row, as_json=json)


@plan.command("list")
def plan_list_(json: JsonOption = False) -> None:
    """List the ready plans: what each is for, and what it needs.

    They run as they are on the virtual bench. Each file's comments say what to change for a
    bench of your own: copy it, and pass the copy's path.
    """
    from labapp.runs.bundled_plans import list_plans

    list_plans(as_json=json)
