"""What is asked of the image in every iteration of a single frame, and what comes of it."""

import math

import numpy as np
import pytest
import torch
from judges import relative
from judges.retrieval import (
    WAVELENGTH,
    camera,
    dots,
    light,
    merits,
    published_program,
    ring,
    seeded,
    spiral,
    tensor,
)

from optics.progress import Progress
from optics.retrieval import design_plane
from optics.retrieval.gerchberg_saxton import (
    amplitude_constraint,
    iterate_constraint,
    mixed_region_constraint,
    over_compensated_constraint,
)
from optics.retrieval.goal import RetrievalGoal
from optics.retrieval.methods import published_program_pattern
from optics.retrieval.superpixel import Superpixels, quadratic_start

WINDOW = (70, 81)
TARGETS = {
    "ring": ring(WINDOW, 18, 2),
    "spiral": spiral(WINDOW, 24, 2),
    "dots": dots(WINDOW, [(-20, -9), (4, 22), (18, -15), (0, 0)], 3),
    "rings": ring(WINDOW, 24, 2) + 0.5 * ring(WINDOW, 10, 2),
}


def pixels_for(target: np.ndarray, shape=(55, 97)) -> Superpixels:
    optics = camera(shape)
    plane = design_plane(optics, WAVELENGTH, target.shape)
    return Superpixels(RetrievalGoal(optics, tensor(target), plane, WAVELENGTH), 1)


def solved(pixels: Superpixels, constrain, iterations: int) -> np.ndarray:
    """The PSF, share of all light a sample."""
    start = pixels.panel_field(quadratic_start(pixels))
    asked = iterate_constraint(pixels, start, constrain, iterations, Progress(), "")
    return light(
        pixels.pixel_phases(asked).numpy()[None],
        pixels.goal.far_field_samples,
        pixels.goal.plane.shape,
    )


# The constraints, sample by sample

FIELD = torch.tensor([[0.4j, -2.5, 0.0, 3 + 4j]], dtype=torch.complex128)
INTENSITY = torch.tensor([[1.0, 1.0, 4.0, 0.0]], dtype=torch.float64)


def test_replaced_takes_the_targets_amplitude_and_the_fields_phase():
    assert amplitude_constraint(INTENSITY)(FIELD).tolist() == [[1j, -1, 0, 0]]


def test_over_compensation_answers_an_error_by_its_opposite():
    """2A - a, where that is positive: 2 - 0.4, 2 - 2.5 and nothing where nothing is wanted."""
    asked = over_compensated_constraint(INTENSITY)(FIELD)
    assert relative(asked, np.array([[1.6j, 0, 0, 0]])) < 1e-15


def test_a_mixed_region_lets_the_dark_keep_a_share():
    asked = mixed_region_constraint(INTENSITY, 0.25)(FIELD)
    assert relative(asked, np.array([[0.75j, -0.75, 0, 0.25 * (3 + 4j)]])) < 1e-15
    rigid = mixed_region_constraint(INTENSITY, 0.0)(FIELD)
    assert relative(rigid, amplitude_constraint(INTENSITY)(FIELD)) < 1e-15


@pytest.mark.parametrize("freedom", [-0.1, 1.0, 1.5, math.nan, math.inf])
def test_a_freedom_that_is_no_share_is_refused(freedom):
    with pytest.raises(ValueError, match=r"freedom is .*; it must lie between 0 and 1"):
        mixed_region_constraint(INTENSITY, freedom)


# What comes of them


@pytest.mark.parametrize("name", TARGETS)
def test_over_compensation_speckles_less_after_as_many_iterations(name):
    target = TARGETS[name]
    pixels = pixels_for(target)
    plain = merits(solved(pixels, amplitude_constraint(pixels.target_intensity), 20), target)
    better = merits(
        solved(pixels, over_compensated_constraint(pixels.target_intensity), 20), target
    )
    assert better[1] < 0.9 * plain[1]
    assert better[2] < 0.95 * plain[2]
    assert better[0] > plain[0] - 0.03


def test_freedom_costs_light_and_saves_speckle():
    """Light in the window's dark part, and contrast on the bright one, against the rigid way."""
    target = TARGETS["spiral"]
    pixels = pixels_for(target)
    dark = target < 0.02
    psfs = [
        solved(pixels, mixed_region_constraint(pixels.target_intensity, f), 30)
        for f in (0.0, 0.2, 0.4)
    ]
    astray = [psf[dark].sum() for psf in psfs]
    contrast = [merits(psf, target)[1] for psf in psfs]
    assert astray[0] < astray[1] < astray[2]
    assert contrast[2] < 0.97 * contrast[0]


# The published program

# Of targets that are the same on every second sample of the design grid and nearest by nearest.
PANELS = [(36, 64), (64, 64), (64, 40), (37, 81)]


@pytest.mark.parametrize("shape", PANELS)
def test_the_published_program_is_told_again(shape):
    """Against its steps with whole FFTs; up to a constant phase, of which it adds -pi/2 a round."""
    side = max(shape)
    window = (2 * (side // 3) + 1, 2 * (side // 3) + 1)
    target = spiral(window, side / 4, 2.5)
    pixels = pixels_for(target, shape)
    start = torch.rand(shape, generator=seeded(4)).numpy().astype(float) * 6 * np.pi
    # Every second sample, from the middle: the program's grid has half as many.
    ratio = pixels.goal.far_field_samples / side
    assert ratio == 2
    critical = target[(window[0] // 2) % 2 :: 2, (window[1] // 2) % 2 :: 2]
    middle = (window[0] // 2 - (window[0] // 2) % 2) // 2
    whole = np.zeros((side, side))
    first = side // 2 - middle
    whole[first : first + len(critical), first : first + len(critical)] = critical
    for iterations, most in ((1, 1e-3), (4, 1e-2)):
        truth = published_program(start, whole, iterations)
        found = published_program_pattern(pixels.goal, iterations, seeded(4), Progress()).numpy()
        apart = np.exp(1j * (found - truth))
        apart = np.abs(np.angle(apart / apart.mean()))
        assert np.percentile(apart, 99) < most


def test_the_published_program_speckles_between_its_samples():
    """What the project's notes found in its own results: smooth on its grid, and not between."""
    target = ring((60, 60), 16, 3)
    pixels = pixels_for(target, (64, 64))
    phase = published_program_pattern(pixels.goal, 60, seeded(), Progress()).numpy()[None]
    coarse = light(phase, 64, (30, 30))
    fine = light(phase, 128, (60, 60))
    assert merits(coarse, target[::2, ::2])[1] < 0.4
    assert merits(fine, target)[1] > 0.5
