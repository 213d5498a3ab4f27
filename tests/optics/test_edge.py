import numpy as np
import pytest
import torch

from optics.camera import Lens
from optics.validation import accepts_numpy, require_finite, to_plain_numbers


@accepts_numpy
def doubled(x, *, by=None):
    assert isinstance(x, torch.Tensor)
    return 2 * x if by is None else (2 * x, by * x)


def test_numpy_goes_in_and_comes_out():
    answer = doubled(np.array([1.0, 2.0]))
    assert isinstance(answer, np.ndarray)
    assert answer.tolist() == [2.0, 4.0]


def test_tensors_stay_tensors_and_keep_their_gradient():
    x = torch.tensor([1.0, 2.0], requires_grad=True)
    doubled(x).sum().backward()
    assert x.grad.tolist() == [2.0, 2.0]


def test_tuples_and_keywords_are_converted_too():
    first, second = doubled(torch.ones(2), by=np.array([3.0, 4.0]))
    assert isinstance(first, np.ndarray)
    assert second.tolist() == [3.0, 4.0]


def test_a_read_only_array_is_accepted():
    array = np.ones(3)
    array.flags.writeable = False
    assert doubled(array).tolist() == [2.0, 2.0, 2.0]


def test_values_that_are_not_finite_are_counted():
    with pytest.raises(ValueError, match=r"frame has 2 NaN or infinite values of 4; give finite"):
        require_finite("frame", torch.tensor([1.0, float("nan"), float("inf"), 0.0]))
    require_finite("frame", torch.zeros(3))


def test_numbers_stand_for_every_tensor_in_a_description():
    length = torch.tensor(0.125, dtype=torch.float64, requires_grad=True)
    lens = Lens(length, 5.0, aberrations=((2, 0, torch.tensor(1e-7, dtype=torch.float64)),))
    plain = to_plain_numbers(lens)
    assert plain == Lens(0.125, 5.0, aberrations=((2, 0, 1e-7),))
    assert isinstance(plain.focal_length, float)
    assert isinstance(plain.aberrations[0][2], float)
    assert to_plain_numbers(plain) is plain
