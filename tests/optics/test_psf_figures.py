"""Dispersion power by the printed sum, and Fourier coverage of PSFs whose MTF is known."""

import math

import numpy as np
import pytest
import torch
from scipy.special import j0

from optics.multispectral import dispersion_power, fourier_coverage


def summed(psfs):
    """Eq. A.1 in loops, bands counted from 1."""
    bands = len(psfs)
    total = 0.0
    for n in range(2, bands):
        before, own, after = (psfs[k - 1] for k in (n - 1, n, n + 1))
        total += np.abs(own).sum() / (np.abs(after - own).sum() + np.abs(own - before).sum())
    return total / bands


def pulses(*places, side=9):
    psfs = np.zeros((len(places), side, side))
    for psf, (y, x) in zip(psfs, places, strict=True):
        psf[y, x] = 1.0
    return psfs


def test_the_dispersion_power_is_the_printed_sum():
    psfs = np.random.default_rng(0).random((6, 5, 7))
    assert dispersion_power(psfs) == pytest.approx(summed(psfs), rel=1e-12)
    assert dispersion_power(torch.from_numpy(3 * psfs)) == pytest.approx(summed(psfs), rel=1e-12)


def test_psfs_apart_have_the_least_dispersion_power_and_equal_ones_an_infinite_one():
    apart = pulses((4, 1), (4, 3), (4, 5), (4, 7))
    assert dispersion_power(apart) == pytest.approx((4 - 2) / (4 * 4))
    near = 0.9 * pulses((4, 4), (4, 4), (4, 4), (4, 4)) + 0.1 * apart
    assert dispersion_power(near) > dispersion_power(apart)
    assert dispersion_power(pulses((4, 4), (4, 4), (4, 4))) == math.inf


def test_a_point_covers_everything():
    found = fourier_coverage(pulses((4, 4), (2, 7)))
    for figure in (found.least_mtf, found.mean_mtf, found.isotropy):
        assert figure.numpy() == pytest.approx([1, 1], abs=1e-12)
    assert found.similarity == pytest.approx(1, abs=1e-12)


def test_two_points_transfer_as_a_cosine_along_one_axis():
    """MTF |cos(π f d)| for a distance d of 2 pixels, by the sum over all frequencies up to 0.5."""
    psfs = pulses((4, 3), (4, 4))
    psfs[0, 4, 5] = 1.0
    found = fourier_coverage(psfs, period=64)
    f = np.fft.fftfreq(64)
    inside = np.hypot(f[:, None], f) <= 0.5
    mtf = np.abs(np.cos(2 * np.pi * np.broadcast_to(f, (64, 64))))[inside]
    assert found.least_mtf.numpy() == pytest.approx([mtf.min(), 1], abs=1e-9)
    assert found.mean_mtf.numpy() == pytest.approx([mtf.mean(), 1], rel=1e-9)
    assert float(found.isotropy[0]) < 0.9
    both = (mtf + 1) ** 2 / (2 * (mtf**2 + 1))
    assert found.similarity == pytest.approx(both.mean(), rel=1e-9)


def test_a_ring_is_isotropic_and_transfers_as_a_bessel_function():
    at = np.arange(-20, 21)
    far = np.hypot(at[:, None], at)
    ring = np.exp(-((far - 8) ** 2) / (2 * 0.8**2))
    found = fourier_coverage(ring[None], period=64)
    f = np.fft.fftfreq(64)
    length = np.hypot(f[:, None], f)
    length = length[length <= 0.5]
    ideal = np.abs(j0(2 * np.pi * 8 * length)) * np.exp(-2 * (np.pi * 0.8 * length) ** 2)
    assert float(found.mean_mtf[0]) == pytest.approx(ideal.mean(), rel=0.05)
    spots = pulses((20, 12), side=41)
    spots[0, 20, 28] = 1.0
    assert float(found.isotropy[0]) > float(fourier_coverage(spots, period=64).isotropy[0])


def test_the_place_and_the_sum_of_a_psf_dont_matter():
    psfs = np.random.default_rng(1).random((2, 9, 9))
    one = fourier_coverage(psfs, period=32)
    other = fourier_coverage(5 * np.pad(psfs, ((0, 0), (3, 0), (0, 2))), period=32)
    assert other.mean_mtf.numpy() == pytest.approx(one.mean_mtf.numpy(), rel=1e-9)
    assert other.isotropy.numpy() == pytest.approx(one.isotropy.numpy(), rel=1e-9)


@pytest.mark.parametrize("function", [dispersion_power, fourier_coverage])
@pytest.mark.parametrize(
    "psfs", [np.ones((3, 3)), np.zeros((3, 3, 3)), np.full((3, 2, 2), np.nan), np.ones((0, 2, 2))]
)
def test_bad_psfs_are_refused(function, psfs):
    with pytest.raises(ValueError, match="psfs"):
        function(psfs)


def test_too_few_bands_and_too_short_a_period_are_refused():
    with pytest.raises(ValueError, match="2 bands"):
        dispersion_power(pulses((4, 4), (4, 5)))
    with pytest.raises(ValueError, match="period"):
        fourier_coverage(pulses((4, 4)), period=8)
