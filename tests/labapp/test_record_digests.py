"""Digests of a record: any change is named, by an adversary's hand, too."""

from __future__ import annotations

import json
import os
from hashlib import sha256

import h5py
import numpy as np
import pytest
from eight_frames import copy_edited, places, second_places, take
from forging import forge

from labapp.runs.record.checks import check_record
from labapp.runs.record.reader import Record
from labapp.runs.state import State

MANY = (pytest.mark.sweep, pytest.mark.timeout(600))


@pytest.fixture(scope="module")
def complete(tmp_path_factory) -> tuple[bytes, str]:
    path = tmp_path_factory.mktemp("complete") / "run.h5"
    digest = take(path)
    return path.read_bytes(), digest


@pytest.fixture(scope="module")
def interrupted(tmp_path_factory) -> bytes:
    """A record of five frames whose writer is gone without a word."""
    path = tmp_path_factory.mktemp("interrupted") / "run.h5"
    take(path, 5)
    with h5py.File(path, "r+") as file:
        gone = json.loads(file["entry/writer"][0]) | {"start": "1"}
        file["entry/writer"][0] = json.dumps(gone).encode()
        file["entry/state"][0] = b"RUNNING"
        file["entry/message"][0] = file["entry/end_time"][0] = b""
        file["entry/digests/closing"][0] = 0
    copy_edited(path)
    assert check_record(path).failed_checks == []
    return path.read_bytes()


def unnoticed_flips(path, data: bytes, count: int, seed: int, aside: tuple[str, ...]) -> list[str]:
    """Flip single bits, half of them in datasets, and return where that wasn't noticed."""
    rng, missed = np.random.default_rng(seed), []
    path.write_bytes(data)
    known = {name: place for name, place in places(path).items() if name not in aside}
    twice = second_places(path)
    everywhere = np.ones(len(data), bool)
    for name, place in (*places(path).items(), *twice.items()):
        everywhere[place.offset : place.end] = name not in aside
    positions = np.flatnonzero(everywhere)
    known |= {f"copy of {name}": twice[name] for name in known if name in twice}
    del known["entry/copy"]
    for number in range(count):
        place = known[list(known)[rng.integers(len(known))]]
        inside = place.offset + int(rng.integers(place.size))
        at = inside if number % 2 else int(rng.choice(positions))
        changed = bytes([data[at] ^ (1 << int(rng.integers(8)))])
        for byte in (changed, data[at : at + 1]):
            with path.open("r+b", 0) as file:
                file.seek(at)
                file.write(byte)
            if byte == changed and not check_record(path).failed_checks:
                missed.append(
                    f"byte {at}, {[n for n, p in known.items() if p.offset <= at < p.end]}"
                )
    return missed


@pytest.mark.parametrize("count", [50, pytest.param(1000, marks=MANY)])
def test_every_flipped_bit_of_a_complete_record_is_found(tmp_path, complete, count):
    assert unnoticed_flips(tmp_path / "run.h5", complete[0], count, 1, ()) == []


UNPROTECTED_WHILE_OPEN = tuple(f"entry/{name}" for name in ("state", "message", "writer"))


@pytest.mark.parametrize("count", [30, pytest.param(1000, marks=MANY)])
def test_every_flipped_bit_of_an_interrupted_record_is_found(tmp_path, interrupted, count):
    """But for those that `verify` says aren't protected yet, images that were never taken, and the
    last frame's mark, which a killed writer may not have set: `verify` says so."""
    path = tmp_path / "run.h5"
    path.write_bytes(interrupted)
    images = places(path)["entry/data/images"]
    written = interrupted[: images.offset + 5 * images.row_bytes]
    known = UNPROTECTED_WHILE_OPEN
    missed = unnoticed_flips(path, interrupted, count, 2, known)
    beyond = [*range(len(written), images.end), places(path)["entry/data/stored"].offset + 4]
    assert [one for one in missed if int(one.split()[1].rstrip(",")) not in beyond] == []


def put(name, row, value):
    def change(file):
        file[name][row] = value

    return change


def scale(name, factor):
    def change(file):
        file[name][:] = file[name][:] * factor

    return change


