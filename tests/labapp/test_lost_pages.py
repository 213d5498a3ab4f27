"""A page of a record that a disk has lost takes no image with it whose own bytes are whole."""

from __future__ import annotations

import lzma
import os
from pathlib import Path

import h5py
import numpy as np
import pytest
from eight_frames import PLAN, SETUP, copy_edited, places, second_places
from judges.lost_pages import SIZES, LostPages, Page

from labapp.bench.opening import open_bench
from labapp.common.errors import UserError
from labapp.runs.acquisition.runner import hold_record, resume_run
from labapp.runs.record.checks import check_record
from labapp.runs.record.reader import Record
from labapp.runs.record.second_copy import APART
from labapp.runs.salvaging import salvage
from labapp.runs.state import State

PAGE = 4096

PARTS = {
    "table of places": 0,
    "superblock": 1 << 15,
    "root group": (1 << 15) + 512,
    "plan": "entry/plan",
    "state": "entry/state",
    "structure": "entry/digests/structure",
    "closing": "entry/digests/closing",
    "chain": "entry/digests/chain",
    "planned columns": "entry/data/exposure_asked",
    "measured columns": "entry/data/exposure",
    "marks": "entry/data/stored",
    "log": "entry/log",
    "patterns": "entry/patterns/images",
    "image": "entry/data/images",
    "copy of the table": "copy",
    "copy of the columns": "copy of entry/data/exposure",
    "foot of the copy": -PAGE,
}
"""Where pages are lost: what lies in them."""


@pytest.fixture(autouse=True)
def checked_here(monkeypatch):
    """Records are verified in this process, which takes no time to begin."""
    monkeypatch.setattr("labapp.runs.verifying.verify", check_record)


@pytest.fixture(scope="module")
def complete(tmp_path_factory) -> LostPages:
    return LostPages(SETUP, PLAN, tmp_path_factory.mktemp("complete") / "run.h5", 8)


@pytest.fixture(scope="module")
def unfinished(tmp_path_factory) -> LostPages:
    return LostPages(SETUP, PLAN, tmp_path_factory.mktemp("unfinished") / "run.h5", 5)


def page_of(record: LostPages, part: str, content: bytes) -> Page:
    record.path.write_bytes(record.data)
    second = second_places(record.path)
    known = {name: place.offset for name, place in places(record.path).items()}
    known |= {f"copy of {name}": place.offset for name, place in second.items()}
    known["copy"] = second["entry/title"].offset - places(record.path)["entry/title"].offset
    where = PARTS[part]
    at = known[where] if isinstance(where, str) else where % len(record.data)
    return Page(at - at % PAGE, content)


@pytest.mark.parametrize("part", PARTS)
def test_every_whole_image_is_saved_after_the_loss_of_a_page(complete, part):
    old = np.random.default_rng(len(part)).bytes(PAGE)
    assert complete.salvage(page_of(complete, part, old)).is_right


@pytest.mark.parametrize("part", ["measured columns", "chain", "table of places"])
def test_a_record_that_was_not_finished_is_saved_alike(unfinished, part):
    assert unfinished.salvage(page_of(unfinished, part, bytes(PAGE))).is_right


@pytest.mark.parametrize("part", ["table of places", "superblock", "closing", "measured columns",
                                  "copy of the columns"])  # fmt: skip
def test_verify_names_the_loss_and_resume_mends_it(complete, part):
    """All that stands twice is as it was, byte for byte, and no frame is taken again."""
    page = page_of(complete, part, bytes(PAGE))
    complete.path.write_bytes(page.in_file(complete.data))
    verdict = check_record(complete.path).verdict
    assert "labapp salvage" in verdict or "labapp resume" in verdict
    with hold_record(complete.path) as held:
        assert held.missing == []
    assert complete.path.read_bytes() == complete.data


def test_what_stands_twice_is_a_mebibyte_apart(complete):
    complete.path.write_bytes(complete.data)
    second = second_places(complete.path)
    assert second.keys() == places(complete.path).keys() - {
        "entry/log", "entry/patterns/images", "entry/data/images", "entry/copy"
    }  # fmt: skip
    for name, place in places(complete.path).items():
        assert name not in second or second[name].offset - place.offset >= APART == 1 << 20
    # Nothing else comes after the log than what the table names.
    ends = [place.end for place in places(complete.path).values()]
    assert max(ends) == len(complete.data)


