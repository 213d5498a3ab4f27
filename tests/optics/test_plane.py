import pytest
import torch

from optics.plane import Plane, centred_crop, centred_pad, origin_to_centre, origin_to_corner

SIZES = [1, 2, 3, 4, 7, 8]


def point_at_origin(rows: int, columns: int) -> torch.Tensor:
    array = torch.zeros(rows, columns)
    array[rows // 2, columns // 2] = 1
    return array


@pytest.mark.parametrize("n", SIZES)
def test_sample_n_over_2_lies_at_the_centre(n):
    """The convention itself: index n // 2 is the origin, neighbours are a pitch away."""
    plane = Plane((n, 5), (2e-6, 3e-6), (1e-3, -2e-3))
    y, x = plane.coordinates(0), plane.coordinates(1)
    assert y[n // 2] == 1e-3
    assert x[2] == -2e-3
    assert x[3].item() == pytest.approx(-2e-3 + 3e-6, abs=1e-15)
    assert len(y) == n


def test_mesh_is_a_column_and_a_row():
    y, x = Plane((3, 4), (1.0, 2.0)).mesh()
    assert y.tolist() == [[-1.0], [0.0], [1.0]]
    assert x.tolist() == [[-4.0, -2.0, 0.0, 2.0]]


@pytest.mark.parametrize("large", SIZES)
@pytest.mark.parametrize("small", SIZES)
def test_cropping_and_padding_keep_the_origin(small, large):
    if small > large:
        small, large = large, small
    wide, narrow = point_at_origin(large, large + 1), point_at_origin(small, small + 1)
    assert torch.equal(centred_crop(wide, narrow.shape), narrow)
    assert torch.equal(centred_pad(narrow, wide.shape), wide)


@pytest.mark.parametrize("rows", SIZES)
@pytest.mark.parametrize("columns", SIZES)
def test_the_origin_moves_to_the_corner_and_back(rows, columns):
    array = torch.arange(rows * columns, dtype=torch.float64).reshape(rows, columns)
    corner = origin_to_corner(array)
    assert corner[0, 0] == array[rows // 2, columns // 2]
    assert torch.equal(origin_to_centre(corner), array)


@pytest.mark.parametrize("factor", [1, 2, 3])
@pytest.mark.parametrize("n", [4, 5])
def test_a_finer_plane_has_the_same_centre_and_field(n, factor):
    plane = Plane((n, n + 1), (6e-6, 3e-6), (1e-3, 0.0))
    fine = plane.with_finer_pitch(factor)
    assert fine.centre == plane.centre
    for axis in (0, 1):
        field = plane.shape[axis] * plane.pitch[axis]
        assert fine.shape[axis] * fine.pitch[axis] == pytest.approx(field)
        assert fine.shape[axis] == factor * plane.shape[axis]


@pytest.mark.parametrize("shape", [(0, 4), (4, -1)])
def test_a_plane_without_samples_is_refused(shape):
    with pytest.raises(ValueError, match=r"shape .* must be at least 1"):
        Plane(shape, (1e-6, 1e-6))


@pytest.mark.parametrize("pitch", [0.0, -1e-6, float("nan")])
def test_a_pitch_that_is_not_positive_is_refused(pitch):
    with pytest.raises(ValueError, match=r"pitch .* must be positive"):
        Plane((4, 4), (1e-6, pitch))


def test_a_refinement_below_one_is_refused():
    with pytest.raises(ValueError, match=r"factor is 0; .*at least 1"):
        Plane((4, 4), (1e-6, 1e-6)).with_finer_pitch(0)


def test_cropping_to_more_and_padding_to_less_are_refused():
    array = torch.zeros(4, 4)
    with pytest.raises(ValueError, match=r"cannot crop \(4, 4\) to the larger shape \(5, 4\)"):
        centred_crop(array, (5, 4))
    with pytest.raises(ValueError, match=r"cannot pad \(4, 4\) to the smaller shape \(4, 3\)"):
        centred_pad(array, (4, 3))
