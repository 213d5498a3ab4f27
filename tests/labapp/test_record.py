"""The record: complete, self-describing, readable while it is written and after a crash."""

from __future__ import annotations

import json
import subprocess
import sys

import h5py
import numpy as np
import pytest

from drivers.interfaces import Frame, Identity
from labapp.acquisition.state import State
from labapp.acquisition.steps import Shot
from labapp.errors import UserError
from labapp.figures.durability import kill_after
from labapp.record import process
from labapp.record.reader import Record
from labapp.record.writer import Contents, RecordWriter, mark


def contents(frames: int = 3) -> Contents:
    return Contents(
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
    return Frame(image, 0.01, 2.6, 1.5 * value, value)


@pytest.fixture
def path(tmp_path):
    return tmp_path / "run.h5"


def test_a_stored_frame_is_seen_by_a_reader_while_the_run_goes_on(path):
    with RecordWriter(path, contents()) as writer:
        writer.set_state(State.RUNNING)
        writer.store(contents().shots[1], frame(1), 550e-9)
        # Another process, as a person's notebook would be.
        code = (
            "import sys; from pathlib import Path; from labapp.record.reader import Record\n"
            "with Record(Path(sys.argv[1])) as r: print(r.state, r.missing(), r.image(1).sum())"
        )
        done = subprocess.run(
            [sys.executable, "-c", code, str(path)], capture_output=True, text=True, check=True
        )
    assert done.stdout.split() == ["RUNNING", "[0,", "2]", str(35 * 34 // 2 + 35)]


def test_values_come_back_as_they_were_stored(path):
    with RecordWriter(path, contents()) as writer:
        for index in range(3):
            writer.store(contents().shots[index], frame(index), 551e-9)
        writer.log(0.5, "a line")
        writer.set_state(State.RUNNING)
    mark(path, State.COMPLETE)
    with Record(path) as record:
        assert record.state is State.COMPLETE
        assert record.missing() == []
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
    RecordWriter(path, contents()).close()
    with h5py.File(path, "r") as file:
        entry = file[file.attrs["default"]]
        data = entry[entry.attrs["default"]]
        assert (entry.attrs["NX_class"], data.attrs["NX_class"]) == ("NXentry", "NXdata")
        images = data[data.attrs["signal"]]
        sizes = tuple(data[name].size for name in data.attrs["axes"])
        assert images.shape == sizes == (3, 5, 7)
        np.testing.assert_allclose(data["x"], np.arange(-3, 4) * 1e-6)
        assert data["x"].attrs["units"] == "m"


def test_a_damaged_frame_counts_as_missing(path):
    with RecordWriter(path, contents()) as writer:
        for index in range(3):
            writer.store(contents().shots[index], frame(index), 550e-9)
    with h5py.File(path, "r+") as file:
        file["entry/data/images"][1, 2, 2] ^= 1
    with Record(path) as record:
        assert record.missing() == [1]


def test_a_writer_that_is_gone_without_a_word_reads_as_interrupted(path):
    with RecordWriter(path, contents()) as writer:
        writer.set_state(State.RUNNING)
    with h5py.File(path, "r+") as file:
        gone = json.loads(file["entry/writer"][()])
        del file["entry/writer"]
        # The number of a living process that isn't the one which wrote.
        file["entry/writer"] = json.dumps(gone | {"start": "1"})
    with Record(path) as record:
        assert record.state is State.INTERRUPTED


def test_this_process_is_alive_and_a_finished_one_is_not():
    assert process.is_alive(process.me())
    code = "from labapp.record import process; print(process.me())"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert not process.is_alive(done.stdout)


def test_no_acknowledged_frame_is_lost_by_kill_minus_nine(path):
    acknowledged = kill_after(path, 9)
    assert len(acknowledged) >= 9
    with Record(path) as record:
        assert record.state is State.INTERRUPTED
        assert not set(acknowledged) & set(record.missing())


def test_the_log_never_outgrows_its_room(path):
    with RecordWriter(path, contents()) as writer:
        for number in range(200):
            writer.log(number, f"line {number}")
    with Record(path) as record:
        assert record.log[-1] == (199.0, "line 199")


def test_a_draft_is_not_left_when_the_disk_refuses(path, monkeypatch):
    def full(self):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(RecordWriter, "_prepare", full)
    with pytest.raises(UserError, match="No space left"):
        RecordWriter(path, contents())
    assert list(path.parent.iterdir()) == []


def test_an_hdf5_file_of_others_is_refused(path):
    with h5py.File(path, "w") as file:
        file["data"] = 1
    with pytest.raises(UserError, match="is not a record"):
        Record(path)