@pytest.mark.sweep
@pytest.mark.timeout(600)
@pytest.mark.parametrize("size", SIZES)
def test_no_page_of_a_record_takes_a_whole_image_with_it(complete, size):
    rng = np.random.default_rng(size)
    pages = list(complete.pages(size, rng))
    for number in rng.choice(len(pages), 60, replace=False):
        found = complete.salvage(pages[number])
        assert found.is_right, (pages[number].offset, found)


FORMAT_3 = Path(__file__).with_name("record_of_format_3.h5.xz")
"""Eight frames as labapp 0.1.0 wrote them when format 3 was the newest."""


@pytest.fixture
def older(tmp_path) -> Path:
    path = tmp_path / "older.h5"
    path.write_bytes(lzma.decompress(FORMAT_3.read_bytes()))
    return path


def test_a_record_of_format_3_is_read_and_goes_on(older):
    found = check_record(older)
    assert found.is_in_order
    with h5py.File(older, "r+") as file:
        image = file["entry/data/images"][3]
        file["entry/data/images"][3] = 0
    assert "labapp resume" in check_record(older).verdict
    with open_bench(SETUP) as bench:
        assert resume_run(bench, older).state is State.COMPLETE
    assert check_record(older).is_in_order
    with Record(older) as record:
        np.testing.assert_array_equal(record.stored_image(3), image)


def test_a_record_of_format_3_without_its_settings_gives_its_images(older, tmp_path):
    """They stand nowhere else in it: the planned ones are told instead."""
    with h5py.File(older, "r+") as file:
        images, asked = file["entry/data/images"][()], file["entry/data/exposure_asked"][()]
        for name in ("exposure", "wavelength", "gain", "time", "timestamp"):
            file[f"entry/data/{name}"][:] = 0
    done = salvage(older, tmp_path / "saved.h5")
    assert (done.saved, done.lacks) == (
        8, ["the measured settings, those that were planned instead"]
    )  # fmt: skip
    with Record(tmp_path / "saved.h5") as record:
        np.testing.assert_array_equal(record.column("exposure"), asked)
        for index in range(8):
            np.testing.assert_array_equal(record.stored_image(index), images[index])


def test_settings_that_are_lost_thrice_are_told_as_planned(complete, tmp_path):
    """In the column, in the frame's link, and in the copy of both."""
    complete.path.write_bytes(complete.data)
    with h5py.File(complete.path, "r+") as file:
        asked = file["entry/data/exposure_asked"][()]
        file["entry/data/exposure"][2] = 0
        rows = file["entry/digests/chain"][()]
        rows["values"][2] = 0
        file["entry/digests/chain"][...] = rows
    copy_edited(complete.path)
    done = salvage(complete.path, tmp_path / "saved.h5")
    assert done.saved == 8
    assert done.lacks == ["the measured settings of frames 2, those that were planned instead"]
    with Record(tmp_path / "saved.h5") as record:
        assert record.column("exposure")[2] == asked[2]


@pytest.mark.parametrize("name", ["entry/data/gain", "entry/title", "entry/digests/chain"])
def test_a_copy_that_differs_is_named(complete, name):
    at = None
    complete.path.write_bytes(complete.data)
    at = second_places(complete.path)[name].offset
    handle = os.open(complete.path, os.O_RDWR)
    os.pwrite(handle, bytes([complete.data[at] ^ 1]), at)
    os.close(handle)
    found = check_record(complete.path)
    assert found.failed_checks == ["copy"]
    assert name in found.reason
    assert "To mend it: labapp resume" in found.verdict


def test_a_command_on_a_record_that_has_lost_a_page_says_what_to_do(labapp, complete, tmp_path):
    for part in ("superblock", "plan", "measured columns"):
        page = page_of(complete, part, bytes(PAGE))
        complete.path.write_bytes(page.in_file(complete.data))
        out = tmp_path / part
        code, _, error = labapp("export", complete.path, "--to", "npy", "--out", out)
        assert code == 1
        assert "labapp salvage" in error
        with pytest.raises(UserError, match="labapp salvage"), Record(complete.path) as record:
            record.text("plan")
