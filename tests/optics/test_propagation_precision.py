"""Which arithmetic a way through free space needs, and which tolerances no arithmetic keeps."""

import math
import re
from fractions import Fraction

import numpy as np
import pytest
import torch

from optics.accuracy import ToleranceError
from optics.propagation.propagator import phase_rounding, working_precision


@pytest.mark.parametrize("turns", [1e3, 1e6, 1e9])
def test_a_phase_is_off_by_no_more_than_its_rounding(turns):
    """x² / (wavelength z), as propagators prepare it, against rational numbers."""
    rng = np.random.default_rng(0)
    places = rng.uniform(0.5, 1.0, 400)
    scale = 1 / turns
    off = [
        abs(float(Fraction(x * x / scale) - Fraction(x) * Fraction(x) / Fraction(scale)))
        for x in places
    ]
    assert phase_rounding(turns) / 20 <= 2 * math.pi * max(off) <= phase_rounding(turns)


@pytest.mark.parametrize(
    ("tol", "share", "double", "dtype"),
    [
        (1e-3, 0.0, False, torch.complex64),
        (1e-3, 0.0, True, torch.complex128),
        # Half of the tolerance, at most, is single precision's: 1e-6.
        (2.2e-6, 0.0, False, torch.complex64),
        (1.8e-6, 0.0, False, torch.complex128),
        # Sampling has taken nine tenths.
        (2e-5, 0.9, False, torch.complex64),
        (8e-6, 0.9, False, torch.complex128),
    ],
)
def test_single_precision_serves_while_it_takes_half_of_the_tolerance(tol, share, double, dtype):
    found, error = working_precision(tol, 10.0, share, double=double)
    assert found is dtype
    assert 0 < error < tol * (1 - share)


def test_single_precision_is_trusted_with_what_it_does():
    """Two transforms of random light there and back, as FIELD32_ARITHMETIC is meant."""
    _, error = working_precision(1e-3, 10.0)
    field = torch.from_numpy(np.random.default_rng(0).normal(size=(512, 512, 2)) @ (1, 1j))
    phase = torch.polar(
        torch.ones(512, 512, dtype=torch.float64), torch.rand(512, 512, dtype=torch.float64) * 6
    )

    def there_and_back(light: torch.Tensor) -> torch.Tensor:
        return torch.fft.ifft2(torch.fft.fft2(light) * phase.to(light.dtype))

    exact = there_and_back(field)
    found = there_and_back(field.to(torch.complex64)).to(torch.complex128)
    measured = float(torch.linalg.vector_norm(found - exact) / torch.linalg.vector_norm(exact))
    assert error / 20 <= measured <= error


def test_many_turns_leave_more_than_arithmetic_does():
    assert working_precision(1e-2, 1e12)[1] == pytest.approx(phase_rounding(1e12))


@pytest.mark.parametrize("share", [0.0, 0.75])
def test_a_tolerance_below_the_floor_is_refused_with_one_that_is_kept(share):
    with pytest.raises(ToleranceError, match="ask for tol") as refused:
        working_precision(1e-5, 1e12, share)
    advised = float(re.search(r"ask for tol ([0-9.e+-]+)", str(refused.value))[1])
    dtype, error = working_precision(advised, 1e12, share)
    assert error < advised * (1 - share)
    assert dtype is torch.complex64
    with pytest.raises(ToleranceError):
        working_precision(advised / 1.5, 1e12, share)
