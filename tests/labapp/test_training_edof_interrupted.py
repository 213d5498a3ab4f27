"""`labapp train edof` ends in the same however it is interrupted, and in several processes."""

from __future__ import annotations

import errno
import json
import os
import signal
import sys
from contextlib import contextmanager
from pathlib import Path

import forked
import h5py
import pytest
import tiny_edof
import torch
from tiny_edof import check_same, train, write_files
from tiny_training import same

import labapp.training.edof.command as command
from labapp.common.errors import UserError
from labapp.edof.trained_pattern import read_trained_pattern
from labapp.files import state_file
from labapp.training.edof.decoder_task import DecoderTask
from labapp.training.edof.joint_task import JointTask
from labapp.training.processes import Processes
from optics.progress import Cancelled

pytestmark = pytest.mark.usefixtures("white_sheets")

ROOT = Path(__file__).parents[2]
ENVIRONMENT = {
    **os.environ,
    "PYTHONPATH": os.pathsep.join([str(ROOT), str(ROOT / "tests"), str(ROOT / "tests/labapp")]),
}


@pytest.fixture(scope="module")
def straight(tmp_path_factory):
    """A training of four steps of the decoder and four joint ones, and its folder."""
    folder = tmp_path_factory.mktemp("straight")
    write_files(folder)
    return train(folder), folder


def interrupt(folder, monkeypatch, kind, step, steps=8) -> None:
    """Send SIGTERM to a training in a step of the stage of this kind of task."""
    losses = kind.losses

    def end(task, number, samples):
        if number == step:
            signal.raise_signal(signal.SIGTERM)
        return losses(task, number, samples)

    with monkeypatch.context() as change:
        change.setattr(kind, "losses", end)
        with pytest.raises(Cancelled):
            train(folder, steps)


# The same, however it is interrupted.


def test_the_same_seed_gives_the_same_and_another_one_does_not(straight, tmp_path):
    write_files(tmp_path)
    check_same(train(tmp_path), straight[0])
    write_files(tmp_path, {"": {"seed": 2}})
    assert not same(train(tmp_path).network.state_dict(), straight[0].network.state_dict())


@pytest.mark.parametrize(
    ("kind", "step", "left"),
    [
        (DecoderTask, 1, {"decoder"}),
        (DecoderTask, 3, {"decoder"}),
        (JointTask, 0, {"decoder", "joint"}),
        (JointTask, 2, {"decoder", "joint"}),
    ],
)
def test_a_training_goes_on_in_both_stages_bit_for_bit(
    tmp_path, monkeypatch, capsys, straight, kind, step, left
):
    write_files(tmp_path)
    interrupt(tmp_path, monkeypatch, kind, step)
    assert {one.suffix for one in tmp_path.glob("a.*")} == {f".{name}-state" for name in left}
    capsys.readouterr()
    result = train(tmp_path)
    assert "going on from the state" in capsys.readouterr().out
    check_same(result, straight[0])
    assert result.account["history"] == straight[0].account["history"]
    assert result.account["joint_validation"] == straight[0].account["joint_validation"]
    assert not list(tmp_path.glob("*-state"))


def test_a_design_that_is_interrupted_goes_on(tmp_path, monkeypatch):
    changes = {"pattern": {"design_steps": 3}, "joint": {"share": 0.0}}
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        write_files(tmp_path / name, changes)
    whole = train(tmp_path / "a", 2)
    interrupt(tmp_path / "b", monkeypatch, DecoderTask, 0, 2)
    assert (tmp_path / "b" / "a.design-state").exists()
    check_same(train(tmp_path / "b", 2), whole)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"training": {"first_rate": 0.002}}, r"config\.training\.first_rate 0\.001 instead of 0"),
        ({"joint": {"parts": 4}}, r"config\.joint\.parts 3 instead of 4\. Repeat"),
        ({"": {"near_dioptre": 0.8}}, r"with config\.near_dioptre 0\.9 instead of 0\.8, "),
        (
            {"pattern": {"start": "sweep"}},
            r"pattern\.start rings instead of sweep, start checksum",
        ),
    ],
)
def test_a_state_of_another_configuration_is_refused(tmp_path, monkeypatch, changes, said):
    write_files(tmp_path)
    interrupt(tmp_path, monkeypatch, DecoderTask, 1)
    write_files(tmp_path, changes)
    with pytest.raises(UserError, match=said):
        train(tmp_path)


def test_a_state_of_another_bench_start_or_length_is_refused(straight, tmp_path, monkeypatch):
    write_files(tmp_path, {"pattern": {"start": "start.h5"}})
    start = tmp_path / "start.h5"
    start.write_bytes((straight[1] / "a.h5").read_bytes())
    interrupt(tmp_path, monkeypatch, DecoderTask, 1)
    with pytest.raises(UserError, match="joint_steps 4 instead of 5, steps 4 instead of 5"):
        train(tmp_path, 10)
    with h5py.File(start, "r+") as file:
        file["entry/pattern/grey"][0, 5, 5] ^= 9
    with pytest.raises(UserError, match=r"with start checksum \w+ instead of \w+\. Repeat"):
        train(tmp_path)
    start.write_bytes((straight[1] / "a.h5").read_bytes())
    bench = tmp_path / "bench" / "bench.toml"
    bench.write_text(bench.read_text().replace("= 2.0", "= 2.1"))
    with pytest.raises(UserError, match=r"with bench checksum \w+ instead of \w+\. Repeat"):
        train(tmp_path)