def replace_text(name, old, new):
    def change(file):
        text = file[name][()]
        assert old in text
        file[name][()] = text.replace(old, new)

    return change


def exchange(*names):
    """Exchange the rows of two frames in all datasets that are named."""

    def change(file):
        for name in names:
            rows = file[name]
            rows[2], rows[3] = rows[3], rows[2]

    return change


def all_of_frames(*more):
    from labapp.runs.record import layout

    return exchange("entry/data/images", *(f"entry/data/{n}" for n in layout.MEASURED), *more)


def repeat_frame(file):
    from labapp.runs.record import layout

    for name in ("images", *layout.MEASURED):
        rows = file[f"entry/data/{name}"]
        rows[3] = rows[2]


def cut_last_frame(file):
    from labapp.runs.record import layout

    for name in ("images", *layout.MEASURED):
        rows = file[f"entry/data/{name}"]
        rows[7] = np.zeros(rows.shape[1:], rows.dtype)
    file["entry/digests/chain"][7] = np.zeros((), layout.CHAIN_ROW)


EDITS = {
    "seed": put("entry/seed", (), 4),
    "gain": scale("entry/data/gain", 10),
    "title": replace_text("entry/title", b"Eight", b"Seven"),
    "start": replace_text("entry/start_time", b"20", b"19"),
    "plan": replace_text("entry/plan", b"50.0", b"60.0"),
    "bench": replace_text("entry/bench", b'"', b"'"),
    "effect plan": replace_text("entry/effect_plan", b"1", b"2"),
    "versions": replace_text("entry/versions", b"labapp", b"labupp"),
    "clock": replace_text("entry/clock", b"virtual", b"real   "),
    "expected time": put("entry/expected_seconds", (), 1.0),
    "target names": put("entry/targets/names", 0, b"star"),
    "pattern names": put("entry/patterns/names", 0, b"lens"),
    "pattern": put("entry/patterns/images", (1, 3, 3), 9),
    "pattern digest": put("entry/patterns/sha256", 0, b"0" * 64),
    "pattern frames": put("entry/patterns/frame_time", 0, 1.0),
    "pattern index": put("entry/data/pattern", 3, 0),
    "target index": put("entry/data/target", 3, 1),
    "role": put("entry/data/role", 3, 1),
    "step": put("entry/data/step", 3, 7),
    "repeat": put("entry/data/repeat", 3, 1),
    "slot": put("entry/data/slot", 3, 1),
    "exposure asked": put("entry/data/exposure_asked", 3, 0.0021),
    "wavelength asked": put("entry/data/wavelength_asked", 3, 551e-9),
    "exposure": put("entry/data/exposure", 3, 0.00201),
    "wavelength": put("entry/data/wavelength", 3, 550.005e-9),
    "time": put("entry/data/time", 7, 99.0),
    "timestamp": put("entry/data/timestamp", 3, 1.0e9),
    "number": put("entry/data/number", 7, 99),
    "attempts": put("entry/data/attempts", 3, 2),
    "checksum": put("entry/data/checksum", 3, 1),
    "stored": put("entry/data/stored", 3, 0),
    "stored, twice": put("entry/data/stored", 3, 2),
    "image": put("entry/data/images", (3, 2, 2), 9),
    "images exchanged": exchange("entry/data/images"),
    "frames exchanged": all_of_frames(),
    "frames exchanged with links": all_of_frames("entry/digests/chain"),
    "frame repeated": repeat_frame,
    "frame cut": cut_last_frame,
    "link": put("entry/digests/chain", 3, 0),
    "structure's digest": put("entry/digests/structure", 0, 0),
    "closing digest": put("entry/digests/closing", 0, 7),
    "log time": put("entry/log", (0, "time"), 3.0),
    "log text": put("entry/log", (1, "text"), b"all is well"),
    "log line cut": put("entry/log", 0, 0),
    "lost lines": put("entry/log_lost", 0, 3),
    "state": put("entry/state", 0, b"CANCELLED"),
    "message": put("entry/message", 0, b"all is well"),
    "end": put("entry/end_time", 0, b"2020-01-01T00:00:00+00:00"),
    "writer": put("entry/writer", 0, b'{"host": "x", "pid": 1, "start": "1"}'),
    "simulated": put("entry/instrument/camera/simulated", (), False),
    "serial": put("entry/instrument/camera/model", (), b"Oryx"),
    "place of pixels": scale("entry/data/x", 2),
    "unit": lambda file: file["entry/data/gain"].attrs.modify("units", "e"),
}


