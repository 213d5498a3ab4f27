"""Damaged records: what resuming mends, and the frames that are saved from the others."""

from __future__ import annotations

import json
import lzma
from collections import Counter
from pathlib import Path

import h5py
import numpy as np
import pytest
from eight_frames import SETUP, copy_edited, places, take

from labapp.bench.opening import open_bench
from labapp.common.errors import UserError
from labapp.runs.acquisition.runner import hold_record, resume_run
from labapp.runs.record import layout
from labapp.runs.record.checks import check_record
from labapp.runs.record.reader import Record
from labapp.runs.salvaging import salvage
from labapp.runs.state import State

FRAMES = 8

MANY = (pytest.mark.sweep, pytest.mark.timeout(600))


@pytest.fixture(scope="module")
def good(tmp_path_factory) -> bytes:
    path = tmp_path_factory.mktemp("good") / "run.h5"
    take(path)
    return path.read_bytes()


@pytest.fixture(autouse=True)
def checked_here(monkeypatch):
    """Records are verified in this process, which takes no time to begin."""
    monkeypatch.setattr("labapp.runs.verifying.verify", check_record)


@pytest.fixture
def path(good, tmp_path):
    path = tmp_path / "run.h5"
    path.write_bytes(good)
    return path


def frames_to_take(path) -> list[int]:
    with hold_record(path) as held:
        return held.missing


def frames_as_they_were(data: bytes, good: bytes, path) -> set[int]:
    """Frames whose image and measured columns are, byte for byte, those of the good record."""
    path.write_bytes(good)
    known = [place for n, place in places(path).items() if n in layout.CHANGING and "data/" in n]

    def is_same(index: int) -> bool:
        parts = [(p.offset + index * p.row_bytes, p.row_bytes) for p in known]
        return all(data[at : at + size] == good[at : at + size] for at, size in parts)

    return {index for index in range(FRAMES) if is_same(index)}


def test_every_frame_that_is_there_is_saved_from_a_file_that_is_cut_off(path, good, tmp_path):
    rng = np.random.default_rng(4)
    images = places(path)["entry/data/images"]
    ends = [images.offset + n * images.row_bytes for n in range(1, FRAMES + 1)]
    for cut in (*ends, *(end - 1 for end in ends), *rng.integers(len(good), size=20).tolist()):
        there = sum(end <= cut for end in ends)
        path.write_bytes(good[:cut])
        if not there:
            with pytest.raises(UserError, match=r"Restore|no frame is whole"):
                salvage(path, tmp_path / "saved.h5", force=True)
            continue
        done = salvage(path, tmp_path / "saved.h5", force=True)
        assert (done.saved, done.planned) == (there, FRAMES)
        assert path.read_bytes() == good[:cut]


def test_saved_frames_have_their_settings_and_the_rest_can_be_taken(path, good, tmp_path):
    new, images = tmp_path / "saved.h5", places(path)["entry/data/images"]
    with Record(path) as record:
        columns = {name: record.column(name) for name in (*layout.PLANNED, *layout.MEASURED)}
        pictures = [record.image(index) for index in range(FRAMES)]
        plan, log = record.plan, record.log
    path.write_bytes(good[: images.offset + 5 * images.row_bytes + 7])
    done = salvage(path, new)
    assert done.lacks == ["frames 5-7"]
    found = check_record(new)
    assert (found.failed_checks, found.not_stored) == ([], [5, 6, 7])
    with Record(new) as record:
        assert (record.plan, record.state) == (plan, State.FAILED)
        assert record.message == "salvaged from run.h5; lost: frames 5-7"
        assert record.log[: len(log)] == log
        assert record.closing_digest == done.digest
        for name, column in columns.items():
            kept = slice(None) if name in layout.PLANNED else slice(5)
            np.testing.assert_array_equal(record.column(name)[kept], column[kept])
        for index in range(5):
            np.testing.assert_array_equal(record.image(index), pictures[index])
    with open_bench(SETUP) as bench:
        assert resume_run(bench, new).state is State.COMPLETE
    assert check_record(new).is_in_order
    with Record(new) as record:
        np.testing.assert_array_equal(record.image(7), pictures[7])


