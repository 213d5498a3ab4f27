import math

import numpy as np
import pytest

from optics.plane import Plane
from optics.targets import ring

PLANE = Plane((101, 120), (2e-6, 2e-6))


def test_a_ring_sums_to_one_and_peaks_at_its_radius():
    target = ring(PLANE, 40e-6, 5e-6).numpy()
    assert target.sum() == pytest.approx(1)
    assert target.min() >= 0
    assert abs(target[50, 60:].argmax() * 2e-6 - 40e-6) <= 2e-6
    # exp(-1/2) at one standard deviation, here a sample 4 um off with width 4 um.
    narrow = ring(PLANE, 40e-6, 4e-6).numpy()
    assert narrow[50, 60 + 22] / narrow[50, 60 + 20] == pytest.approx(math.exp(-0.5))


def test_a_ring_is_round():
    """Samples 30 um off on each axis lie at the same radius as (18, 24) um."""
    target = ring(PLANE, 40e-6, 5e-6).numpy()
    same = [target[50 + 15, 60], target[50, 60 - 15], target[50 + 9, 60 + 12]]
    assert np.allclose(same, same[0])


def test_a_ring_of_radius_zero_is_a_gaussian_spot():
    """Second moment of a two-dimensional Gaussian: 2 sigma²."""
    target = ring(PLANE, 0.0, 8e-6).numpy()
    y, x = np.meshgrid((np.arange(101) - 50) * 2e-6, (np.arange(120) - 60) * 2e-6, indexing="ij")
    assert (target * (y**2 + x**2)).sum() == pytest.approx(2 * (8e-6) ** 2, rel=1e-6)


def test_a_ring_that_does_not_fit_is_refused_with_the_window():
    with pytest.raises(ValueError, match=r"radius 95 µm with width 5 µm doesn't fit .* 100 µm; ch"):
        ring(PLANE, 95e-6, 5e-6)
    assert ring(PLANE, 89e-6, 5e-6).sum() == pytest.approx(1)


@pytest.mark.parametrize(("radius", "width"), [(-1e-6, 1e-6), (1e-6, 0.0), (math.nan, 1e-6)])
def test_sizes_that_are_not_positive_are_refused(radius, width):
    with pytest.raises(ValueError, match=r"radius .* and width .* must be"):
        ring(PLANE, radius, width)


def test_a_ring_thinner_than_the_samples_is_refused():
    """Between samples it would vanish: 0 / 0."""
    with pytest.raises(ValueError, match=r"width .*; choose"):
        ring(PLANE, 41e-6, 1e-9)
