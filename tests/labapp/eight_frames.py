"""A small run of eight frames, whose record is damaged and edited by several tests."""

from __future__ import annotations

import os
from pathlib import Path

from small_bench.setups import small_setup

from labapp.bench.opening import open_bench
from labapp.files.plan_file import PlanFile
from labapp.runs.acquisition.attendance import Attendance
from labapp.runs.acquisition.runner import run_plan
from labapp.runs.record.place_table import Place, read_table
from labapp.runs.record.second_copy import find_copy, renew_copy
from optics.progress import Progress

PLAN = PlanFile.model_validate(
    {
        "version": 1,
        "title": "Eight frames",
        "seed": 3,
        "patterns": {
            "neutral": {"kind": "constant"},
            "lens": {"kind": "lens", "focal_length_m": 50.0},
        },
        "acquire": [
            {
                "targets": ["dark", "star"],
                "patterns": ["neutral", "lens"],
                "wavelengths_nm": [550],
                "exposures_ms": [1, 2],
            }
        ],
    }
)

SETUP = small_setup((16, 24))


def take(path: Path, frames: int = 8) -> str:
    """Take so many frames of the plan, and return the digest that the run ends with."""
    progress = Progress()

    def stop(shot, frame):
        if shot.index == frames - 1 < 7:
            progress.cancel()

    with open_bench(SETUP) as bench:
        return run_plan(bench, PLAN, path, Attendance(progress=progress, on_frame=stop)).digest


def places(path: Path) -> dict[str, Place]:
    """The places of a record's datasets by name."""
    handle = os.open(path, os.O_RDONLY)
    try:
        return dict(read_table(handle).places)
    finally:
        os.close(handle)


def second_places(path: Path) -> dict[str, Place]:
    """The places of the datasets that a record has twice, in its copy."""
    handle = os.open(path, os.O_RDONLY)
    try:
        table = read_table(handle)
    finally:
        os.close(handle)
    copy = find_copy(table)
    return {name: copy.of(place) for name, place in table.places.items() if copy.has(place)}


def copy_edited(path: Path) -> None:
    """Make the copy in a record that was edited by hand that of what it is now."""
    handle = os.open(path, os.O_RDWR)
    try:
        renew_copy(handle, read_table(handle))
    finally:
        os.close(handle)
