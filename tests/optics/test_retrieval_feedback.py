"""A camera in the loop of a bench that nobody has described."""

import itertools
import math

import numpy as np
import pytest
import scipy.ndimage
import torch
from judges import positions
from judges.retrieval import (
    WAVELENGTH,
    camera,
    light,
    merits,
    quantised,
    ring,
    seeded,
    spiral,
    tensor,
)
from sweeps import some

from optics.progress import Cancelled, Progress
from optics.retrieval import design_plane, retrieve
from optics.retrieval.camera_feedback import refine
from optics.retrieval.goal import RetrievalGoal

SHAPE, WINDOW, LENGTH = (60, 64), (61, 64), 128
CAMERA = camera(SHAPE)
PLANE = design_plane(CAMERA, WAVELENGTH, WINDOW)
TARGET = ring(WINDOW, 18, 3)


def bench(figure: float = 0.0, gain: float = 1.0, straight: float = 0.0):
    """A bench with a flatness in radians, a response and unmodulated light that no model knows.

    Its camera counts in units of its own.
    """
    y, x = positions(60, 1 / 30)[:, None], positions(64, 1 / 32)[None, :]
    hidden = figure * (y**2 - x**2 + np.sin(3 * x + y))

    def measure(phases: torch.Tensor, progress: Progress | None = None) -> torch.Tensor:
        shown = gain * quantised(phases.double().numpy()) + hidden
        seen = (1 - straight) * light(shown, LENGTH, WINDOW)
        seen += straight * light(hidden[None], LENGTH, WINDOW)
        return torch.from_numpy(seen * 40_000)

    return measure


def goal_of(target=TARGET) -> RetrievalGoal:
    return RetrievalGoal(CAMERA, tensor(target), PLANE, WAVELENGTH)


def solution(goal: RetrievalGoal, frames: int) -> torch.Tensor:
    return retrieve(
        CAMERA, goal.target, PLANE, WAVELENGTH, frames=frames, iterations=60, generator=seeded()
    ).phases


def bright_error(picture: np.ndarray, target: np.ndarray) -> float:
    """NRMSE with the best scale, where the target exceeds 2 % of its peak."""
    lit = target > 0.02 * target.max()
    return merits(picture[lit], target[lit])[2]


TROUBLES = ({"figure": 0.5}, {"gain": 0.93}, {"figure": 0.3, "gain": 1.05, "straight": 0.02})
TARGETS = (ring(WINDOW, 18, 3), spiral(WINDOW, 24, 3))


@pytest.mark.parametrize(
    ("shown", "trouble", "target"),
    some(itertools.product([(1, 0.95), (4, 0.92)], TROUBLES, TARGETS), 0, 3, 5, 6),
)
def test_pictures_correct_what_no_model_knows(target, trouble, shown):
    """Contrast and error of what the bench really shows, before and after."""
    frames, most = shown
    goal, measure = goal_of(target), bench(**trouble)
    start = solution(goal, frames)
    found = refine(goal, start, measure, 8)
    assert found.phases.shape == start.shape
    assert found.phases.dtype == torch.float32
    before, after = (measure(p).numpy() for p in (start, found.phases))
    assert merits(after, target)[1] < most * merits(before, target)[1]
    # What is told of the pictures is what they show.
    assert found.errors[0] == pytest.approx(bright_error(before, target), rel=1e-4)
    assert min(found.errors) == pytest.approx(bright_error(after, target), rel=1e-4)
    assert found.errors[found.best] == min(found.errors)


def test_what_is_right_already_is_not_spoilt():
    """On a bench as described: the start itself, or something that its camera likes better."""
    goal, measure = goal_of(), bench()
    start = solution(goal, 4)
    found = refine(goal, start, measure, 3)
    before, after = (bright_error(measure(p).numpy(), TARGET) for p in (start, found.phases))
    assert after <= before
    assert torch.equal(found.phases, start) == (found.best == 0)


def test_a_wide_pixel_is_no_error():
    """A camera that sees everything blurred, and a target that is blurred alike."""

    def blur(picture: torch.Tensor) -> torch.Tensor:
        return torch.from_numpy(scipy.ndimage.uniform_filter(picture.numpy(), 5))

    def measure(phases, progress=None):
        return blur(bench(figure=0.3)(phases))

    goal = goal_of()
    start = solution(goal, 4)
    found = refine(goal, start, measure, 8, blur=blur)
    wanted = scipy.ndimage.uniform_filter(TARGET, 5)
    before, after = (bright_error(measure(p).numpy(), wanted) for p in (start, found.phases))
    assert found.errors[0] == pytest.approx(before, rel=1e-4)
    assert after < 0.8 * before


def test_so_many_pictures_are_taken_of_the_frames_that_are_to_be_shown():
    shown = []

    def measure(phases, progress):
        shown.append(phases)
        return bench(figure=0.3)(phases)

    goal = goal_of()
    start = solution(goal, 2)
    found = refine(goal, start, measure, 4)
    assert len(shown) == len(found.errors) == 4
    assert all(phases.shape == (2, *SHAPE) for phases in shown)
    assert torch.equal(shown[0], start)
    assert torch.equal(shown[found.best], found.phases)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda p: p[1:], r"picture is \(60, 64\) and the target \(61, 64\); lay it on the design"),
        (lambda p: 0 * p, "lit where the target is; subtract a dark frame"),
        (lambda p: p - 0.5 * p.mean(), "nowhere negative"),
        (lambda p: torch.where(p == p.max(), math.nan, p), "must be finite"),
        (lambda p: torch.where(p == p.max(), math.inf, p), "must be finite"),
    ],
)
def test_a_picture_that_is_none_is_refused(change, words):
    goal = goal_of()
    with pytest.raises(ValueError, match=words):
        refine(goal, solution(goal, 1), lambda phases, progress: change(bench()(phases)), 2)


@pytest.mark.parametrize("pictures", [0, 1, -3])
def test_a_single_picture_corrects_nothing(pictures):
    goal = goal_of()
    with pytest.raises(ValueError, match=rf"pictures is {pictures}; two at least"):
        refine(goal, solution(goal, 1), bench(), pictures)


def test_progress_is_shared_with_the_camera_and_cancels():
    heard, goal = [], goal_of()
    progress = Progress(lambda fraction, message: heard.append(fraction))

    def measure(phases, part):
        part.report(0.5, "exposing")
        if len(heard) == 2:
            progress.cancel()
        return bench()(phases)

    start = solution(goal, 1)
    with pytest.raises(Cancelled):
        refine(goal, start, measure, 4, progress=progress)
    assert heard == sorted(heard)
    assert len(heard) == 2