def damage(data: bytes, rng: np.random.Generator) -> bytes:
    """One to three pages of zeros or noise, as a power cut leaves them."""
    changed = bytearray(data)
    for _ in range(int(rng.integers(1, 4))):
        size, at = (
            int(rng.choice([512, 1024, 2048, 4096])),
            512 * int(rng.integers(len(data) // 512)),
        )
        page = bytes(size) if rng.random() < 0.5 else rng.bytes(size)
        changed[at : at + size] = page[: len(data) - at]
    return bytes(changed)


@pytest.mark.parametrize("tries", [25, pytest.param(300, marks=MANY)])
def test_damaged_pages_end_in_a_record_in_order_or_in_saved_frames(path, good, tmp_path, tries):
    """COMPLETE only where verify agrees, and hardly a frame is lost that wasn't damaged."""
    rng, counts = np.random.default_rng(5), Counter()
    for _ in range(tries):
        data = damage(good, rng)
        whole = frames_as_they_were(data, good, path)
        path.write_bytes(data)
        counts["whole"] += len(whole)
        try:
            with hold_record(path) as held, open_bench(SETUP) as bench:
                outcome = resume_run(bench, held)
        except UserError:
            try:
                salvage(path, tmp_path / "saved.h5", force=True)
            except UserError:
                continue
            with Record(tmp_path / "saved.h5") as record:
                counts["kept"] += len(whole - set(record.missing_frames()))
            counts["salvaged"] += 1
        else:
            assert (outcome.state is State.COMPLETE) == check_record(path).is_in_order
            counts["kept"] += len(whole - set(held.missing))
            counts["resumed"] += outcome.state is State.COMPLETE
    assert counts["kept"] >= 0.99 * counts["whole"]
    assert counts["resumed"] > 0
    assert counts["salvaged"] > 0


@pytest.mark.parametrize(
    ("name", "row", "words"),
    [
        ("entry/data/target", 3, "written anew from the plan: entry/data/target"),
        ("entry/data/exposure_asked", 0, "written anew from the plan"),
        ("entry/digests/chain", 3, "1 rows of the frames' digests"),
        ("entry/digests/chain", 7, "1 rows of the frames' digests"),
        ("entry/digests/chain", 200, "1 rows of the frames' digests"),
    ],
)
def test_what_follows_from_the_rest_is_repaired(path, good, caplog, name, row, words):
    with h5py.File(path, "r+") as file:
        rows = file[name]
        rows[row] = np.frombuffer(b"\x5a" * rows.dtype.itemsize, rows.dtype)[0]
    copy_edited(path)
    assert check_record(path).failed_checks
    assert frames_to_take(path) == []
    assert words in caplog.text
    assert path.read_bytes() == good


def test_a_lost_table_of_places_is_made_anew(path, good):
    path.write_bytes(bytes(512) + good[512:])
    assert check_record(path).failed_checks
    assert frames_to_take(path) == []
    assert path.read_bytes() == good


def test_a_changed_plan_is_not_mended_but_its_frames_are_saved(path, good, tmp_path):
    at = places(path)["entry/plan"].offset + 10
    path.write_bytes(good[:at] + b"#" + good[at + 1 :])
    copy_edited(path)
    with pytest.raises(UserError, match=r"can't be resumed: structure: entry/plan changed"):
        frames_to_take(path)
    done = salvage(path, tmp_path / "saved.h5")
    assert (done.saved, done.lacks) == (FRAMES, ["the plan"])


def test_frames_of_the_older_format_are_saved_by_their_checksums(path, tmp_path):
    old = tmp_path / "old.h5"
    with h5py.File(path, "r") as new, h5py.File(old, "w") as file:
        new.copy("entry", file)
        file.attrs["labapp_format"] = layout.UNPROTECTED_FORMAT
        for name in ("digests", "log_lost", "capabilities", "copy"):
            del file[f"entry/{name}"]
        file["entry/data/images"][2, 0, 0] ^= 1
    done = salvage(old, tmp_path / "saved.h5")
    assert (done.saved, done.lacks) == (FRAMES - 1, ["frames 2"])


FORMAT_2 = Path(__file__).with_name("record_of_format_2.h5.xz")
"""Eight frames, as labapp 0.1.0 wrote them when format 2 was the newest."""


@pytest.fixture(scope="module")
def older(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("older") / "run.h5"
    path.write_bytes(lzma.decompress(FORMAT_2.read_bytes()))
    return path


@pytest.mark.parametrize("cuts", [12, pytest.param(100, marks=pytest.mark.sweep)])
def test_a_truncated_record_of_the_older_format_gives_every_image_that_is_there(
    older, tmp_path, cuts
):
    data, cut, new = older.read_bytes(), tmp_path / "cut.h5", tmp_path / "saved.h5"
    with h5py.File(older, "r") as file:
        known = file["entry/data"]
        images, asked = known["images"][()], known["exposure_asked"][()]
        begin, end = known["images"].id.get_offset(), known["checksum"].id.get_offset()
        sizes = known["images"].id.get_storage_size() // FRAMES
    for size in np.linspace(0, len(data), cuts, endpoint=False, dtype=int).tolist():
        cut.write_bytes(data[:size])
        whole = min(max(size - begin, 0) // sizes, FRAMES)
        if not whole:
            with pytest.raises(UserError, match=r"no frame is whole|nothing tells"):
                salvage(cut, new)
            continue
        done = salvage(cut, new, force=True)
        assert done.saved == whole
        assert check_record(new).failed_checks == []
        with Record(new) as record:
            for index in range(whole):
                np.testing.assert_array_equal(record.image(index), images[index])
                assert record.column("exposure")[index] == asked[index]
        assert ("the checksums: nothing proves" in " ".join(done.lacks)) == (
            size < end + 4 * FRAMES
        )


def test_an_older_record_that_was_changed_before_it_was_cut_is_not_guessed_at(older, tmp_path):
    """A header is elsewhere than where the same writer puts it: the images may be, too."""
    data, cut = bytearray(older.read_bytes()), tmp_path / "cut.h5"
    with h5py.File(older, "r") as file:
        at = h5py.h5o.get_info(file["entry/patterns/names"].id).addr
    data[at : at + 4] = b"gone"
    cut.write_bytes(data[: len(data) - 100])
    with pytest.raises(UserError, match="nothing tells where its frames are"):
        salvage(cut, tmp_path / "saved.h5")


def test_the_command_says_what_is_saved_and_lost(labapp, path, good, tmp_path):
    images = places(path)["entry/data/images"]
    path.write_bytes(good[: images.offset + 3 * images.row_bytes])
    new = tmp_path / "saved.h5"
    code, printed, _ = labapp("salvage", path, "--out", new, "--json")
    data = json.loads(printed)
    assert (code, data["saved"], data["lacks"]) == (0, 3, ["frames 3-7"])
    code, printed, _ = labapp("salvage", path, "--out", new, "--force")
    assert code == 0
    assert "3 of 8 frames saved" in printed
    assert "lost: frames 3-7" in printed
    for given, out, words in (
        (path, path, "is the damaged record itself"),
        (path, new, "exists already"),
        (tmp_path / "none.h5", new, "no such file"),
    ):
        code, _, error = labapp("salvage", given, "--out", out)
        assert code == 1 or code == 2
        assert words in error


@pytest.mark.parametrize("content", [b"", b"x" * 40000, bytes(40000)])
def test_what_is_no_record_has_nothing_to_save(tmp_path, content):
    path = tmp_path / "garbage.h5"
    path.write_bytes(content)
    with pytest.raises(UserError, match=r"nothing tells|no frame"):
        salvage(path, tmp_path / "saved.h5")


def test_a_run_that_goes_on_is_not_repaired(path):
    from labapp.runs.record.writer import RecordWriter

    with RecordWriter(path), pytest.raises(UserError, match="is being written by process"):
        frames_to_take(path)
