"""Targets that are made of spots: what counts as one, and how even they become."""

import numpy as np
import pytest
import torch
from judges.retrieval import (
    WAVELENGTH,
    camera,
    direct_sums,
    dots,
    light,
    merits,
    ring,
    seeded,
    spiral,
    tensor,
)

from optics.progress import Progress
from optics.retrieval import design_plane, retrieve
from optics.retrieval.gerchberg_saxton import find_spots, weighted_spots_field
from optics.retrieval.goal import RetrievalGoal
from optics.retrieval.superpixel import Superpixels

SHAPE, WINDOW, LENGTH = (55, 97), (81, 90), 200
CAMERA = camera(SHAPE)
PLANE = design_plane(CAMERA, WAVELENGTH, WINDOW)

# Rows and columns around the axis; no lattice, so that no symmetry helps.
PLACES = [
    (-30, -41), (-22, 7), (-13, 35), (-2, -20), (0, 0), (9, 17), (17, -33), (27, 40), (38, -7),
]  # fmt: skip
UNEQUAL = (1.0, 0.5, 0.3, 0.2, 0.1, 0.07, 0.05, 0.4, 0.8)


def single_samples(heights=(1.0,) * 9) -> np.ndarray:
    target = np.zeros(WINDOW)
    for (y, x), height in zip(PLACES, heights, strict=True):
        target[40 + y, 45 + x] = height
    return target


def goal_of(target: np.ndarray) -> RetrievalGoal:
    return RetrievalGoal(CAMERA, tensor(target), PLANE, WAVELENGTH)


def powers(phase: np.ndarray) -> np.ndarray:
    """At the spots' places, share of all light on one sample, by direct sums."""
    far = direct_sums(np.exp(1j * phase.astype(float)), LENGTH, WINDOW)
    at = np.array([abs(far[40 + y, 45 + x]) ** 2 for y, x in PLACES])
    return at / (phase.size * LENGTH**2)


@pytest.mark.parametrize("heights", [(1.0,) * 9, UNEQUAL])
@pytest.mark.parametrize("width", [0, 1.0, 2.0])
def test_spots_are_found_with_their_shares(heights, width):
    """Single samples and Gaussian dots; a dim one is a spot as well as a bright one."""
    target = dots(WINDOW, PLACES, width, heights=heights) if width else single_samples(heights)
    rows, columns, shares = find_spots(goal_of(1e3 * target))
    order = np.lexsort((columns, rows))
    found = list(zip(rows.numpy()[order] - 40, columns.numpy()[order] - 45, strict=True))
    assert found == PLACES
    assert shares.numpy()[order] == pytest.approx(np.array(heights) / sum(heights), rel=0.05)
    assert float(shares.sum()) == pytest.approx(1)


def test_faint_dirt_is_no_spot():
    target = single_samples()
    target[3, 3] = 0.01
    assert len(find_spots(goal_of(target))[0]) == 9


@pytest.mark.parametrize(
    "target", [ring(WINDOW, 25, 2), spiral(WINDOW, 30, 2), np.ones(WINDOW), dots(WINDOW, PLACES, 6)]
)
def test_what_is_larger_than_a_spot_is_refused(target):
    with pytest.raises(ValueError, match=r"a part \d+ samples wide, and a spot has \d+ at most"):
        find_spots(goal_of(target))


@pytest.mark.parametrize("heights", [(1.0,) * 9, UNEQUAL])
def test_weights_make_the_spots_what_they_shall_be(heights):
    """Powers over shares by direct sums, against Gerchberg-Saxton from the same start."""
    target = single_samples(heights)
    pixels = Superpixels(goal_of(target), 1)
    even = weighted_spots_field(pixels, 60, seeded(), Progress())
    got = powers(pixels.pixel_phases(even).numpy()) / np.array(heights)
    plain = retrieve(
        CAMERA, tensor(target), PLANE, WAVELENGTH, method="gerchberg-saxton", iterations=60,
        start="random", generator=seeded(),
    )  # fmt: skip
    usual = powers(plain.phases[0].numpy()) / np.array(heights)
    assert got.std() / got.mean() < 0.01
    assert got.std() / got.mean() < 0.2 * usual.std() / usual.mean()
    # On the axis and beside, a random superposition would leave pi / 4 of the light.
    diffraction_limited = SHAPE[0] * SHAPE[1] / LENGTH**2
    assert 0.7 < powers(pixels.pixel_phases(even).numpy()).sum() / diffraction_limited < 1


def test_the_field_is_dark_but_at_the_spots():
    pixels = Superpixels(goal_of(single_samples()), 1)
    field = weighted_spots_field(pixels, 3, seeded(), Progress())
    assert field.shape == WINDOW
    assert (field != 0).numpy().nonzero()[0].tolist() == sorted(40 + y for y, _ in PLACES)


@pytest.mark.parametrize("place", [(0, 0), (-13, 35), (-40, -45)])
def test_one_spot_is_a_blazed_grating(place):
    """All light, as far as a window's edge: |sum|² over pixels² is 1."""
    target = np.zeros(WINDOW)
    target[40 + place[0], 45 + place[1]] = 5.0
    found = retrieve(
        CAMERA, tensor(target), PLANE, WAVELENGTH, method="weighted", iterations=3,
        generator=seeded(),
    )  # fmt: skip
    far = direct_sums(np.exp(1j * found.phases[0].double().numpy()), LENGTH, WINDOW)
    at = np.abs(far[40 + place[0], 45 + place[1]]) ** 2
    assert at / (SHAPE[0] * SHAPE[1]) ** 2 > 1 - 1e-6


def test_wide_dots_get_their_light_too():
    """On superpixels, with eight bits: the dots' brighter halves are even within 5 %."""
    target = dots(WINDOW, PLACES, 1.5)
    found = retrieve(
        CAMERA, tensor(target), PLANE, WAVELENGTH, method="weighted", iterations=40,
        generator=seeded(),
    )  # fmt: skip
    psf = light(found.phases.numpy(), LENGTH, WINDOW)
    bright = [psf[38 + y : 43 + y, 43 + x : 48 + x].sum() for y, x in PLACES if (y, x) != (0, 0)]
    assert np.std(bright) / np.mean(bright) < 0.05
    assert merits(psf, target)[0] > 0.6


def test_the_seed_alone_decides():
    pixels = Superpixels(goal_of(single_samples()), 1)
    first, again, other = (
        weighted_spots_field(pixels, 5, seeded(s), Progress()) for s in (1, 1, 2)
    )
    assert torch.equal(first, again)
    assert not torch.allclose(first, other)