@pytest.mark.parametrize("edit", EDITS)
def test_an_edit_is_named_unless_the_digests_are_made_anew(tmp_path, complete, edit):
    path = tmp_path / "run.h5"
    data, digest = complete
    path.write_bytes(data)
    with h5py.File(path, "r+") as file:
        EDITS[edit](file)
    copy_edited(path)
    assert path.read_bytes() != data
    found = check_record(path)
    assert found.failed_checks
    assert "NOT IN ORDER" in found.verdict
    forge(path)
    # Digests made anew put an edited digest right.
    assert path.read_bytes() == data or check_record(path, digest=digest).failed_checks


def test_a_forged_record_is_only_named_by_the_printed_digest(tmp_path, complete):
    """The forger is as good as the tests need: without the digest the record is in order."""
    path = tmp_path / "run.h5"
    data, digest = complete
    path.write_bytes(data)
    assert check_record(path, digest=digest).is_in_order
    with h5py.File(path, "r+") as file:
        EDITS["gain"](file)
    forge(path)
    assert check_record(path).is_in_order
    verdict = check_record(path, digest=digest)
    assert "not the one given" in verdict.reason


def test_frames_of_another_record_do_not_fit(tmp_path, complete):
    """The same plan taken again: frames of one put into the other, with their links."""
    path, other = tmp_path / "run.h5", tmp_path / "other.h5"
    path.write_bytes(complete[0])
    take(other)
    with h5py.File(path, "r+") as file, h5py.File(other, "r") as source:
        for name in ("images", "exposure", "time", "timestamp", "number", "checksum", "gain"):
            file[f"entry/data/{name}"][3] = source[f"entry/data/{name}"][3]
        file["entry/digests/chain"][3] = source["entry/digests/chain"][3]
    assert "digests" in check_record(path).failed_checks


def test_the_digest_is_printed_shown_and_compared(labapp, tmp_path, monkeypatch, complete):
    monkeypatch.setattr("labapp.runs.verifying.verify", check_record)
    path = tmp_path / "run.h5"
    path.write_bytes(complete[0])
    code, printed, _ = labapp("show", path, "--json")
    assert (code, json.loads(printed)["digest"]) == (0, complete[1])
    assert labapp("verify", path, "--digest", complete[1])[0] == 0
    code, printed, _ = labapp("verify", path, "--digest", "0" * 64)
    assert code == 1
    assert "closing" in printed


def test_a_frame_that_was_written_but_not_acknowledged_is_told(tmp_path, interrupted):
    """A killed writer leaves a link one frame ahead of what it has acknowledged."""
    path = tmp_path / "run.h5"
    path.write_bytes(interrupted)
    with h5py.File(path, "r+") as file:
        file["entry/data/stored"][4] = 0
    found = check_record(path)
    assert found.failed_checks == []
    assert "frame 4 is whole" in found.reason
    with h5py.File(path, "r+") as file:
        file["entry/data/stored"][3] = 0
    assert "digests" in check_record(path).failed_checks


def test_an_unfinished_record_says_what_is_not_protected(tmp_path, interrupted):
    path = tmp_path / "run.h5"
    path.write_bytes(interrupted)
    words = [one.detail for one in check_record(path).findings if one.check == "closing"]
    assert words == ["state, message and writer aren't protected before the run's end"]


def test_a_writer_that_is_killed_while_it_closes_leaves_nothing_wrong(
    tmp_path, interrupted, complete
):
    """Time of the end, digest over all, state: the file after the first, and after the second."""
    path = tmp_path / "run.h5"
    path.write_bytes(interrupted)
    with h5py.File(path, "r+") as file:
        file["entry/end_time"][0] = b"2026-01-02T03:04:05.678+00:00"
    assert check_record(path).failed_checks == []
    path.write_bytes(complete[0])
    with h5py.File(path, "r+") as file:
        file["entry/state"][0] = b"RUNNING"
    found = check_record(path)
    assert found.failed_checks == []
    assert f"{complete[1]}, of a run that ended COMPLETE" in next(
        one.detail for one in found.findings if one.check == "closing"
    )
    with h5py.File(path, "r+") as file:
        file["entry/message"][0] = b"changed"
    copy_edited(path)
    assert check_record(path).failed_checks == ["closing"]


