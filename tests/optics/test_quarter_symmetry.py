"""Quarters of a plane against loops over its samples."""

import numpy as np
import pytest
import torch

from optics.quarter_symmetry import (
    crop_quarter,
    mirror_quarter,
    quarter_distances,
    quarter_shape,
)

SHAPES = [(4, 6), (5, 6), (4, 7), (5, 7), (1, 1), (1, 2), (2, 1)]


@pytest.mark.parametrize("shape", SHAPES)
def test_a_mirrored_quarter_has_its_samples_at_their_distances_from_the_centre(shape):
    rows, columns = quarter_shape(shape)
    quarter = torch.arange(rows * columns, dtype=torch.float64).reshape(rows, columns)
    whole = mirror_quarter(quarter, shape)
    assert whole.shape == shape
    for i in range(shape[0]):
        for j in range(shape[1]):
            # Twice the distance from the centre in samples is odd for even numbers of them.
            down, right = abs(2 * i - shape[0] + 1) // 2, abs(2 * j - shape[1] + 1) // 2
            assert whole[i, j] == quarter[down, right]
    assert torch.equal(crop_quarter(whole), quarter)


@pytest.mark.parametrize("shape", SHAPES)
def test_distances_are_those_from_the_centre_of_all_samples(shape):
    y, x = quarter_distances(shape, (2.0, 3.0))
    rows, columns = np.indices(shape)
    down = (rows - rows.mean()) * 2.0
    right = (columns - columns.mean()) * 3.0
    assert np.array_equal((y + 0 * x).numpy(), crop_quarter(torch.from_numpy(down)))
    assert np.array_equal((x + 0 * y).numpy(), crop_quarter(torch.from_numpy(right)))


def test_leading_axes_stay():
    quarters = torch.rand(3, 2, 2, 4, generator=torch.Generator().manual_seed(0))
    whole = mirror_quarter(quarters, (4, 7))
    assert whole.shape == (3, 2, 4, 7)
    assert torch.equal(whole[2, 1], mirror_quarter(quarters[2, 1], (4, 7)))


def test_the_gradient_of_a_sample_sums_over_its_images():
    quarter = torch.zeros(2, 2, dtype=torch.float64, requires_grad=True)
    weights = torch.arange(12, dtype=torch.float64).reshape(3, 4)
    (mirror_quarter(quarter, (3, 4)) * weights).sum().backward()
    truth = [[5 + 6, 4 + 7], [1 + 2 + 9 + 10, 0 + 3 + 8 + 11]]
    assert quarter.grad.tolist() == truth


def test_a_quarter_of_another_shape_is_refused():
    with pytest.raises(ValueError, match=r"quarter is \(2, 3\) samples; a quarter of \(5, 6\) has"):
        mirror_quarter(torch.zeros(2, 3), (5, 6))
