"""The state of a training in its file: when it is written, and which states are refused."""

from __future__ import annotations

import errno
import time
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from tiny_training import LINE, PICTURES, LineTask, PictureTask, same

from labapp.common.errors import UserError
from labapp.files import state_file
from labapp.files.state_file import StateFile
from labapp.training.command import train_for_command
from labapp.training.loop import run_training
from labapp.training.processes import Processes
from optics.progress import Cancelled, Progress


def test_the_state_is_written_at_validations_and_after_some_seconds(tmp_path, monkeypatch):
    now = [100.0]
    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    written = []
    write = StateFile.write

    def note(kept, settings, state):
        written.append(state["step"])
        write(kept, settings, state)

    monkeypatch.setattr(StateFile, "write", note)
    kept = StateFile(tmp_path / "state", "training")
    run_training(LineTask(), LINE, kept)
    assert written == [12, 24, 30]
    kept.delete()
    written.clear()
    seconds = state_file.WRITE_INTERVAL / 8.5

    def wait(_, message):
        now[0] += seconds

    run_training(LineTask(), LINE, kept, progress=Progress(wait))
    assert written == [9, 12, 21, 24, 30]


def keep_some(path, schedule=PICTURES):
    """Train ten steps and cancel."""
    progress = Progress()

    def stop(share, message):
        if message.startswith("step 9/"):
            progress.cancel()

    progress._listener = stop
    with pytest.raises(Cancelled):
        run_training(PictureTask(), schedule, StateFile(path, "training"), progress=progress)


def test_a_full_disk_leaves_the_state_before(tmp_path, monkeypatch):
    path = tmp_path / "state"
    keep_some(path)
    before = path.read_bytes()

    def fill(draft, data):
        with draft.open("wb") as file:
            file.write(data[:1000])
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as change:
        change.setattr(Path, "write_bytes", fill)
        with pytest.raises(UserError, match=r"state: .*No space left on device.* repeat the comma"):
            run_training(PictureTask(), PICTURES, StateFile(path, "training"))
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]
    result = run_training(PictureTask(), PICTURES, StateFile(path, "training"))
    assert same(result.weights, run_training(PictureTask(), PICTURES).weights)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"first_rate": 0.02}, r"training with first_rate 0.01 instead of 0.02\. Repeat"),
        ({"steps": 41, "seed": 4}, r"with seed 3 instead of 4, steps 40 instead of 41\."),
    ],
)
def test_a_state_of_another_schedule_is_refused(tmp_path, change, said):
    keep_some(tmp_path / "state")
    kept = StateFile(tmp_path / "state", "training")
    with pytest.raises(UserError, match=said):
        run_training(PictureTask(), replace(PICTURES, **change), kept)


def test_a_state_of_another_task_is_refused(tmp_path):
    keep_some(tmp_path / "state")
    kept = StateFile(tmp_path / "state", "training")
    with pytest.raises(UserError, match=r"samples 6 instead of 8.*or delete the file"):
        run_training(PictureTask(samples=8), PICTURES, kept)
    with pytest.raises(UserError, match="samples 6 instead of None, trained pictures instead of l"):
        run_training(LineTask(), PICTURES, kept)


@pytest.mark.parametrize("part", [0, 10, 0.3, 0.999, "text", "other"])
def test_a_damaged_state_is_refused(tmp_path, part):
    path = tmp_path / "state"
    keep_some(path)
    if part == "text":
        path.write_bytes(b"no state")
    elif part == "other":
        stored = torch.load(path)
        del stored["state"]["module"]["0.weight"]
        torch.save(stored, path)
    else:
        data = path.read_bytes()
        path.write_bytes(data[: int(part * len(data)) if part < 1 else part])
    with pytest.raises(UserError, match=r"state: is damaged \(.*Delete it to start the training"):
        run_training(PictureTask(), PICTURES, StateFile(path, "training"))


def test_settings_that_can_not_be_read_again_are_refused(tmp_path):
    task = LineTask()
    task.settings = {"pictures": tmp_path}
    with pytest.raises(ValueError, match="give numbers, strings"):
        run_training(task, LINE, StateFile(tmp_path / "state", "training"))
    task.settings = {"seed": 17}
    with pytest.raises(ValueError, match="seed is 17 in the task's settings and 3 in the schedule"):
        run_training(task, LINE)


def test_the_steps_of_some_minutes_are_kept(tmp_path, monkeypatch, capsys):
    path = tmp_path / "state"
    keep_some(path)
    monkeypatch.setattr("labapp.training.command.count_steps", lambda *_: 77)
    result = train_for_command(PictureTask(), PICTURES, path, Processes(), minutes=5.0)
    assert result.steps == 40
    assert "40 steps, going on" in capsys.readouterr().out
    path.unlink()
    result = train_for_command(PictureTask(), PICTURES, path, Processes(), minutes=5.0)
    assert result.steps == 77
    assert StateFile(path, "training").read_steps() == 77
