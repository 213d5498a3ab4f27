"""A PSF's origin in the corner is found by its wrapped light, and nothing else is taken for it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d, zoom

from labapp.accuracy.blurs import disk
from optics.inverse.psf_origin import has_origin_in_corner

KERNELS = Path(__file__).parents[3] / "shared/data/psf/csf_kernels"


def ring(outer, inner):
    return np.clip(disk(outer) * outer**2 - np.pad(disk(inner), outer - inner) * inner**2, 0, None)


def shake(seed, side=25):
    """A hand's path, drawn finely and summed to pixels."""
    rng = np.random.default_rng(seed)
    path = np.cumsum(gaussian_filter1d(rng.standard_normal((400, 2)), 40, axis=0), 0)
    path = (path - path.mean(0)) / np.abs(path - path.mean(0)).max() * (side / 2 - 3) + side / 2
    kernel, *_ = np.histogram2d(*path.T, bins=side, range=[[0, side]] * 2)
    return kernel


def line(side, down, along):
    kernel = np.zeros((side, side))
    for step in np.linspace(-1, 1, 8 * side):
        kernel[round(side // 2 + step * down), round(side // 2 + step * along)] += 1
    return kernel


def gaussian(width, side):
    axis = np.arange(side) - side // 2
    return np.exp(-(axis[:, None] ** 2 + axis**2) / (2 * width**2))


def cubic(side, strength):
    """The PSF of a cubic phase mask, by the Fourier transform of its pupil."""
    axis = np.arange(4 * side) / (4 * side) * 4 - 2
    pupil = (abs(axis) <= 0.5) * np.exp(1j * strength * 8 * axis**3)
    field = np.fft.fftshift(abs(np.fft.fft(pupil)) ** 2)[3 * side // 2 : 5 * side // 2]
    return np.outer(field, field)


SOUND = {
    **{f"disk {r}": disk(r) for r in (1.0, 2.5, 5.3, 9.0)},
    **{f"shake {n}": shake(n) for n in range(8)},
    **{f"line {d} {a}": line(21, d, a) for d, a in ((0, 6), (6, 0), (5, 5), (-5, 5), (2, 7))},
    **{f"gaussian {w} {n}": gaussian(w, n) for w in (0.7, 1.5, 3.0) for n in (24, 25)},
    "ring": ring(9, 7), "donut": ring(9, 4), "cubic": cubic(32, 4.0), "even": zoom(disk(5.3), 2),
}  # fmt: skip


def centred(psf, rows, columns):
    """The PSF in a larger array, its index n // 2 at that of the array."""
    before = rows // 2 - psf.shape[0] // 2, columns // 2 - psf.shape[1] // 2
    sides = zip(before, (rows, columns), psf.shape, strict=True)
    return np.pad(psf, [(first, whole - n - first) for first, whole, n in sides])


@pytest.mark.parametrize("room", [3, 10, 33])
@pytest.mark.parametrize("noise", [0, 0.01])
def test_sound_psfs_are_left_and_stored_ones_are_found(room, noise):
    rng = np.random.default_rng(room)
    for name, psf in SOUND.items():
        for more in (0, 1):
            whole = centred(psf, psf.shape[0] + room, psf.shape[1] + room + more)
            whole = whole + noise * whole.max() * rng.standard_normal(whole.shape)
            assert not has_origin_in_corner(whole), name
            assert has_origin_in_corner(np.fft.ifftshift(whole)), name


def test_psfs_that_are_off_or_cut_are_left():
    for name, psf in SOUND.items():
        whole = np.pad(psf, 20)
        half = [n // 2 for n in psf.shape]
        for shift in ((5, 5), (0, -12), (-20, 20), (20, 20)):
            assert not has_origin_in_corner(np.roll(whole, shift, (0, 1))), name
        assert not has_origin_in_corner(psf[half[0] :, half[1] :]), name
        assert not has_origin_in_corner(psf[half[0] :]), name


def test_what_looks_alike_is_left():
    side = 31
    y, x = np.mgrid[:side, :side]

    def spots(places, radius):
        return sum(((y - a) ** 2 + (x - b) ** 2 <= radius**2).astype(float) for a, b in places)

    far = side - 1
    for radius in (0.5, 1.3, 2.3, 3.3):
        for inset in (0, 1, 3):
            near, last = int(radius) + inset, far - int(radius) - inset
            for places in (
                [(near, near), (last, last)], [(near, near), (last, near)],
                [(near, near), (near, last)], [(near, last), (last, near)], [(near, near)],
                [(near, near), (near, last), (last, near), (last, last)],
            ):  # fmt: skip
                assert not has_origin_in_corner(spots(places, radius)), (radius, inset, places)
    frame = np.ones((side, side))
    frame[1:-1, 1:-1] = 0
    assert not has_origin_in_corner(frame)
    for touching in (disk(15.0), ring(15, 13), line(side, 15, 0), line(side, 15, 15), frame.T,
                     np.ones((side, side)), np.eye(1, 9), np.ones((1, 9)), np.ones((1, 1)),
                     np.zeros((5, 5))):  # fmt: skip
        assert not has_origin_in_corner(touching)


@pytest.mark.shared
@pytest.mark.skipif(not KERNELS.is_dir(), reason="the kernels aren't beside the checkout")
def test_real_kernels_are_left_and_found():
    kernels = [np.loadtxt(one) for one in sorted(KERNELS.glob("*.dlm"))]
    assert len(kernels) == 20
    for kernel in kernels:
        assert not has_origin_in_corner(kernel)
        assert has_origin_in_corner(np.fft.ifftshift(np.pad(kernel, 4)))
