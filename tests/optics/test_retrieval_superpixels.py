"""Superpixels, and the way back from them to all pixels, against direct sums."""

import numpy as np
import pytest
import torch
from judges import relative
from judges.retrieval import (
    WAVELENGTH,
    camera,
    light,
    merits,
    ring,
    seeded,
    sums_back,
    tensor,
    turned,
    whole_far_field,
)

from optics.progress import Progress
from optics.retrieval import design_plane
from optics.retrieval import superpixel as module
from optics.retrieval.gerchberg_saxton import iterate_constraint, over_compensated_constraint
from optics.retrieval.goal import RetrievalGoal
from optics.retrieval.superpixel import Superpixels, quadratic_start, random_start, superpixel_side
from optics.slm import PanelMap


def goal_of(shape, window, stop=None, **panel) -> RetrievalGoal:
    optics = camera(shape, stop, **panel)
    return RetrievalGoal(
        optics, torch.ones(window), design_plane(optics, WAVELENGTH, window), WAVELENGTH
    )


# Panels that a side divides, and panels that it doesn't: the last superpixels reach beyond.
PANELS = [((54, 96), 2), ((54, 96), 3), ((55, 97), 4), ((55, 97), 5), ((64, 60), 1)]


@pytest.mark.parametrize(("shape", "side"), PANELS)
@pytest.mark.parametrize("window", [(20, 18), (17, 21)])
def test_the_pattern_is_the_windows_field_at_every_pixel(shape, side, window):
    """Evaluated by direct sums, around the middle of the first superpixel."""
    pixels = Superpixels(goal_of(shape, window), side)
    rng = np.random.default_rng(0)
    fields = rng.normal(size=(2, *window)) + 1j * rng.normal(size=(2, *window))
    patterns = pixels.pixel_phases(torch.from_numpy(fields).to(torch.complex64)).numpy()
    assert patterns.shape == (2, *shape)
    y, x = (np.arange(n) - (side - 1) / 2 for n in shape)
    for field, pattern in zip(fields, patterns, strict=True):
        truth = sums_back(field, pixels.goal.far_field_samples, y, x)
        seen = np.abs(truth) > 1e-3 * np.abs(truth).max()
        assert seen.mean() > 0.99
        assert turned(pattern, truth)[seen].max() < 1e-3


