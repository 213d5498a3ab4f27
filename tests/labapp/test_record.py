"""The record: complete, self-describing, readable while it is written and after a crash."""

from __future__ import annotations

import errno
import json
import os
import sys
import zlib
from dataclasses import replace

import forked
import h5py
import numpy as np
import pytest

from drivers.interfaces import Frame, Identity
from labapp.common.errors import UserError
from labapp.runs.record import creation, layout, writer_process
from labapp.runs.record.creation import RecordContents, create_record
from labapp.runs.record.reader import Record
from labapp.runs.record.writer import CorruptFrame, RecordWriter
from labapp.runs.shots import Shot
from labapp.runs.state import State


def contents(frames: int = 3) -> RecordContents:
    return RecordContents(
        title="Test",
        seed=1,
        plan={},
        bench={},
        scene=None,
        effect_plan=None,
        identities={"camera": Identity("test camera", "42", simulated=False)},
        targets=("dark", "star"),
        patterns={"neutral": np.zeros((4, 6), np.uint8), "ring": np.full((4, 6), 7, np.uint8)},
        shots=[Shot(i, i, 0, "star", "ring", 550e-9, 0.01) for i in range(frames)],
        frame_shape=(5, 7),
        pixel_pitch=1e-6,
    )


def frame(value: int) -> Frame:
    image = np.arange(35, dtype=np.uint16).reshape(5, 7) + np.uint16(value)
    return Frame(image, 0.01, 2.6, 100.0 + value, value, zlib.crc32(image.tobytes()))


def new(path, frames: int = 3) -> RecordWriter:
    return RecordWriter(path, create_record(path, contents(frames)))


def put(writer: RecordWriter, index: int, wavelength: float = 550e-9) -> None:
    writer.store(contents().shots[index], frame(index), wavelength, start_time=1.5 * index)


@pytest.fixture
def path(tmp_path):
    return tmp_path / "run.h5"


