"""Scenes of `labapp train edof`: their depths, how they are drawn, and their captures."""

from __future__ import annotations

import math

import numpy as np
import pytest
import tiny_edof
import torch

from labapp.training.edof import decoder_task, joint_task
from labapp.training.edof.captures import capture_scenes
from labapp.training.edof.depth_choice import choose_dioptres, depth_chances, depth_indices
from labapp.training.edof.optics_table import training_dioptres

# Depths.


@pytest.mark.parametrize("count", [2, 5, 10, 16, 257])
def test_all_depths_are_drawn_equally_often_the_first_and_the_last_too(count):
    """A published sampler draws int(u * (count - 1)), and never the last depth."""
    numbers = (np.arange(100 * count) + 0.5) / (100 * count)
    even = torch.full((count,), 1 / count, dtype=torch.float64)
    found = np.bincount(depth_indices(even, numbers), minlength=count)
    assert (found == 100).all()
    assert depth_indices(even, [0.0, np.nextafter(1, 0)]) == [0, count - 1]


def test_depths_are_drawn_as_often_as_their_chances_say():
    chances = torch.tensor([0.1, 0.4, 0.0, 0.3, 0.2], dtype=torch.float64)
    numbers = (np.arange(1000) + 0.5) / 1000
    found = np.bincount(depth_indices(chances, numbers), minlength=5)
    assert found.tolist() == [100, 400, 0, 300, 200]
    dioptres = choose_dioptres(chances, [0.0, 0.05, 0.3, 0.65, 0.9], (1.0, 2.0))
    assert dioptres == pytest.approx([1.0, 1.1, 1.3, 1.7, 1.9])
    even = torch.full((7,), 1 / 7)
    numbers = np.linspace(0, 1, 30)
    assert choose_dioptres(even, numbers, (0.5, 2.5)) == pytest.approx(list(0.5 + 2 * numbers))


def test_important_depths_are_those_where_the_psf_changes_most():
    """Transfer functions that change by 1, 2 and 3 from depth to depth."""
    config = tiny_edof.make_config({"depths": {"importance": "focus-shift"}})
    levels = torch.tensor([0.0, 1.0, 3.0, 6.0])
    transfers = levels[:, None, None].to(torch.complex64).expand(4, 8, 5)
    chances = depth_chances(transfers, config)
    torch.testing.assert_close(chances, torch.tensor([1.0, 1.5, 2.5, 3.0]).double() / 8)
    assert (depth_chances(transfers, tiny_edof.make_config()) == 0.25).all()
    named = {"importance": "focus-shift", "distances_m": [1.2, 1.5, 2.0, 3.0]}
    config = tiny_edof.make_config({"depths": named})
    assert (depth_chances(transfers, config) == 0.25).all()


def test_a_lens_without_pattern_changes_most_near_its_focus():
    changes = {"depths": {"importance": "focus-shift", "count": 12}, "pattern": {"start": "flat"}}
    table = tiny_edof.make_table(tiny_edof.make_config(changes))
    near = np.abs(np.array(table.dioptres) - 0.5) <= 0.1
    assert near.sum() == 4
    assert float(table.chances[near].sum()) > 2 * float(table.chances[~near].sum())
    assert float(table.chances.sum()) == pytest.approx(1)


def test_the_table_is_farthest_first_over_the_whole_range():
    config = tiny_edof.make_config()
    np.testing.assert_allclose(training_dioptres(config), [0.36, 0.48, 0.6, 0.72, 0.84])
    np.testing.assert_allclose(training_dioptres(config, 3), [0.4, 0.6, 0.8])
    named = tiny_edof.make_config({"depths": {"distances_m": [1.25, 2.0, 4.0]}})
    np.testing.assert_allclose(training_dioptres(named), [0.25, 0.5, 0.8])


# Scenes.


def test_scenes_are_drawn_over_the_ranges_that_the_configuration_names():
    config = tiny_edof.make_config(
        {"capture": {"noise": [0.002, 0.05], "unmodulated": [0.02, 0.05]}}
    )
    drawn = tiny_edof.make_sampler(config).draw(0, range(200))
    depths = np.concatenate([one.depths for one in drawn])
    counts, _ = np.histogram(depths, 5, (0, 1))
    assert (np.abs(counts - len(depths) / 5) < 4 * np.sqrt(len(depths) * 0.16)).all()
    assert all((np.diff(one.depths) <= 0).all() for one in drawn)
    for name, (low, high) in {"noise": (0.002, 0.05), "unmodulated": (0.02, 0.05)}.items():
        values = np.array([getattr(one, name) for one in drawn])
        assert low <= values.min() < low + 0.05 * (high - low)
        assert high - 0.05 * (high - low) < values.max() <= high
        assert abs(np.median(values) - (low + high) / 2) < 0.15 * (high - low)
    logarithmic = {"capture": {"noise": [0.002, 0.05], "spread": "logarithmic"}}
    drawn = tiny_edof.make_sampler(tiny_edof.make_config(logarithmic)).draw(0, range(200))
    assert 0.6 < np.median([one.noise for one in drawn]) / 0.01 < 1.6
    grain = np.stack([one.grain for one in drawn])
    assert abs(grain.mean()) < 0.01
    assert abs(grain.std() - 1) < 0.01


