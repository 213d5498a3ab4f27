"""Pages of a record that a disk has lost, and what salvage saves of the rest."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from judges.lost_pages import SIZES, LostPages, Page
from small_bench.setups import small_setup

from figures import Figure
from labapp.bench.opening import open_bench
from labapp.common.console import print_message
from labapp.common.errors import UserError
from labapp.files.plan_file import PlanFile
from labapp.runs.acquisition.runner import resume_run
from labapp.runs.salvaging import salvage
from labapp.runs.state import State
from labapp.runs.verifying import verify

_PLAN = {
    "version": 1,
    "title": "Sixteen frames",
    "seed": 5,
    "patterns": {
        "neutral": {"kind": "constant"},
        "lens": {"kind": "lens", "focal_length_m": 50.0},
    },
    "acquire": [
        {
            "targets": ["dark", "star"],
            "patterns": ["neutral", "lens"],
            "wavelengths_nm": [550, 600],
            "exposures_ms": [1, 2],
        }
    ],
}

_FRAMES, _UNFINISHED = 16, 11

_ADVISED = 40
"""Pages of each record after whose loss the advice of `verify` is followed."""

_TOLD = 1000


def lost_pages_figure(folder: Path) -> list[Figure]:
    """Every page of a complete and of an unfinished record lost in turn, zeroed and with noise."""
    setup, plan = small_setup((16, 24)), PlanFile.model_validate(_PLAN)
    found: list[Figure] = []
    for name, frames in (("complete", _FRAMES), ("unfinished", _UNFINISHED)):
        record = LostPages(setup, plan, folder / f"{name}.h5", frames)
        pages = list(_pages(record))
        found.append(_salvaged(name, record, pages))
        drawn = np.random.default_rng(7).choice(len(pages), _ADVISED, replace=False)
        found.append(_advised(name, record, [pages[n] for n in drawn]))
    return found


def _pages(record: LostPages) -> Iterator[Page]:
    """All pages of all sizes; where there are only zeros, of the largest size alone."""
    rng = np.random.default_rng(3)
    for size in SIZES:
        for page in record.pages(size, rng):
            end = page.offset + size
            if size == max(SIZES) or any(record.data[page.offset : end]):
                yield page


def _salvaged(name: str, record: LostPages, pages: list[Page]) -> Figure:
    counts: Counter[str] = Counter()
    for number, page in enumerate(pages):
        one = record.salvage(page)
        counts.update(lost=len(one.lost), wrong=len(one.wrong), unexpected=bool(one.unexpected))
        if number % _TOLD == _TOLD - 1:
            print_message(f"  {name}: {number + 1} of {len(pages)} pages")
    bad = counts["lost"], counts["wrong"], counts["unexpected"]
    return Figure(
        f"{name} record, a page of 512 to 4096 B lost, then salvage: images whose bytes are whole "
        "that aren't saved; saved wrong; commands that end unexpectedly",
        "0; 0; 0",
        f"{bad[0]}; {bad[1]}; {bad[2]}, after {len(pages)} pages",
        not any(bad),
    )


def _advised(name: str, record: LostPages, pages: list[Page]) -> Figure:
    counts: Counter[str] = Counter()
    for page in pages:
        counts[_follow_advice(record, page)] += 1
    right = counts["salvaged"] + counts["resumed"] + counts["in order"]
    return Figure(
        f"{name} record, a page lost: the command that verify names keeps every whole image",
        "always",
        f"{right} of {len(pages)}: " + ", ".join(f"{n} {what}" for what, n in counts.items()),
        right == len(pages),
    )


def _follow_advice(record: LostPages, page: Page) -> str:
    """What came of the command that verify names: what was done, or what went wrong."""
    data, new = page.in_file(record.data), record.path.with_name("saved.h5")
    record.path.write_bytes(data)
    whole, told = record.whole(data), ""
    try:
        found = verify(record.path)
        if "labapp salvage" in found.verdict:
            told = " ".join(salvage(record.path, new, force=True).lacks)
            done = "salvaged"
        elif "labapp resume" in found.verdict:
            with open_bench(small_setup((16, 24))) as bench:
                outcome = resume_run(bench, record.path)
            if outcome.state is not State.COMPLETE or not verify(record.path).is_in_order:
                return "resumed, and not COMPLETE"
            new, done = record.path, "resumed"
        else:
            new, done = record.path, "in order"
    except UserError as error:
        return f"refused: {error}"
    except Exception as error:
        return f"unexpected: {type(error).__name__}: {error}"
    judged = record.judge(new, whole, told, taken_again=done == "resumed")
    return (
        done if judged.is_right else f"{done}, {len(judged.lost)} lost, {len(judged.wrong)} wrong"
    )


MEASUREMENTS = {"lost pages": lost_pages_figure}
