"""Training in processes that are killed, signalled, or two: all end in the same weights."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import forked
import pytest
import tiny_training
import torch
from tiny_training import PICTURES, PictureTask, same

from labapp.common.errors import UserError
from labapp.training.loop import run_training
from labapp.training.processes import Processes, join_processes

ROOT = Path(__file__).parents[2]
ENVIRONMENT = {
    **os.environ,
    "PYTHONPATH": os.pathsep.join([str(ROOT), str(ROOT / "tests" / "labapp")]),
}


def train_in_processes(folder, steps, times):
    command = [sys.executable, "-m", "tiny_training", str(folder), str(steps), str(times)]
    done = forked.run(command, env=ENVIRONMENT, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


@pytest.fixture(scope="module")
def processes_folder(tmp_path_factory):
    return tmp_path_factory.mktemp("processes")


@pytest.fixture(scope="module")
def report(processes_folder):
    """What happened to processes that were killed, signalled or two."""
    return train_in_processes(processes_folder, 60, 3)


def check_killed(folder, killed, steps):
    begun = 0
    for first, last, _ in killed:
        # The state is written before a step begins, so that this step is lost at most.
        assert begun <= first <= begun + 1
        begun = last
    assert [code for *_, code in killed] == [-signal.SIGKILL] * (len(killed) - 1) + [0]
    result = torch.load(folder / "result0", weights_only=True)
    straight = run_training(PictureTask(), tiny_training.schedule(steps))
    assert same(result["weights"], straight.weights)
    assert tuple(result["history"]) == straight.history
    assert {one.name for one in folder.iterdir() if one.is_file()} == {"result0", "state"}


def test_killed_training_ends_in_the_same_weights(processes_folder, report):
    check_killed(processes_folder, report["killed"], 60)


@pytest.mark.sweep
def test_training_killed_at_many_moments_ends_in_the_same_weights(tmp_path):
    check_killed(tmp_path, train_in_processes(tmp_path, 200, 20)["killed"], 200)


@pytest.mark.parametrize(("place", "name"), [*enumerate(("SIGTERM", "SIGINT", "SIGHUP"))])
def test_signals_leave_the_state(processes_folder, report, place, name):
    last, code = report["signals"][place]
    assert code == 130
    assert torch.load(processes_folder / name / "state")["state"]["step"] == last + 1


def test_two_processes_share_the_work_and_train_the_same(processes_folder, report):
    assert report["two"] == [0, 0]
    check_two(processes_folder / "two")


@pytest.mark.sweep
def test_torchrun_does_the_same(tmp_path):
    command = [sys.executable, "-m", "torch.distributed.run", "--standalone", "--nproc-per-node=2"]
    done = subprocess.run(
        [*command, "-m", "tiny_training", "train", str(tmp_path), "40"],
        env=ENVIRONMENT, cwd=ROOT, capture_output=True, text=True, timeout=90,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("40 steps") == 1
    check_two(tmp_path)


def check_two(folder):
    task = PictureTask()
    alone = run_training(task, PICTURES)
    assert alone.work == (240,)
    results = [torch.load(folder / f"result{rank}", weights_only=True) for rank in (0, 1)]
    assert same(results[0]["weights"], results[1]["weights"])
    for result in results:
        assert result["work"] == (120, 120)
        assert result["gathered"].tolist() == [0, 1, 2, 3, 4]
        assert result["wishes"] == (True, False)
        assert float(result["memory"]) == pytest.approx(float(task.memory), rel=1e-4)
        for name, value in alone.weights.items():
            torch.testing.assert_close(result["weights"][name], value, rtol=0, atol=1e-5)


def test_each_process_has_its_own_samples():
    shares = [list(Processes(rank, 3).own_samples(8)) for rank in range(3)]
    assert shares == [[0, 3, 6], [1, 4, 7], [2, 5]]
    with pytest.raises(ValueError, match="samples is 6 for 7 processes"):
        run_training(PictureTask(), PICTURES, processes=Processes(0, 7))


@pytest.mark.parametrize("device", ["tpu", "cuda"])
def test_a_device_that_is_not_there(device):
    if device == "cuda" and torch.cuda.is_available():
        pytest.skip("there is a GPU")
    with (
        pytest.raises(UserError, match=rf"--device {device}: .*[Cc]hoose .*cpu"),
        join_processes(device),
    ):
        pass