def test_scenes_belong_to_seed_step_and_sample():
    config = tiny_edof.make_config()
    sampler = tiny_edof.make_sampler(config)
    together = sampler.draw(4, range(3))
    (alone,) = sampler.draw(4, [2])
    assert np.array_equal(alone.scene.pictures, together[2].scene.pictures)
    assert np.array_equal(alone.grain, together[2].grain)
    others = [
        *sampler.draw(5, [2]),
        *sampler.draw(4, [1]),
        *tiny_edof.make_sampler(tiny_edof.make_config({"": {"seed": 2}})).draw(4, [2]),
    ]
    assert not any(np.array_equal(one.grain, alone.grain) for one in others)


def test_scenes_that_are_drawn_beforehand_are_the_same():
    config = tiny_edof.make_config()
    now = tiny_edof.make_sampler(config)
    ahead = tiny_edof.SceneSampler(tiny_edof.MixedPictures(None, 0.0), config, ahead=2)
    for step in (0, 1, 2, 7):
        for one, other in zip(now.draw(step, [0, 3]), ahead.draw(step, [0, 3]), strict=True):
            assert np.array_equal(one.scene.pictures, other.scene.pictures)
            assert np.array_equal(one.grain, other.grain)
            assert (one.noise, one.unmodulated) == (other.noise, other.unmodulated)


def decoded_light(values):
    return np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)


@pytest.mark.parametrize("linear", [False, True])
def test_captures_are_blurred_scenes_with_noise_in_the_order_of_the_scenes(linear):
    """Planes by numpy's transforms, among scenes with more layers."""
    drawn = [
        tiny_edof.plane(0, 2),
        tiny_edof.plane(1, 1),
        tiny_edof.plane(2, 3),
        tiny_edof.plane(3, 1, noise=0.1),
    ]
    transfers = [tiny_edof.random_transfers(len(one.depths), k) for k, one in enumerate(drawn)]
    found = capture_scenes(drawn, transfers, linear=linear)
    assert found.pictures.shape == found.truth.shape == (4, 1, 16, 16)
    for k in (1, 3):
        values = drawn[k].scene.pictures[0].astype(float)
        light = decoded_light(values) if linear else values
        blurred = np.fft.irfft2(np.fft.rfft2(light) * transfers[k][0].numpy())
        wanted = blurred + drawn[k].noise * drawn[k].grain
        np.testing.assert_allclose(found.pictures[k, 0], wanted, atol=1e-5)
        np.testing.assert_allclose(found.truth[k, 0], values, atol=1e-5)
    torch.testing.assert_close(found.noise, torch.tensor([0.03, 0.03, 0.03, 0.1]))
    mattes, pictures = drawn[0].scene.mattes[0], drawn[0].scene.pictures
    sharp = np.where(mattes == 1, pictures[0], pictures[1])
    np.testing.assert_allclose(found.truth[0, 0], sharp, atol=1e-5)


def test_each_scene_is_captured_at_its_depths_with_its_unmodulated_light(monkeypatch):
    config = tiny_edof.make_config({"capture": {"unmodulated": [0.1, 0.5]}})
    task, seen = tiny_edof.make_decoder_task(config), []

    def note(drawn, transfers, *, linear):
        seen.extend(zip(drawn, transfers, strict=True))
        return capture_scenes(drawn, transfers, linear=linear)

    monkeypatch.setattr(decoder_task, "capture_scenes", note)
    table, used = tiny_edof.make_table(config), set()
    task.losses(0, range(30))
    for scene, transfers in seen:
        rows = [math.floor(5 * one) for one in scene.depths]
        used |= set(rows)
        share = scene.unmodulated
        wanted = (1 - share) * table.transfers[rows] + share * table.flat[rows]
        torch.testing.assert_close(transfers, wanted, rtol=1e-5, atol=1e-6)
    assert used == set(range(5))


@pytest.mark.parametrize(
    ("named", "importance"), [([], "even"), ([1.25, 2.0, 2.5], "even"), ([], "focus-shift")]
)
def test_joint_steps_compute_one_depth_of_each_scene_anew(monkeypatch, named, importance):
    changes = {"distances_m": named, "importance": importance}
    config = tiny_edof.make_config({"depths": changes})
    task, asked = tiny_edof.make_joint_task(config), []
    compute = joint_task.transfer_on_axis

    def note(transfer, phase, dioptres, condition=None):
        asked.append(list(dioptres))
        return compute(transfer, phase, dioptres, condition)

    monkeypatch.setattr(joint_task, "transfer_on_axis", note)
    before = task.extra_state()["remembered"].clone()
    drawn = tiny_edof.make_sampler(config).draw(2**31 + 7, range(3))
    numbers = [one.depths[(7 + k) % len(one.depths)] for k, one in enumerate(drawn)]
    with torch.no_grad():
        task.module.pattern.add_(0.2 * torch.rand_like(task.module.pattern))
    task.losses(7, range(3))
    ends = np.concatenate([[0], np.cumsum(depth_chances(before, config).numpy())])
    parts = [int((one >= ends[1:-1]).sum()) for one in numbers]
    if named:
        wanted = [(0.4, 0.5, 0.8)[part] for part in parts]
    else:
        within = [
            (one - ends[part]) / (ends[part + 1] - ends[part])
            for one, part in zip(numbers, parts, strict=True)
        ]
        wanted = [0.3 + 0.2 * (part + one) for part, one in zip(parts, within, strict=True)]
    assert asked == [pytest.approx(wanted)]
    after = task.extra_state()["remembered"]
    assert {k for k in range(3) if not torch.equal(before[k], after[k])} == set(parts)