def test_the_steps_of_some_minutes_are_printed_and_kept(tmp_path, monkeypatch, capsys):
    write_files(tmp_path)
    minutes, losses = [], DecoderTask.losses

    def count(task, schedule, given, processes):
        minutes.append(given)
        return 5 if isinstance(task, DecoderTask) else 3

    def end(task, number, samples):
        assert "5 steps of the decoder, 3 joint ones" in capsys.readouterr().out
        signal.raise_signal(signal.SIGTERM)
        return losses(task, number, samples)

    with monkeypatch.context() as change:
        change.setattr(command, "count_steps", count)
        change.setattr(DecoderTask, "losses", end)
        with pytest.raises(Cancelled):
            train(tmp_path, None, 4.0)
    assert minutes == [2.0, 2.0]
    result = train(tmp_path, None, 4.0)
    assert minutes == [2.0, 2.0]
    assert (result.account["decoder_steps"], result.account["joint_steps"]) == (5, 3)


def test_minutes_become_steps_of_both_stages(tmp_path):
    write_files(tmp_path)
    result = train(tmp_path, None, 0.01)
    assert result.account["decoder_steps"] >= 1
    assert result.account["joint_steps"] >= 1


def test_a_full_disk_leaves_the_state_before(tmp_path, monkeypatch, straight):
    write_files(tmp_path)
    interrupt(tmp_path, monkeypatch, DecoderTask, 0)
    before = (tmp_path / "a.decoder-state").read_bytes()

    def fill(draft, data):
        with draft.open("wb") as file:
            file.write(data[:1000])
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as change:
        change.setattr(Path, "write_bytes", fill)
        with pytest.raises(UserError, match=r"decoder-state: .*No space left.*repeat the command"):
            train(tmp_path)
    assert (tmp_path / "a.decoder-state").read_bytes() == before
    assert not (tmp_path / "a.h5").exists()
    check_same(train(tmp_path), straight[0])


def test_a_damaged_state_is_refused(tmp_path, monkeypatch):
    write_files(tmp_path)
    interrupt(tmp_path, monkeypatch, JointTask, 0)
    for stage in ("joint", "decoder"):
        state = tmp_path / f"a.{stage}-state"
        state.write_bytes(state.read_bytes()[:500])
        with pytest.raises(UserError, match=rf"a\.{stage}-state: is damaged .*Delete it"):
            train(tmp_path)


# Processes.


def run(*arguments) -> str:
    done = forked.run(
        [sys.executable, "-m", "tiny_edof", *map(str, arguments)],
        env=ENVIRONMENT, capture_output=True, text=True, timeout=600,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


def test_two_processes_have_the_gradients_of_one(tmp_path):
    assert run("gradients", tmp_path) == [0, 0]
    alone = tiny_edof.step_gradients(Processes())
    both = [torch.load(tmp_path / f"gradients{rank}") for rank in (0, 1)]
    for stage, wanted in alone.items():
        assert len(both[0][stage]) == len(wanted)
        for one, other, right in zip(both[0][stage], both[1][stage], wanted, strict=True):
            assert torch.equal(one, other)
            size = float(right.abs().max())
            assert size > 0
            torch.testing.assert_close(one, right, rtol=0, atol=1e-5 * max(size, 0.01))


@pytest.mark.sweep
def test_two_processes_train_as_one_does(tmp_path):
    write_files(tmp_path)
    assert run("two", tmp_path) == [0, 0]
    result = torch.load(tmp_path / "result")
    assert read_trained_pattern(tmp_path / "a.h5").account["processes"] == 2
    whole = train(tmp_path)
    for name, weight in whole.network.state_dict().items():
        torch.testing.assert_close(result["weights"][name], weight, rtol=0, atol=1e-4)


@pytest.mark.sweep
def test_a_training_that_is_killed_at_many_moments_ends_in_the_same(tmp_path, monkeypatch):
    write_files(tmp_path)
    seen = run("kill", tmp_path, 20)
    assert seen[-1] == "0"
    assert sum(one.startswith("-9") for one in seen) >= 10
    assert any(".decoder-state" in one and ".joint-state" not in one for one in seen)
    assert any(".joint-state" in one for one in seen)
    result = torch.load(tmp_path / "result")
    monkeypatch.setattr(state_file, "WRITE_INTERVAL", 1e9)
    whole = train(tmp_path, 40)
    assert same(result["weights"], whole.network.state_dict())
    assert torch.equal(result["phase"], whole.phase)


def test_more_processes_than_scenes_are_refused(tmp_path, monkeypatch):
    write_files(tmp_path)

    @contextmanager
    def join(device):
        yield Processes(0, 4)

    monkeypatch.setattr(command, "join_processes", join)
    with pytest.raises(UserError, match=r"samples = 3 in \[joint\]: there are 4 processes"):
        train(tmp_path)
