"""`labapp train edof`: what it writes, and when the joint stage is kept."""

from __future__ import annotations

import json

import cv2
import h5py
import numpy as np
import pytest
import torch
from tiny_edof import check_same, train, write_files
from tiny_training import same

import labapp.training.edof.command as command
from labapp.common.errors import UserError
from labapp.edof.trained_pattern import read_trained_pattern
from labapp.files.design_file import read_design
from labapp.training.edof.joint_task import JointTask

pytestmark = pytest.mark.usefixtures("white_sheets")


@pytest.fixture(scope="module")
def straight(tmp_path_factory):
    """A training of four steps of the decoder and four joint ones, and its folder."""
    folder = tmp_path_factory.mktemp("straight")
    write_files(folder)
    return train(folder), folder


@pytest.fixture
def accept_always(monkeypatch):
    """Keep joint trainings, however little they help."""
    scores = iter(range(1000))
    monkeypatch.setattr(JointTask, "validate", lambda task: float(next(scores)))


# What is written.


def test_pattern_and_decoder_are_written_and_read(straight):
    result, folder = straight
    names = {one.name for one in folder.iterdir()}
    assert names == {"bench", "train.toml", "a.h5", "a.png", "a_training.png"}
    read = read_trained_pattern(folder / "a.h5")
    assert read.network.settings == result.network.settings
    assert (read.grey == cv2.imread(str(folder / "a.png"), cv2.IMREAD_UNCHANGED)).all()
    step = 2 * np.pi / 100
    error = torch.remainder(read.phase.double() - result.phase + np.pi, 2 * np.pi) - np.pi
    assert error.abs().max() < step
    for name, weight in result.network.state_dict().items():
        wanted = weight.numpy().astype(np.float16).astype(np.float32)
        assert np.array_equal(read.network.state_dict()[name].numpy(), wanted)
    capture, filtered = torch.rand(2, 37, 40, generator=torch.Generator().manual_seed(0))
    found = read.network.restore(capture, 0.01, filtered)
    wanted = result.network.restore(capture, 0.01, filtered)
    assert 0 < (found - wanted).abs().max() < 2e-3
    assert read.depth_range == (0.3, 0.9)
    assert read.account["decoder_steps"] == read.account["joint_steps"] == 4
    assert read.account["processes"] == 1
    assert read.account["joint_accepted"] == (
        read.account["joint_validation"][1] > read.account["joint_validation"][0]
    )
    assert read_design(folder / "a.h5").quality["validation"] == result.validation


@pytest.mark.parametrize("share", [0.0, 0.5])
def test_the_result_is_the_mean_of_the_weights(tmp_path, monkeypatch, accept_always, share):
    stages, run_stage = [], command.train_for_command

    def note(*given, **options):
        stages.append(run_stage(*given, **options))
        return stages[-1]

    monkeypatch.setattr(command, "train_for_command", note)
    write_files(tmp_path, {"joint": {"share": share}})
    result = train(tmp_path)
    weights = stages[-1].weights
    if share:
        assert torch.equal(result.phase, result.problem.parametrisation.phase(weights["pattern"]))
        weights = {
            name.removeprefix("network."): one for name, one in weights.items() if name != "pattern"
        }
    assert same(result.network.state_dict(), weights)
    assert len(stages) == (2 if share else 1)


@pytest.mark.parametrize("damage", ["missing", "shape", "decoder", "spectrum"])
def test_a_damaged_decoder_is_refused(straight, tmp_path, damage):
    path = tmp_path / "b.h5"
    path.write_bytes((straight[1] / "a.h5").read_bytes())
    with h5py.File(path, "r+") as file:
        table, name = file["entry/decoder"], "refining.head.bias"
        if damage in ("missing", "shape"):
            del table["weights"][name]
        if damage == "shape":
            table["weights"][name] = np.zeros(7, np.float16)
        if damage in ("decoder", "spectrum"):
            stored = json.loads(table["settings"][()])
            del stored[damage]
            del table["settings"]
            table["settings"] = np.bytes_(json.dumps(stored).encode())
    with pytest.raises(UserError, match=r"b\.h5: its decoder is damaged: .*Train it again"):
        read_trained_pattern(path)


def test_a_trained_pattern_is_the_start_of_another_training(straight, tmp_path):
    write_files(tmp_path, {"pattern": {"start": "start.h5"}, "joint": {"share": 0.0}})
    (tmp_path / "start.h5").write_bytes((straight[1] / "a.h5").read_bytes())
    train(tmp_path, 1)
    before, after = (read_design(one / "a.h5").grey for one in (straight[1], tmp_path))
    # A quarter of the pattern is the mean of four, so that grey levels may differ by rounding.
    assert np.abs(before.astype(int) - after.astype(int)).max() <= 1


def test_the_pattern_is_designed_before_the_decoder_is_trained(tmp_path, capsys):
    write_files(tmp_path, {"pattern": {"design_steps": 2}, "joint": {"share": 0.0}})
    result = train(tmp_path, 1)
    assert "2 steps of the pattern" in capsys.readouterr().out
    designed = result.phase
    write_files(tmp_path, {"joint": {"share": 0.0}})
    assert not torch.equal(train(tmp_path, 1).phase, designed)


# The joint stage.


def test_a_joint_stage_that_is_no_better_is_dropped(tmp_path, monkeypatch):
    """Then pattern and weights are those of the decoder alone, bit for bit."""
    write_files(tmp_path, {"joint": {"share": 0.0}})
    alone = train(tmp_path, 4)
    write_files(tmp_path)
    # Before, in the middle, and at the end.
    scores = iter([30.0, 31.0, 30.0])
    monkeypatch.setattr(JointTask, "validate", lambda task: next(scores))
    dropped = train(tmp_path)
    assert dropped.account["joint_validation"] == [30.0, 30.0]
    assert dropped.account["joint_accepted"] is False
    check_same(dropped, alone)
    assert dropped.validation == alone.validation
    pattern, decoder = read_trained_pattern(tmp_path / "a.h5"), alone.network.state_dict()
    for name, weight in pattern.network.state_dict().items():
        assert torch.equal(weight, decoder[name].half().float())


def test_a_joint_stage_that_is_better_is_kept(tmp_path, accept_always):
    write_files(tmp_path, {"joint": {"share": 0.0}})
    alone = train(tmp_path, 4)
    write_files(tmp_path)
    kept = train(tmp_path)
    assert kept.account["joint_accepted"] is True
    assert not torch.equal(kept.phase, alone.phase)
    assert not same(kept.network.state_dict(), alone.network.state_dict())
    # The pattern stays mirrored.
    assert torch.equal(kept.phase, kept.phase.flip(0))
    assert torch.equal(kept.phase, kept.phase.flip(1))


def test_a_pattern_without_a_learning_rate_stays_in_the_joint_stage(tmp_path, accept_always):
    """Bit for bit, while the decoder goes on: what joint training is compared with."""
    write_files(tmp_path, {"joint": {"share": 0.0}})
    alone = train(tmp_path, 4)
    write_files(tmp_path, {"joint": {"pattern_rate": 0.0}})
    kept = train(tmp_path)
    assert torch.equal(kept.phase, alone.phase)
    assert not same(kept.network.state_dict(), alone.network.state_dict())
