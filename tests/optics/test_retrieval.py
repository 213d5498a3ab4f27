"""Gerchberg-Saxton on all pixels, judged by whole FFTs on grids of their own."""

import math

import numpy as np
import pytest
import torch
from judges.retrieval import (
    WAVELENGTH,
    camera,
    embedded,
    gerchberg_saxton_by_whole_ffts,
    light,
    merits,
    ring,
    seeded,
    spiral,
    stop_share,
    tensor,
    turned,
    whole_far_field,
)

from optics.plane import Plane
from optics.progress import Cancelled, Progress
from optics.retrieval import design_plane
from optics.retrieval.gerchberg_saxton import gerchberg_saxton
from optics.retrieval.goal import RetrievalGoal
from optics.retrieval.superpixel import STARTS

SHAPE, WINDOW, LENGTH, DIAMETER = (60, 64), (61, 64), 128, 55.0
CAMERA = camera(SHAPE, DIAMETER)
STOP = stop_share(SHAPE, DIAMETER)
PLANE = design_plane(CAMERA, WAVELENGTH, WINDOW)
TARGET = ring(WINDOW, 18, 2)


def solve(iterations: int, start="quadratic", seed=1, target=TARGET, **options) -> np.ndarray:
    return gerchberg_saxton(
        CAMERA, tensor(target), PLANE, WAVELENGTH, iterations=iterations, start=start,
        generator=seeded(seed), **options,
    ).numpy()  # fmt: skip


def lens_start(target: np.ndarray) -> np.ndarray:
    """The parabola whose slope at the panel's edge sends light to the target's farthest part."""
    y, x = (np.arange(n) - (n - 1) / 2 for n in SHAPE)
    lit = [np.flatnonzero((target > 0.5).any(1 - k)) - WINDOW[k] // 2 for k in (0, 1)]
    bend = [math.pi * np.abs(lit[k]).max() / (LENGTH * SHAPE[k] / 2) for k in (0, 1)]
    return bend[0] * y[:, None] ** 2 + bend[1] * x[None, :] ** 2


@pytest.mark.parametrize("target", [ring(WINDOW, 18, 2), spiral(WINDOW, 24, 2)])
@pytest.mark.parametrize("start", ["quadratic", "random"])
def test_the_iterates_are_those_of_the_whole_transform(start, target):
    """Thirty iterations in single precision and on a window, against all samples in double."""
    random = torch.rand(SHAPE, generator=seeded(3), dtype=torch.float64).numpy() * 2 * np.pi
    first = random if start == "random" else lens_start(target)
    amplitude = RetrievalGoal(CAMERA, tensor(target), PLANE, WAVELENGTH).amplitude.numpy()
    truth = gerchberg_saxton_by_whole_ffts(first, target, LENGTH, 30, amplitude)
    found = solve(30, start, 3, target)
    assert np.percentile(turned(found, truth)[STOP > 0], 99.9) < 1e-2


@pytest.mark.parametrize("start", STARTS)
def test_the_error_never_grows(start):
    """Theorem (Fienup 1982): | |F| - target | over the whole plane is non-increasing, which
    is the same as a non-decreasing overlap of |F| with the target's amplitude."""
    amplitude = embedded(np.sqrt(TARGET), LENGTH)
    fields = [STOP * np.exp(1j * solve(n, start)) for n in (1, 2, 3, 4, 6, 10, 20, 40)]
    overlap = [(np.abs(whole_far_field(f, LENGTH)) * amplitude).sum() for f in fields]
    assert (np.diff(overlap) >= -1e-5 * overlap[-1]).all()
    assert overlap[-1] > 1.01 * overlap[0]


@pytest.mark.parametrize(("start", "most"), [("smooth", 0.4), ("quadratic", 0.5), ("random", 0.8)])
def test_the_light_goes_to_the_ring(start, most):
    """A neutral pattern sends almost nothing there; fully developed speckle has contrast 1.
    Judged on a grid twice as fine as the design's."""
    window, fine = tuple(2 * n for n in WINDOW), ring(WINDOW, 18, 2, fine=2)
    psf = light(solve(60, start)[None], 2 * LENGTH, window, STOP)
    efficiency, contrast, _ = merits(psf, fine)
    assert efficiency > 0.8
    assert contrast < most
    neutral = light(np.zeros((1, *SHAPE)), 2 * LENGTH, window, STOP)
    assert merits(neutral, fine)[0] < 0.1


@pytest.mark.parametrize("start", ["smooth", "random"])
def test_the_seed_alone_decides_a_start_by_chance(start):
    assert np.array_equal(solve(3, start, 5), solve(3, start, 5))
    assert not np.allclose(solve(3, start, 5), solve(3, start, 6))


@pytest.mark.parametrize("scale", [7.0, 1e-30, 1e30, 1e-200, 1e200])
def test_scaling_the_target_changes_nothing(scale):
    found = solve(5, target=scale * TARGET)
    assert turned(found, solve(5))[STOP > 0].max() < 1e-3


def test_numpy_targets_give_numpy_patterns():
    phase = gerchberg_saxton(
        CAMERA, TARGET, PLANE, WAVELENGTH, iterations=1, generator=torch.Generator()
    )
    assert isinstance(phase, np.ndarray)
    assert phase.shape == SHAPE


def test_progress_is_reported_and_cancelling_stops():
    heard = []
    solve(4, progress=Progress(lambda f, m: heard.append((f, m))))
    fractions = [f for f, _ in heard]
    assert fractions == sorted(fractions)
    assert all(0 <= f <= 1 for f in fractions)
    assert len(heard) >= 3
    assert heard[-1][1] == "Gerchberg-Saxton 4/4"
    stopped = Progress()
    stopped.cancel()
    with pytest.raises(Cancelled):
        solve(4, progress=stopped)


@pytest.mark.parametrize(
    ("target", "words"),
    [
        (np.zeros(WINDOW), r"target .* somewhere positive"),
        (np.full(WINDOW, math.nan), r"target must be finite"),
        (np.full(WINDOW, math.inf), r"target must be finite"),
        (np.where(np.arange(61)[:, None] == 2, -1.0, np.ones(WINDOW)), r"nowhere negative"),
        (np.ones((61, 1)), r"target is \(61, 1\).*\(61, 64\)"),
    ],
)
def test_a_target_that_no_psf_can_have_is_refused(target, words):
    with pytest.raises(ValueError, match=words):
        solve(1, target=target)


def test_other_bad_arguments_are_refused_by_name():
    with pytest.raises(ValueError, match=r"iterations is 0; at least 1"):
        solve(0)
    with pytest.raises(ValueError, match=r"start is 'flat'; choose one of smooth, quad"):
        solve(1, "flat")
    with pytest.raises(ValueError, match=r"wavelength is 0 m; it must be positive"):
        gerchberg_saxton(CAMERA, TARGET, PLANE, 0.0, iterations=1, generator=torch.Generator())


def test_a_window_of_one_sample_is_solved_too():
    """All light to the axis: a constant phase, up to the last bits."""
    plane = Plane((1, 1), PLANE.pitch)
    phase = gerchberg_saxton(
        CAMERA, torch.ones(1, 1), plane, WAVELENGTH, iterations=2, generator=torch.Generator()
    ).numpy()[STOP > 0]
    assert turned(phase, phase[:1]).max() < 1e-3