def test_a_stored_frame_is_seen_by_a_reader_while_the_run_goes_on(path):
    with new(path) as writer:
        writer.set_state(State.RUNNING)
        put(writer, 1)
        # Another process, as a person's notebook would be.
        code = (
            "import sys; from pathlib import Path; from labapp.runs.record.reader import Record\n"
            "with Record(Path(sys.argv[1])) as r:\n"
            "    print(r.state, r.missing_frames(), r.image(1).sum())"
        )
        done = forked.run(
            [sys.executable, "-c", code, str(path)], capture_output=True, text=True, check=True
        )
    assert done.stdout.split() == ["RUNNING", "[0,", "2]", str(35 * 34 // 2 + 35)]


def test_values_come_back_as_they_were_stored(path):
    with new(path) as writer:
        for index in range(3):
            put(writer, index, 551e-9)
        writer.log(0.5, "a line")
        writer.set_state(State.RUNNING)
        writer.set_state(State.COMPLETE, "done")
    with Record(path) as record:
        assert record.state is State.COMPLETE
        assert (record.message, record.missing_frames()) == ("done", [])
        np.testing.assert_array_equal(record.image(2), frame(2).image)
        np.testing.assert_array_equal(record.column("time"), [0, 1.5, 3.0])
        np.testing.assert_array_equal(record.column("wavelength"), 551e-9)
        assert record.log == [(0.5, "a line")]
        assert record.devices["camera"] == {
            "model": "test camera",
            "serial": "42",
            "simulated": False,
        }
        assert record.select(target="star", pattern="ring") == [0, 1, 2]
        assert record.select(target="dark") == record.select(pattern="none") == []
        np.testing.assert_array_equal(record.pattern("ring"), 7)


def test_any_program_finds_the_pictures_and_their_axes(path):
    """NeXus: the root names an entry, the entry its data, the data its signal and axes."""
    new(path).close()
    with h5py.File(path, "r") as file:
        entry = file[file.attrs["default"]]
        data = entry[entry.attrs["default"]]
        assert (entry.attrs["NX_class"], data.attrs["NX_class"]) == ("NXentry", "NXdata")
        images = data[data.attrs["signal"]]
        sizes = tuple(data[name].size for name in data.attrs["axes"])
        assert images.shape == sizes == (3, 5, 7)
        np.testing.assert_allclose(data["x"], np.arange(-3, 4) * 1e-6)
        assert data["x"].attrs["units"] == "m"
        assert [axis.label for axis in images.dims] == ["frame", "y", "x"]


def test_a_damaged_frame_counts_as_missing(path):
    with new(path) as writer:
        for index in range(3):
            put(writer, index)
    with h5py.File(path, "r+") as file:
        file["entry/data/images"][1, 2, 2] ^= 1
    with Record(path) as record:
        assert record.missing_frames() == [1]


def test_a_writer_that_is_gone_without_a_word_reads_as_interrupted(path):
    with new(path) as writer:
        writer.set_state(State.RUNNING)
    with h5py.File(path, "r+") as file:
        gone = json.loads(file["entry/writer"][0])
        # The number of a living process that isn't the one which wrote.
        file["entry/writer"][0] = json.dumps(gone | {"start": "1"}).encode()
    with Record(path) as record:
        assert record.state is State.INTERRUPTED


def test_this_process_is_alive_and_a_finished_one_is_not():
    assert writer_process.is_alive(writer_process.describe_this_process())
    code = "from labapp.runs.record import writer_process as w; print(w.describe_this_process())"
    done = forked.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert not writer_process.is_alive(done.stdout)


def test_a_full_log_keeps_its_lines_and_counts_those_that_are_lost(path):
    room = layout.log_capacity(3)
    with new(path) as writer:
        for number in range(room + 50):
            writer.log(number, f"line {number}")
        writer.set_state(State.FAILED)
    with Record(path) as record:
        assert len(record.log) == room
        assert record.log[-1] == (room - 1.0, f"line {room - 1}")
        assert record.lost_log_lines == 50


def test_the_log_goes_on_when_the_record_is_opened_again(path):
    with new(path) as writer:
        writer.log(1.0, "before")
    with RecordWriter(path) as writer:
        writer.log(0.5, "after")
    with Record(path) as record:
        assert record.log == [(1.0, "before"), (0.5, "after")]


def test_nothing_is_left_when_the_disk_refuses_the_record(path, monkeypatch):
    def full(*args):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(creation, "_fill", full)
    with pytest.raises(UserError, match="No space left"):
        create_record(path, contents())
    assert list(path.parent.iterdir()) == []


def test_a_record_that_exists_is_not_replaced_unless_forced(path):
    new(path).close()
    with pytest.raises(UserError, match="exists already"):
        create_record(path, contents())
    os.close(create_record(path, contents(frames=2), force=True))
    with Record(path) as record:
        assert record.frame_count == 2


def test_a_record_has_one_writer(path):
    with (
        new(path),
        pytest.raises(UserError, match=rf"run.h5: is being written by process {os.getpid()} "),
    ):
        RecordWriter(path)
    RecordWriter(path).close()


def test_a_reader_does_not_take_the_writers_lock_away(path):
    with new(path):
        Record(path).close()
        with pytest.raises(UserError, match="being written"):
            RecordWriter(path)


def test_every_dataset_has_its_place_before_the_first_frame(path):
    """What HDF5 has allocated it need not touch again, whatever happens to the writer."""
    new(path).close()
    with h5py.File(path, "r") as file:
        data = file["entry/data"]
        for name in ("images", *layout.MEASURED):
            assert data[name].id.get_offset() is not None, name
        size, end = path.stat().st_size, data["images"].id.get_offset() + data["images"].nbytes
    assert size >= end


def test_writing_leaves_all_but_the_values_as_it_was(path):
    """Byte by byte: outside the datasets' own places the file never changes after making."""
    new(path).close()
    before = np.frombuffer(path.read_bytes(), np.uint8)
    with h5py.File(path, "r") as file:
        places = [file[name] for name in layout.CHANGING]
        ranges = [(d.id.get_offset(), d.nbytes) for d in places]
    with RecordWriter(path) as writer:
        for index in range(3):
            put(writer, index)
        writer.log(1.0, "line")
        writer.set_state(State.FAILED, "why")
    after = np.frombuffer(path.read_bytes(), np.uint8)
    assert before.shape == after.shape
    changed = before != after
    for offset, size in ranges:
        changed[offset : offset + size] = False
    assert not changed.any()


def test_a_corrupt_picture_is_not_stored(path):
    torn = replace(frame(1), image=np.zeros((5, 7), np.uint16))
    with new(path) as writer:
        with pytest.raises(CorruptFrame, match="checksum"):
            writer.store(contents().shots[1], torn, 550e-9, start_time=0.0)
        short = replace(frame(1), image=np.zeros((4, 7), np.uint16))
        with pytest.raises(CorruptFrame, match=r"\(4, 7\) pixels"):
            writer.store(contents().shots[1], short, 550e-9, start_time=0.0)
    with Record(path) as record:
        assert record.missing_frames() == [0, 1, 2]


@pytest.mark.parametrize("failing_write", range(9))
def test_a_frame_that_the_disk_refused_does_not_count(path, monkeypatch, failing_write):
    """Whichever of its writes fails, the frame isn't there until it is stored again."""
    calls = iter(range(1000))
    pwrite = os.pwrite

    def refuse(handle, data, offset):
        if next(calls) == failing_write:
            raise OSError(errno.ENOSPC, "No space left on device")
        return pwrite(handle, data, offset)

    with new(path) as writer:
        put(writer, 0)
        monkeypatch.setattr(os, "pwrite", refuse)
        with pytest.raises(OSError, match="No space"):
            put(writer, 1)
        monkeypatch.undo()
        with Record(path) as record:
            assert record.missing_frames() == [1, 2]
        writer.reopen()
        put(writer, 1)
        assert writer.is_stored_intact(1)
    with Record(path) as record:
        assert record.missing_frames() == [2]
        np.testing.assert_array_equal(record.image(1), frame(1).image)


def test_short_writes_are_completed(path, monkeypatch):
    pwrite = os.pwrite
    monkeypatch.setattr(os, "pwrite", lambda handle, data, at: pwrite(handle, data[:3], at))
    with new(path) as writer:
        put(writer, 2)
    with Record(path) as record:
        assert record.missing_frames() == [0, 1]


def test_reading_back_finds_what_is_not_as_it_was(path):
    with new(path) as writer:
        put(writer, 1)
        with h5py.File(path, "r+") as file:
            file["entry/data/images"][1, 0, 0] ^= 1
        assert not writer.is_stored_intact(1)


def test_a_video_comes_back_with_its_frames(path):
    video = np.arange(3 * 24, dtype=np.uint8).reshape(3, 4, 6)
    patterns = {"still": video[2], "video": video, "other": video[1]}
    shots = [Shot(0, 0, 0, "star", "video", 550e-9, 0.01)]
    os.close(
        create_record(path, replace(contents(), patterns=patterns, shots=shots, video_frame=1 / 60))
    )
    with Record(path) as record:
        for name, image in patterns.items():
            np.testing.assert_array_equal(record.pattern(name), image)


def test_an_hdf5_file_of_others_is_refused(path):
    with h5py.File(path, "w") as file:
        file["data"] = 1
    with pytest.raises(UserError, match="is not a record"):
        Record(path)


def test_a_swmr_reader_sees_new_frames_when_it_refreshes(path):
    """As any SWMR reader does: open once, refresh, read on."""
    with new(path) as writer:
        put(writer, 0)
        with h5py.File(path, "r", libver="latest", swmr=True) as file:
            stored, images = file["entry/data/stored"], file["entry/data/images"]
            assert stored[:].tolist() == [1, 0, 0]
            put(writer, 2)
            stored.refresh()
            images.refresh()
            assert stored[:].tolist() == [1, 0, 1]
            np.testing.assert_array_equal(images[2], frame(2).image)
