"""Pictures of few edges and the kernels that they tell, by what each must do whatever its form."""

import numpy as np
import pytest
import scipy.signal
import torch

from optics.inverse.kernel_search import StrongEdges

SIZE = (7, 5)
EDGE = 96


def drawing() -> np.ndarray:
    """Rectangles, whose edges run both ways, and a disc."""
    image = np.full((EDGE, EDGE), 0.2)
    image[20:50, 15:40] = 0.8
    image[35:80, 55:70] = 0.5
    y, x = np.mgrid[:EDGE, :EDGE]
    image[(y - 70) ** 2 + (x - 28) ** 2 < 150] = 0.9
    return image


def stroke() -> np.ndarray:
    kernel = np.zeros(SIZE)
    kernel[1:6, 1] = (1, 2, 3, 2, 1)
    kernel[4, 2:5] = (3, 2, 1)
    return kernel / kernel.sum()


def edges_of(image, known=None, size=SIZE) -> StrongEdges:
    known = np.ones(image.shape) if known is None else known
    return StrongEdges(torch.from_numpy(image), torch.from_numpy(known), size)


def delta(size=SIZE) -> torch.Tensor:
    kernel = torch.zeros(size, dtype=torch.float64)
    kernel[size[0] // 2, size[1] // 2] = 1
    return kernel


def noisy() -> np.ndarray:
    return drawing() + np.random.default_rng(0).normal(0, 0.02, (EDGE, EDGE))


def middle(image) -> np.ndarray:
    return np.asarray(image)[12:-12, 12:-12]


def test_a_picture_of_few_edges_has_lost_the_noise_and_kept_the_edges():
    found = edges_of(noisy()).estimate_picture(delta(), 4e-3)
    assert np.abs(middle(found) - middle(drawing())).std() < 0.5 * 0.02
    flat = np.abs(np.diff(middle(found), axis=0)) + np.abs(np.diff(middle(found), axis=1).mean())
    assert (flat < 0.02).mean() > 0.9


@pytest.mark.parametrize("turned", [np.transpose, np.flipud, np.fliplr])
def test_no_direction_is_favoured(turned):
    """Noise of columns is smoothed as that of rows is; left as right."""
    image = noisy()
    found = edges_of(image).estimate_picture(delta(), 4e-3).numpy()
    other = edges_of(np.ascontiguousarray(turned(image))).estimate_picture(delta(), 4e-3).numpy()
    assert np.abs(middle(turned(found)) - middle(other)).max() < 0.03
    assert np.abs(middle(turned(found)) - middle(other)).mean() < 3e-3


def test_light_edges_cost_more_than_they_bring_and_are_left_out():
    """An edge of height h between areas is kept where its length times h² of misfit is dearer."""
    image = np.full((EDGE, EDGE), 0.3)
    image[:, 48:] += 0.05
    low, high = (edges_of(image).estimate_picture(delta(), weight) for weight in (1e-5, 10.0))
    assert float(low[48, 60] - low[48, 36]) == pytest.approx(0.05, abs=0.005)
    assert np.ptp(middle(high)) < 0.02


def test_the_kernel_between_a_drawing_and_its_blurred_picture_is_found():
    blurred = scipy.signal.convolve2d(drawing(), stroke(), mode="same", boundary="symm")
    found = edges_of(blurred).estimate_kernel(torch.from_numpy(drawing()), delta(), 1e-8)
    assert np.abs(found.numpy() - stroke()).max() < 1e-3
    assert float(found.sum()) == pytest.approx(1)


def test_a_ridge_makes_a_kernel_flatter():
    blurred = scipy.signal.convolve2d(drawing(), stroke(), mode="same", boundary="symm")
    edges, picture = edges_of(blurred), torch.from_numpy(drawing())
    peaks = [
        float(edges.estimate_kernel(picture, delta(), ridge).max()) for ridge in (1e-8, 10.0, 1e3)
    ]
    assert peaks[0] > peaks[1] > peaks[2]


def test_what_was_not_measured_says_nothing():
    """Clipped pixels, whatever they hold, and edges whose light they would have had."""
    blurred = scipy.signal.convolve2d(drawing(), stroke(), mode="same", boundary="symm")
    known = np.ones(blurred.shape)
    known[30:36, 30:37] = 0
    wild = np.where(known > 0, blurred, 25.0)
    picture = torch.from_numpy(drawing())
    found, same = (
        edges_of(one, known).estimate_kernel(picture, delta(), 1e-8) for one in (wild, blurred)
    )
    assert torch.equal(found, same)
    assert np.abs(found.numpy() - stroke()).max() < 1e-2


def test_a_picture_without_edges_tells_no_kernel():
    start = torch.from_numpy(stroke())
    found = edges_of(drawing()).estimate_kernel(torch.full((EDGE, EDGE), 0.4).double(), start, 1e-3)
    assert torch.isfinite(found).all()
    assert float(found.sum()) == pytest.approx(1)
