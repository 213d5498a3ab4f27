"""Convolution where picture and kernel overlap wholly, against SciPy's."""

import numpy as np
import pytest
import scipy.signal

from simulator.convolution import convolve_valid


@pytest.mark.parametrize(
    ("picture", "kernel"),
    [((30, 41), (5, 7)), ((9, 9), (9, 9)), ((16, 3), (1, 3))],
)
def test_it_is_the_sum_of_products(picture, kernel):
    rng = np.random.default_rng(0)
    light, spread = rng.random(picture), rng.random(kernel)
    expected = scipy.signal.convolve2d(light, spread, mode="valid")
    np.testing.assert_allclose(convolve_valid(light, spread), expected, rtol=1e-12, atol=1e-12)


def test_a_kernel_larger_than_the_picture_is_refused():
    with pytest.raises(ValueError, match="larger than picture"):
        convolve_valid(np.ones((4, 4)), np.ones((5, 3)))