@pytest.mark.parametrize(("shape", "side"), [((54, 96), 3), ((55, 97), 5)])
def test_at_the_middle_of_a_superpixel_the_pattern_is_the_superpixels(shape, side):
    """An odd side has a pixel there, and the coarse panel's own inverse transform knows it."""
    pixels = Superpixels(goal_of(shape, (20, 18)), side)
    rng = np.random.default_rng(1)
    window = rng.normal(size=(20, 18)) + 1j * rng.normal(size=(20, 18))
    coarse = sums_back(
        window, pixels.goal.far_field_samples // side, *(np.arange(n) for n in pixels.shape)
    )
    pattern = pixels.pixel_phases(torch.from_numpy(window).to(torch.complex64)).numpy()
    middles = pattern[side // 2 :: side, side // 2 :: side]
    coarse = coarse[: middles.shape[0], : middles.shape[1]]
    seen = np.abs(coarse) > 1e-2 * np.abs(coarse).max()
    assert turned(middles, coarse)[seen].max() < 1e-3


@pytest.mark.parametrize(("shape", "side"), PANELS)
def test_a_pattern_of_all_pixels_is_told_to_superpixels(shape, side):
    """Lowered and made a pattern again, its far field gives what the window holds of it."""
    pixels = Superpixels(goal_of(shape, (20, 19)), side)
    rng = np.random.default_rng(2)
    window = torch.from_numpy(rng.normal(size=(20, 19)) + 1j * rng.normal(size=(20, 19)))
    pattern = pixels.pixel_phases(pixels.to_superpixel_origin(window)).numpy()
    truth = sums_back(window.numpy(), pixels.goal.far_field_samples, *(np.arange(n) for n in shape))
    seen = np.abs(truth) > 1e-3 * np.abs(truth).max()
    assert turned(pattern, truth)[seen].max() < 1e-3


@pytest.mark.parametrize(("shape", "side"), PANELS)
def test_superpixels_lie_in_the_middle_of_their_pixels(shape, side):
    pixels = Superpixels(goal_of(shape, (8, 8)), side)
    for axis, n in enumerate(shape):
        places = np.arange(n) - (n - 1) / 2
        whole = n // side
        truth = places[: whole * side].reshape(whole, side).mean(1)
        assert pixels.positions(axis).numpy()[:whole] == pytest.approx(truth)
        assert pixels.shape[axis] == whole + (n % side > 0)
        assert len(pixels.positions(axis)) == pixels.shape[axis]


@pytest.mark.parametrize(("shape", "side"), PANELS)
def test_superpixels_have_their_pixels_mean_amplitude(shape, side):
    """What reaches beyond the panel is dark; the target gets the light that is there."""
    slope = PanelMap(np.array([[1.0, 0.2], [0.7, 0.4]]))
    for goal in (goal_of(shape, (8, 9), stop=50.0, illumination=slope), goal_of(shape, (8, 9))):
        pixels = Superpixels(goal, side)
        amplitude = goal.amplitude.numpy()
        truth = np.zeros(pixels.shape)
        for (row, column), value in np.ndenumerate(amplitude):
            truth[row // side, column // side] += value / side**2
        assert relative(pixels.amplitude, truth) < 1e-6
        power = (np.abs(whole_far_field(truth, goal.far_field_samples // side)) ** 2).sum()
        assert float(pixels.target_intensity.double().sum()) == pytest.approx(power, rel=1e-5)


def test_an_even_panel_needs_no_amplitude():
    assert Superpixels(goal_of((54, 96), (8, 8)), 3).uneven_amplitude is None
    assert Superpixels(goal_of((55, 97), (8, 8)), 3).uneven_amplitude is not None
    assert Superpixels(goal_of((54, 96), (8, 8), stop=50.0), 3).uneven_amplitude is not None


@pytest.mark.parametrize(
    ("shape", "window", "side"),
    [
        ((1080, 1920), (128, 128), 16),  # 3840 / 16 = 240 samples are more than 1.5 times 128
        ((1080, 1920), (256, 256), 10),  # 384 for 384
        ((1080, 1920), (96, 512), 5),  # the longer side counts: 768 for 768
        ((1080, 1920), (2134, 2134), 1),
        ((1080, 1920), (3840, 3840), 1),
        ((60, 64), (20, 20), 4),  # of 128: 32 for 30; a side of 8 would leave 16
        ((60, 64), (4, 4), 4),  # 8 superpixels a side at least, and neither 6 nor 7 divides 128
        ((12, 15), (2, 2), 1),
        ((55, 97), (30, 30), 4),  # of 200: 50 for 45; 5 would leave 40
        ((1, 400), (8, 8), 1),
    ],
)
def test_superpixels_are_as_large_as_window_and_panel_allow(shape, window, side, monkeypatch):
    """Half as many samples again as the window has are room enough."""
    monkeypatch.setattr(module, "_ROOM", 1.5)
    goal = goal_of(shape, window)
    assert superpixel_side(goal) == side
    Superpixels(goal, side)


@pytest.mark.parametrize("shape", [(108, 192), (110, 195)])
def test_patterns_of_superpixels_are_as_good_as_those_of_pixels(shape):
    """A ring's efficiency, contrast and error, on a whole FFT of all pixels."""
    optics, window = camera(shape), (64, 64)
    target = ring(window, 20, 3)
    goal = RetrievalGoal(
        optics, tensor(target), design_plane(optics, WAVELENGTH, window), WAVELENGTH
    )
    found = {}
    for side in (1, superpixel_side(goal)):
        pixels = Superpixels(goal, side)
        start = pixels.panel_field(quadratic_start(pixels))
        asked = iterate_constraint(
            pixels, start, over_compensated_constraint(pixels.target_intensity), 40, Progress(), ""
        )
        psf = light(pixels.pixel_phases(asked).numpy()[None], goal.far_field_samples, window)
        found[side] = merits(psf, target)
    fine, coarse = found.values()
    assert max(found) >= 3
    assert coarse[0] > fine[0] - 0.02
    assert coarse[1] < 1.5 * fine[1]
    assert coarse[2] < 1.5 * fine[2]


def test_random_starts_fill_a_wave_evenly():
    pixels = Superpixels(goal_of((54, 96), (8, 8)), 1)
    counts, _ = np.histogram(random_start(pixels, seeded()).numpy(), bins=8, range=(0, 2 * np.pi))
    assert counts.sum() == 54 * 96
    # Six standard deviations of a binomial count.
    assert np.abs(counts - 648).max() < 6 * np.sqrt(648)
