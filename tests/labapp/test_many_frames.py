"""A plan of a million frames, and what records of many frames take of memory."""

from __future__ import annotations

import tracemalloc
from contextlib import contextmanager
from itertools import islice

import numpy as np
import pytest
from plans import abilities, block, plan_of
from pydantic import ValidationError

from drivers.interfaces import Identity
from labapp.runs.acquisition.feasibility import estimate_run
from labapp.runs.export.export_job import ExportJob
from labapp.runs.export.ome_tiff import ome_xml
from labapp.runs.record.checks import check_record
from labapp.runs.record.creation import RecordContents, create_record
from labapp.runs.record.reader import Record
from labapp.runs.record.writer import RecordWriter
from labapp.runs.shots import Shot, ShotList
from labapp.runs.steps import planned_shots
from optics.progress import Progress

MOST_BYTES = 300
"""Bytes of memory that a frame may take in any step."""

WHEEL = abilities()

EXPOSURES = [1, 2, 3, 5, 8]


def plan(frames: int):
    repeats, rest = divmod(frames, 4 * 5)
    assert rest == 0
    return plan_of(
        block(
            targets=["star", "photograph"],
            patterns=["neutral", "lens"],
            exposures_ms=EXPOSURES,
            repeats=repeats,
            order=["repeat"],
        )
    )


@contextmanager
def at_most(frames: int):
    """More memory than that at any time in the block is an error."""
    tracemalloc.start()
    try:
        yield
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak / frames <= MOST_BYTES


def test_frames_of_a_plan_take_some_bytes_each():
    frames = 100_000
    asked = plan(frames)
    with at_most(frames):
        listed = planned_shots(asked, WHEEL)
        expected = estimate_run(listed, asked, WHEEL)
    assert expected.frames == len(listed) == frames
    # By hand: each repeat shows all settings, the exposure fastest.
    assert [shot.exposure for shot in islice(listed, 6)] == [1e-3, 2e-3, 3e-3, 5e-3, 8e-3, 1e-3]
    last = listed[-1]
    assert (last.index, last.repeat, last.step) == (frames - 1, frames // 20 - 1, 19)
    assert (last.target, last.pattern, last.exposure) == ("photograph", "lens", 8e-3)


def test_a_million_frames_are_a_plan():
    several = block(exposures_ms=list(range(1, 101)), repeats=10_000)
    assert plan_of(several).acquire[0].frame_limit() == 1_000_000


def test_more_than_a_record_holds_are_refused_with_the_limit():
    several = block(exposures_ms=list(range(1, 202)), repeats=10_000)
    with pytest.raises(ValidationError, match="up to 2,010,000 frames, and a record at most 2,0"):
        plan_of(several)


def test_a_list_of_shots_is_a_sequence_of_them():
    shots = [
        Shot(
            number, number // 2, number % 2, f"t{number % 3}", "p", 5e-7, 0.01, "dark", "here", "?"
        )
        for number in range(2100)
    ]
    listed = ShotList.of(shots)
    assert list(listed) == shots == listed
    assert (listed[-1], listed[7]) == (shots[-1], shots[7])
    assert listed[5:9] == shots[5:9]
    assert listed.pick([3, 1]) == [shots[3], shots[1]]
    assert [shot.index for shot in listed.distinct("target", "repeat")] == [0, 1, 2, 3, 4, 5]
    assert ShotList.of(listed) is listed
    assert listed != shots[1:]
    with pytest.raises(IndexError):
        listed[2100]


def test_records_of_many_frames_are_read_in_parts(tmp_path):
    """The log and the chains of frames have more bytes each than that."""
    frames, stored = 20_000, 1_000
    path = tmp_path / "run.h5"
    shots = [Shot(n, n, 0, "star", "ring", 550e-9, 0.01) for n in range(frames)]
    contents = RecordContents(
        title="Long", seed=1, plan={}, bench={}, scene=None, effect_plan=None,
        identities={"camera": Identity("camera", "1", simulated=True)},
        targets=("star",), patterns={"ring": np.zeros((4, 6), np.uint8)}, shots=ShotList.of(shots),
        frame_shape=(2, 2), pixel_pitch=1e-6,
    )  # fmt: skip
    with at_most(frames):
        handle = create_record(path, contents)
    values = dict.fromkeys(("exposure", "wavelength", "gain", "time", "timestamp", "number"), 1)
    with RecordWriter(path, handle) as writer:
        for index in range(stored):
            writer.store_values(index, np.full((2, 2), index, np.uint16), values | {"attempts": 1})
            writer.log(0.0, f"frame {index}")
    with at_most(frames):
        found = {one.check: one for one in check_record(path).findings}
    assert found["digests"].detail.startswith(f"{stored} links")
    assert found["log"].detail.startswith(f"{stored} lines")
    assert found["checksums"].result == "ok"
    with Record(path) as record, at_most(frames):
        job = ExportJob(record, "ome-tiff", list(range(frames)), Progress())
        assert sum(part.count("<Plane ") for part in islice(ome_xml(job), 2000)) == 1999
    with at_most(frames), RecordWriter(path) as writer:
        assert writer.is_stored_intact(stored - 1)
        assert not writer.is_stored_intact(stored)