KILLS = 8
"""Of so many writes of a run, one is the last; each of them in a sweep."""


@pytest.mark.parametrize("part", [0, *(pytest.param(k, marks=MANY) for k in range(1, KILLS))])
def test_a_writer_that_is_killed_at_any_write_leaves_nothing_wrong(tmp_path, monkeypatch, part):
    """The record as it was after each write: what stands twice is one row apart at most."""
    path, writes, write = tmp_path / "run.h5", [], os.pwrite

    def note(handle: int, data: bytes, offset: int) -> int:
        if path.exists():
            before = os.pread(handle, len(data), offset)
            writes.append((offset, before.ljust(len(data), b"\0")))
        return write(handle, data, offset)

    monkeypatch.setattr(os, "pwrite", note)
    take(path, 5)
    monkeypatch.undo()
    monkeypatch.setattr("labapp.runs.record.writer_process.is_alive", lambda _: False)
    wrong, count = {}, len(writes)
    for number, (offset, before) in reversed(list(enumerate(writes))):
        with path.open("r+b") as file:
            file.seek(offset)
            file.write(before)
        if number % KILLS == part and (failed := check_record(path).failed_checks):
            wrong[number] = failed
    assert (wrong, count > 100) == ({}, True)


def test_a_run_that_goes_on_has_no_time_of_its_end(tmp_path, interrupted):
    path = tmp_path / "run.h5"
    path.write_bytes(interrupted)
    with h5py.File(path, "r+") as file:
        file["entry/end_time"][0] = b"soon"
    assert check_record(path).failed_checks == ["closing"]


def test_the_digests_are_those_that_anybody_can_compute(tmp_path, complete):
    """From the description alone: of image and settings, chained; a hand-made loop."""
    path = tmp_path / "run.h5"
    path.write_bytes(complete[0])
    with h5py.File(path, "r") as file:
        structure = bytes(file["entry/digests/structure"][0])
        before = sha256(b"labapp frames\n" + structure).digest()
        data = file["entry/data"]
        columns = [
            "exposure",
            "wavelength",
            "gain",
            "time",
            "timestamp",
            "number",
            "attempts",
            "checksum",
        ]
        for number, row in enumerate(file["entry/digests/chain"][:8]):
            image = sha256(data["images"][number].tobytes()).digest()
            settings = sha256(b"".join(data[c][number].tobytes() for c in columns)).digest()
            index = number.to_bytes(4, "little")
            before = sha256(before + index + image + settings).digest()
            assert (row["frame"], bytes(row["link"])) == (number, before)


def test_a_record_of_the_older_format_is_read_and_said_to_be_unprotected(tmp_path, complete):
    path = tmp_path / "run.h5"
    path.write_bytes(complete[0])
    with h5py.File(path, "r") as new, h5py.File(tmp_path / "old.h5", "w") as old:
        new.copy("entry", old)
        old.attrs["labapp_format"] = 2
        for name in ("digests", "log_lost", "capabilities", "copy"):
            del old[f"entry/{name}"]
    with Record(tmp_path / "old.h5") as record:
        assert record.state is State.COMPLETE
        assert record.missing_frames() == []
    found = check_record(tmp_path / "old.h5")
    assert found.is_in_order
    assert "aren't protected" in next(f.detail for f in found.findings if f.check == "structure")


def test_a_sign_where_nothing_was_written_is_found(tmp_path, interrupted):
    """Minus zero equals the zero of a frame that was never taken."""
    path = tmp_path / "run.h5"
    for name in ("exposure", "wavelength", "gain", "time"):
        path.write_bytes(interrupted)
        with h5py.File(path, "r+") as file:
            file[f"entry/data/{name}"][7] = -0.0
        assert check_record(path).failed_checks, name
