"""Quality on the design grid against a grid twice finer, where no speckle hides either."""

import itertools
from dataclasses import replace

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
    quantised,
    ring,
    seeded,
    spiral,
    stop_share,
    tensor,
)
from sweeps import some

from optics.plane import Plane
from optics.psf import PSFOperator
from optics.retrieval import design_plane, retrieve
from optics.retrieval.goal import RetrievalGoal
from optics.retrieval.phase_retrieval import measure_quality
from optics.retrieval.slow_crystal import displayed_psf
from optics.slm import grey_to_phase, phase_to_grey

SHAPE, WINDOW, LENGTH = (135, 240), (224, 224), 480
LATTICE = [(30 * i + 7 * j, 28 * j - 5 * i) for i in range(-2, 3) for j in range(-2, 3)]

# Of the sizes of the thesis' targets, so that as many samples are judged as on a large panel.
TARGETS = {
    "ring": lambda fine: ring(WINDOW, 50, 6.2, fine),
    "spiral": lambda fine: spiral(WINDOW, 90, 3.5, fine),
    "dots": lambda fine: dots(WINDOW, LATTICE, 3.0, fine),
}


WAYS = ((1, "over-compensated", 40), (1, "gerchberg-saxton", 10), (4, "joint", 20))


@pytest.mark.parametrize(("name", "way"), some(itertools.product(TARGETS, WAYS), 0, 4, 8))
def test_twice_nyquist_is_fine_enough(name, way):
    """Within 1 % of a plain FFT of four times Nyquist, quantised by numpy."""
    frames, method, iterations = way
    optics = camera(SHAPE)
    found = retrieve(
        optics, tensor(TARGETS[name](1)), design_plane(optics, WAVELENGTH, WINDOW), WAVELENGTH,
        frames=frames, method=method, iterations=iterations, generator=seeded(),
    )  # fmt: skip
    fine = tuple(2 * n for n in WINDOW)
    psf = light(quantised(found.phases.numpy()), 2 * LENGTH, fine)
    truth = merits(psf, TARGETS[name](2))
    quality = found.quality
    for figure, sure in zip(
        (quality.steered_share, quality.contrast, quality.nrmse), truth, strict=True
    ):
        assert figure == pytest.approx(sure, rel=0.01)


def test_the_pupils_own_grid_is_not():
    """On every second sample the same pattern looks far smoother than it is."""
    optics, window = camera(SHAPE), (112, 112)
    plane = design_plane(optics, WAVELENGTH, window)
    target = ring(window, 30, 4)
    found = retrieve(
        optics, tensor(target), plane, WAVELENGTH, method="published", iterations=40,
        generator=seeded(),
    )  # fmt: skip
    psf = light(quantised(found.phases.numpy()), LENGTH, window)
    coarse = merits(psf[::2, ::2], target[::2, ::2])[1]
    assert coarse < 0.7 * found.quality.contrast


def test_figures_are_those_of_their_definitions():
    rng = np.random.default_rng(0)
    optics, window = camera((20, 24)), (17, 30)
    target = rng.uniform(0, 1, window) ** 4
    psf = rng.uniform(0, 1, window) / 1000
    goal = RetrievalGoal(
        optics, tensor(target), design_plane(optics, WAVELENGTH, window), WAVELENGTH
    )
    quality = measure_quality(goal, tensor(psf))
    assert (quality.steered_share, quality.contrast, quality.nrmse) == pytest.approx(
        merits(psf, target)
    )


def test_a_perfect_picture_is_perfect():
    optics, window = camera((20, 24)), (17, 30)
    target = ring(window, 6, 2)
    goal = RetrievalGoal(
        optics, 5 * tensor(target), design_plane(optics, WAVELENGTH, window), WAVELENGTH
    )
    quality = measure_quality(goal, tensor(target / target.sum()))
    assert quality.contrast == pytest.approx(0, abs=1e-12)
    assert quality.nrmse == pytest.approx(0, abs=1e-12)
    assert quality.steered_share == pytest.approx(target[target > 0.02].sum() / target.sum())


@pytest.mark.parametrize("window", [(17, 30), (18, 31), (48, 48), (1, 1)])
def test_the_light_judged_is_that_of_a_whole_fft(window):
    """Of frames at random, through a stop, on odd and even windows up to the whole far field."""
    optics = camera((20, 24), stop=19.0)
    goal = RetrievalGoal(
        optics, torch.ones(window), design_plane(optics, WAVELENGTH, window), WAVELENGTH
    )
    phases = np.random.default_rng(0).uniform(-9, 30, (3, 20, 24))
    truth = light(quantised(phases), 48, window, stop_share((20, 24), 19.0))
    assert relative(displayed_psf(goal, torch.from_numpy(phases), 1), truth) < 2e-3


def test_a_mean_is_of_the_light_and_not_of_the_phases():
    """Two blazes to either side: half of the light on each, and none between."""
    optics, window = camera((20, 24)), (17, 30)
    goal = RetrievalGoal(
        optics, torch.ones(window), design_plane(optics, WAVELENGTH, window), WAVELENGTH
    )
    tilt = torch.from_numpy(2 * np.pi * 6 * np.arange(24) / goal.far_field_samples).expand(20, 24)
    psf = displayed_psf(goal, torch.stack([tilt, -tilt]), 1).numpy()
    peak = 20 * 24 / goal.far_field_samples**2 / 2
    assert psf[8, 21] == pytest.approx(peak, rel=0.01)
    assert psf[8, 9] == pytest.approx(peak, rel=0.01)
    assert psf[8, 15] < 0.1 * peak


@pytest.mark.parametrize("separation", [0.0, 0.05])
@pytest.mark.parametrize("fill_factor", [0.6, 0.93])
def test_efficiency_is_the_share_that_the_psf_operator_finds(fill_factor, separation):
    """On a grid of its own: integrated over pixels of a third of the design grid's pitch."""
    optics = camera((60, 72), fill_factor=fill_factor, unmodulated=0.08)
    optics = replace(optics, separation=separation)
    window = (96, 96)
    plane = design_plane(optics, WAVELENGTH, window)
    target = tensor(ring(window, 30, 4))
    found = retrieve(optics, target, plane, WAVELENGTH, iterations=30, generator=seeded())
    shown = grey_to_phase(
        optics.panel, phase_to_grey(optics.panel, found.phases[0], WAVELENGTH), WAVELENGTH
    )
    fine = Plane(tuple(3 * n for n in window), tuple(p / 3 for p in plane.pitch))
    focus = optics.lens.focus_distance - separation
    psf = PSFOperator(optics, focus, WAVELENGTH, fine, tol=1e-3)(shown)
    # The middle of every three samples lies on a sample of the design grid.
    blocks = torch.nn.functional.pad(psf, (1, 0, 1, 0))[:-1, :-1].unfold(0, 3, 3).unfold(1, 3, 3)
    bright = target > 0.02 * target.max()
    assert found.quality.efficiency == pytest.approx(
        float(blocks.sum((-2, -1))[bright].sum()), abs=0.01
    )
    assert found.quality.efficiency < fill_factor * found.quality.steered_share
