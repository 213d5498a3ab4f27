"""`labapp run`: a plan file on a bench."""

from __future__ import annotations

from pathlib import Path

from labapp.acquisition.runner import Outcome, run_plan
from labapp.acquisition.state import State
from labapp.bench import BenchFiles, open_bench
from labapp.console import out, print_json, watched
from labapp.errors import UserError
from labapp.files.plan_file import PlanFile
from labapp.files.reading import read_toml
from optics.progress import Cancelled


def run_file(
    plan_path: Path,
    record_path: Path,
    *,
    bench: Path | None,
    scene: Path | None,
    image: Path | None,
    force: bool,
    as_json: bool,
) -> None:
    """Run a plan file and say how it ended; anything but COMPLETE is an error."""
    plan = read_toml(plan_path, PlanFile)
    with open_bench(BenchFiles.default(bench, scene, image)) as opened, watched() as progress:
        outcome = run_plan(
            opened,
            plan,
            record_path,
            source=str(plan_path),
            folder=plan_path.parent,
            force=force,
            progress=progress,
        )
    if as_json:
        print_json(
            {
                "record": str(outcome.path),
                "state": outcome.state,
                "missing": outcome.missing,
                "message": outcome.message,
            }
        )
    elif outcome.state is State.COMPLETE:
        out.print(f"{outcome.path}: COMPLETE. See it with: labapp show {outcome.path}")
    require_complete(outcome)


def require_complete(outcome: Outcome) -> None:
    """Cancelled if the user cancelled; UserError if frames are missing for another reason."""
    if outcome.state is State.CANCELLED:
        raise Cancelled(f"{outcome.path}: CANCELLED, {len(outcome.missing)} frames not taken")
    if outcome.state is not State.COMPLETE:
        listed = ", ".join(str(index) for index in outcome.missing[:8])
        raise UserError(
            f"{outcome.path}: FAILED: {outcome.message}\n"
            f"{len(outcome.missing)} frames are missing ({listed}"
            f"{', ...' if len(outcome.missing) > 8 else ''}). Mend the cause and run it again."
        )
