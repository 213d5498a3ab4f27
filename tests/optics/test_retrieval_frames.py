"""Videos whose mean has the target's shape, judged by whole FFTs."""

import itertools
import math

import numpy as np
import pytest
import torch
from judges import relative
from judges.retrieval import WAVELENGTH, camera, light, merits, ring, seeded, spiral, tensor
from sweeps import some

from optics.progress import Progress
from optics.retrieval import design_plane
from optics.retrieval.frame_averaging import (
    correct_request,
    independent_frames,
    joint_frames,
    sequential_frames,
)
from optics.retrieval.goal import RetrievalGoal
from optics.retrieval.superpixel import RetrievalJob, Superpixels

SHAPE, WINDOW, LENGTH = (60, 64), (61, 64), 128
CAMERA = camera(SHAPE)
WAYS = [independent_frames, sequential_frames, joint_frames]


def pixels_for(target: np.ndarray) -> Superpixels:
    plane = design_plane(CAMERA, WAVELENGTH, WINDOW)
    return Superpixels(RetrievalGoal(CAMERA, tensor(target), plane, WAVELENGTH), 1)


def solved(way, target: np.ndarray, frames: int, iterations: int, seed=1) -> np.ndarray:
    pixels = pixels_for(target)
    job = RetrievalJob(pixels.goal, frames, iterations, seeded(seed), Progress(), "smooth")
    asked = way(pixels, job)
    assert asked.shape == (frames, *WINDOW)
    return pixels.pixel_phases(asked).numpy()


def contrast(phases: np.ndarray, target: np.ndarray) -> float:
    return merits(light(phases, LENGTH, WINDOW), target)[1]


def test_the_speckle_of_independent_frames_falls_with_the_root_of_their_number():
    """Until the floor, which averaging never removes, is near: a few frames obey the law."""
    target = ring(WINDOW, 18, 2)
    phases = solved(independent_frames, target, 16, 10)
    alone = np.mean([contrast(phase[None], target) for phase in phases])
    for count, slack in ((2, 0.15), (4, 0.25), (16, 0.5)):
        groups = phases.reshape(-1, count, *SHAPE)
        together = np.mean([contrast(group, target) for group in groups])
        assert alone / math.sqrt(count) * 0.9 < together
        assert together < alone / math.sqrt(count) * (1 + slack)


@pytest.mark.parametrize(
    ("frames", "target"),
    some(itertools.product([4, 8], [ring(WINDOW, 18, 2), spiral(WINDOW, 24, 2.5)])),
)
def test_frames_that_know_of_each_other_are_smoother(target, frames):
    """At the same number of frames and of iterations a frame: more, the more they know."""
    blind, aware, together = (contrast(solved(w, target, frames, 40), target) for w in WAYS)
    assert aware < blind / 2
    assert together < 0.95 * aware


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("frames", [1, 3])
def test_the_light_goes_to_the_target(way, frames):
    """Also with one frame, and after one iteration."""
    target = ring(WINDOW, 18, 2)
    for iterations in (1, 30):
        psf = light(solved(way, target, frames, iterations), LENGTH, WINDOW)
        assert merits(psf, target)[0] > 0.75


@pytest.mark.parametrize("way", WAYS)
def test_the_seed_alone_decides(way):
    target = ring(WINDOW, 18, 2)
    first, again, other = (solved(way, target, 2, 5, seed) for seed in (5, 5, 6))
    assert np.array_equal(first, again)
    assert not np.allclose(first, other)
    assert not np.allclose(first[0], first[1])


# The correction of what is asked for


def test_a_mean_that_is_right_is_left_alone():
    """Whatever light is missing everywhere."""
    target = tensor(ring((20, 21), 6, 2))
    assert relative(correct_request(target, target, 0.3 * target), target) < 1e-12


def test_too_dim_a_sample_is_asked_for_more():
    """By the root of the ratio, up to the common scale that keeps the sum."""
    target, wanted = torch.ones(2, 2), torch.tensor([[1.0, 2.0], [1.0, 4.0]])
    mean = torch.tensor([[1.0, 0.25], [0.5, 2.25]])
    asked = correct_request(wanted, target, mean)
    truth = wanted.numpy() * np.sqrt(1 / mean.numpy())
    assert relative(asked, truth * 4 / truth.sum()) < 1e-6


def test_one_correction_is_tenfold_at_most_and_nothing_is_asked_of_the_dark():
    target, wanted = torch.tensor([[1.0, 1.0, 1.0, 0.0]]), torch.tensor([[1.0, 1.0, 1.0, 0.0]])
    mean = torch.tensor([[0.0, 1e-9, 3.0, 7.0]])
    asked = correct_request(wanted, target, mean)[0]
    assert float(asked[0] / asked[2]) == pytest.approx(math.sqrt(10 * 3), rel=1e-6)
    assert float(asked[1]) == float(asked[0])
    assert float(asked[3]) == 0


@pytest.mark.parametrize("seed", range(5))
def test_a_correction_keeps_the_sum_and_stays_finite(seed):
    """Of targets and means with zeros, and of orders of magnitude that are far apart."""
    rng = np.random.default_rng(seed)
    for scale in (1e-20, 1.0, 1e20):
        target, wanted, mean = (
            torch.from_numpy(rng.lognormal(0, 5, (9, 10)) * (rng.random((9, 10)) > 0.3) * s).float()
            for s in (scale, scale, 1.0)
        )
        asked = correct_request(wanted, target, mean)
        assert torch.isfinite(asked).all()
        assert (asked >= 0).all()
        assert float(asked.sum()) == pytest.approx(float(target.sum()), rel=1e-5)


def test_a_mean_without_any_light_asks_for_the_same_again():
    target = torch.tensor([[2.0, 1.0, 0.0]])
    assert relative(correct_request(target, target, torch.zeros(1, 3)), target) < 1e-6
