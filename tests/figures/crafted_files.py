"""Crafted files and the commands that read them, and damage to each format of text."""

from __future__ import annotations

import time
import warnings
from pathlib import Path

from hostile.running import Outcome, run_crafted
from hostile.text_formats import TextFormat, read_damaged, text_formats

from figures import Figure

_SECONDS_GOAL, _MEMORY_GOAL = 5.0, 150e6
"""Beyond the start-up, which takes 350 MB of the 500 that are the goal."""

_DAMAGED = 5000

_SLOW = 5.0
"""Seconds of processor time after which the reading of a damaged text counts as endless."""


def crafted_files_figure(folder: Path) -> list[Figure]:
    """Commands on crafted files, each in a process of its own."""
    found = run_crafted(folder)
    named = sum(one.is_named for one in found)
    hung = sum(one.hung for one in found)
    seconds, memory = max(one.seconds for one in found), max(one.memory for one in found)
    return [
        Figure(
            f"{len(found)} commands on crafted files: named",
            "all, none hangs or opens another file",
            f"{named}, {hung} hang",
            named == len(found) and not hung,
        ),
        Figure(
            "the same: most processor time beyond start-up",
            f"<= {_SECONDS_GOAL:g} s",
            f"{seconds:.2f} s, {_slowest(found)}",
            seconds <= _SECONDS_GOAL,
        ),
        Figure(
            "the same: most memory beyond start-up",
            f"<= {_MEMORY_GOAL / 1e6:g} MB",
            f"{memory / 1e6:.0f} MB",
            memory <= _MEMORY_GOAL,
        ),
    ]


def _slowest(found: list[Outcome]) -> str:
    return max(found, key=lambda one: one.seconds).case


def damaged_texts_figure(folder: Path) -> list[Figure]:
    """Texts damaged by chance, read by what reads them."""
    formats = text_formats(folder)
    with warnings.catch_warnings():
        # Numbers at the ends of their ranges make NumPy warn.
        warnings.simplefilter("ignore")
        return [_damaged_figure(form, folder) for form in formats.values()]


def _damaged_figure(form: TextFormat, folder: Path) -> Figure:
    begun = time.process_time()
    found = read_damaged(form, _DAMAGED, 0, folder)
    mean = (time.process_time() - begun) / _DAMAGED
    return Figure(
        f"{_DAMAGED} damaged texts, {form.name}: unexpected, endless",
        "0, 0",
        f"{len(found.unexpected)}, {int(found.longest > _SLOW)}; {found.named} named, "
        f"{1e3 * mean:.1f} ms each, {found.longest:.2f} s at most",
        not found.unexpected and found.longest <= _SLOW,
    )


MEASUREMENTS = {"crafted files": crafted_files_figure, "damaged texts": damaged_texts_figure}
