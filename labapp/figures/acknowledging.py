"""A run that prints the index of each frame once it is acknowledged, to be killed."""

from __future__ import annotations

import sys
from pathlib import Path

from drivers.interfaces import Frame
from labapp.acquisition.runner import OnFrame, Outcome, run_plan
from labapp.acquisition.steps import Shot
from labapp.bench import BenchFiles, open_bench
from labapp.files.plan_file import PlanFile
from labapp.files.reading import bundled, read_file


def run_bundled(path: Path, on_frame: OnFrame | None = None) -> Outcome:
    """The demo's plan on the bundled bench."""
    plan = read_file(bundled("first_light.toml"), PlanFile)
    with open_bench(BenchFiles.default()) as bench:
        return run_plan(bench, plan, path, on_frame=on_frame)


def _tell(shot: Shot, frame: Frame) -> None:
    # One write a line, so that a kill can't cut one in two.
    sys.stdout.write(f"{shot.index}\n")
    sys.stdout.flush()


if __name__ == "__main__":
    run_bundled(Path(sys.argv[1]), _tell)
