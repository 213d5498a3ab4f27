"""Training of the denoiser: it learns, on any number of processes, and says what is wrong."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
import torch
from typer.testing import CliRunner

from labapp.cli import app
from labapp.common.errors import UserError
from labapp.pictures.networks import BUNDLED_WEIGHTS, bundled_denoiser, read_denoiser
from labapp.training import denoiser
from labapp.training.denoiser import (
    DenoiserTask,
    denoiser_schedule,
    grey_patches,
    read_training_pictures,
)
from labapp.training.loop import run_training
from labapp.training.task import sample_generator


@pytest.fixture
def folder(tmp_path):
    """Two pictures of stripes and disks."""
    rng = np.random.default_rng(3)
    y, x = np.mgrid[:130, :160]
    where = tmp_path / "pictures"
    where.mkdir()
    for number in range(2):
        picture = np.zeros((130, 160, 3))
        for _ in range(15):
            inside = np.hypot(y - rng.uniform(0, 130), x - rng.uniform(0, 160)) < 25
            picture[inside] = rng.uniform(0, 255, 3)
        cv2.imwrite(str(where / f"{number}.png"), picture.astype(np.uint8))
    return where


CPU = torch.device("cpu")


def test_it_learns_to_take_noise_away(folder, monkeypatch):
    monkeypatch.setattr(denoiser, "_PATCHES", 6)
    monkeypatch.setattr(denoiser, "_SIDE", 32)
    pictures = read_training_pictures([folder])
    task = DenoiserTask(pictures, 1, CPU)
    with torch.no_grad():
        noisy, before = float(task.losses(1000, range(6)).mean()), task.validate()
    result = run_training(task, denoiser_schedule(24, 1))
    with torch.no_grad():
        assert float(task.losses(1000, range(6)).mean()) < 0.7 * noisy
    assert result.history[-1][0] == 24
    assert result.history[-1][1] > before + 2


def test_the_loss_is_the_error_over_a_power_of_the_noise(folder):
    """By hand, patch by patch; a network without weights gives back what it gets."""
    pictures = read_training_pictures([folder])
    task = DenoiserTask(pictures, 7, CPU)
    with torch.no_grad():
        for weight in task.module.parameters():
            weight.zero_()
    found = task.losses(5, range(3, 16))
    for sample, loss in zip(range(3, 16), found.tolist(), strict=True):
        rng = sample_generator(7, 5, sample)
        grey_patches(pictures, 1, 64, rng)
        level = 0.004 * (0.25 / 0.004) ** rng.uniform()
        error = level * np.abs(rng.standard_normal((1, 1, 64, 64), dtype=np.float32)).mean()
        assert loss == pytest.approx(error / level**0.7, rel=1e-4)


def test_other_pictures_and_seeds_are_other_settings(folder):
    pictures = read_training_pictures([folder])
    settings = DenoiserTask(pictures, 1, CPU).settings
    assert settings == DenoiserTask(read_training_pictures([folder]), 1, CPU).settings
    assert settings != DenoiserTask(pictures, 2, CPU).settings
    changed = [one.copy() for one in pictures]
    changed[0][0, 5, 5] += 0.01
    other = DenoiserTask(changed, 1, CPU).settings
    assert {name for name in settings if settings[name] != other[name]} == {"pictures"}


def test_patches_are_of_the_pictures_and_never_the_same(folder):
    pictures = read_training_pictures([folder])
    assert len(pictures) == 6  # Two pictures, three sizes.
    patches = grey_patches(pictures, 5, 64, np.random.default_rng(0))
    assert patches.shape == (5, 1, 64, 64)
    assert 0 <= patches.min() < patches.max() <= 1
    assert torch.equal(patches, grey_patches(pictures, 5, 64, np.random.default_rng(0)))
    assert not torch.equal(patches, grey_patches(pictures, 5, 64, np.random.default_rng(1)))


def test_the_command_writes_weights_that_restore(folder, tmp_path):
    out = tmp_path / "own.npz"
    asked = ["train", "denoiser", str(folder), "--steps", "2", "--out", str(out)]
    done = CliRunner().invoke(app, asked)
    assert done.exit_code == 0, done.output
    assert f"2 steps; kept so far in {out.with_suffix('.training')}" in done.output.replace(
        "\n", ""
    )
    assert out.stat().st_size < 2_000_000
    assert [file.name for file in tmp_path.iterdir() if file.is_file()] == ["own.npz"]
    assert read_denoiser(out)(torch.rand(20, 30), 0.1).shape == (20, 30)
    # The process still knows the smallest numbers: SciPy's trees recurse for ever without.
    assert np.float64(5e-324) * np.ones(1) > 0


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        (["nowhere"], "no picture to learn from"),
        (["{folder}", "--out", "weights.pt"], "written as .npz"),
        (["{folder}", "--steps", "2", "--minutes", "1"], "--minutes and --steps: give one"),
        (["{folder}", "--device", "tpu"], "--device tpu: is unknown"),
        (["{folder}", "--out", "{folder}/0.npz"], "exists already"),
        (["{folder}/broken.png"], "not a picture that can be read"),
        (["{folder}/small.png"], "no picture is larger than a patch"),
    ],
)
def test_what_can_not_be_learned_from(folder, tmp_path, monkeypatch, asked, said):
    monkeypatch.chdir(tmp_path)
    (folder / "0.npz").touch()
    (folder / "broken.png").write_bytes(b"no picture")
    cv2.imwrite(str(folder / "small.png"), np.zeros((20, 20), np.uint8))
    if asked[0] == "{folder}":
        (folder / "broken.png").unlink()
    before = {file.name for file in tmp_path.rglob("*")}
    done = CliRunner().invoke(
        app, ["train", "denoiser", *(word.format(folder=folder) for word in asked)]
    )
    assert isinstance(done.exception, UserError)
    assert said in str(done.exception)
    assert {file.name for file in tmp_path.rglob("*")} == before


def test_a_file_that_is_no_weights(tmp_path):
    np.savez(tmp_path / "wrong.npz", head=np.zeros(3))
    (tmp_path / "text.npz").write_text("weights")
    for name in ("wrong.npz", "text.npz", "none.npz"):
        with pytest.raises(UserError, match=r"not a denoiser's weights|cannot be read"):
            read_denoiser(tmp_path / name)


def test_the_packaged_weights_take_noise_away():
    """As far as a tenth of white: better than any average of neighbours."""
    assert BUNDLED_WEIGHTS.stat().st_size < 2_000_000
    y, x = np.mgrid[:96, :96]
    clean = torch.from_numpy(np.where(np.hypot(y - 40, x - 50) < 28, 0.8, 0.25)).float()
    noisy = clean + 0.1 * torch.randn(96, 96, generator=torch.Generator().manual_seed(1))
    left = float((bundled_denoiser()(noisy, 0.1) - clean).square().mean().sqrt())
    averages = [
        torch.nn.functional.avg_pool2d(noisy[None, None], n, 1, n // 2, count_include_pad=False)
        for n in (3, 5, 7)
    ]
    assert left < 0.5 * min(float((a[0, 0] - clean).square().mean().sqrt()) for a in averages)
