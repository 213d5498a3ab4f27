"""Gerchberg-Saxton, judged by an independent FFT on a grid of its own."""

import math

import numpy as np
import pytest
import torch
from judges import positions

from optics.camera import Camera, Lens, Panel, Sensor
from optics.plane import Plane
from optics.progress import Cancelled, Progress
from optics.retrieval.gerchberg_saxton import STARTS, design_plane, gerchberg_saxton
from optics.targets import ring

WAVELENGTH = 550e-9
CAMERA = Camera(Panel(shape=(60, 64), pitch=40e-6), Lens(f_number=0.125 / 2.2e-3), Sensor())
PLANE = design_plane(CAMERA, WAVELENGTH, (61, 64))
TARGET = ring(PLANE, 18 * PLANE.pitch[0], 2 * PLANE.pitch[0])


def solve(iterations: int, start="quadratic", seed=1, **options) -> np.ndarray:
    return gerchberg_saxton(
        CAMERA, TARGET, PLANE, WAVELENGTH, iterations=iterations, start=start,
        generator=torch.Generator().manual_seed(seed), **options,
    ).numpy()  # fmt: skip


def stop() -> np.ndarray:
    """Share of each pixel inside the stop, from 40 x 40 points a pixel."""
    inner = ((np.arange(40) + 0.5) / 40 - 0.5) * 40e-6
    y = (positions(60, 40e-6)[:, None] + inner).ravel()
    x = (positions(64, 40e-6)[:, None] + inner).ravel()
    inside = y[:, None] ** 2 + x[None, :] ** 2 <= (1.1e-3) ** 2
    return inside.reshape(60, 40, 64, 40).mean((1, 3))


def far_field(phase: np.ndarray, length: int) -> np.ndarray:
    """Amplitude on a padded FFT grid with the origin in the middle."""
    field = np.zeros((length, length), dtype=complex)
    field[:60, :64] = stop() * np.exp(1j * phase)
    return np.abs(np.fft.fftshift(np.fft.fft2(field)))


def judged(phase: np.ndarray) -> tuple[float, float]:
    """Efficiency and speckle contrast on a grid four times the pupil's side."""
    light = far_field(phase, 256) ** 2
    r = np.hypot(positions(256, 0.5)[:, None], positions(256, 0.5)[None, :])
    target = np.exp(-((r - 18) ** 2) / (2 * 2**2))
    ratio = (light / target)[target > 0.5]
    return light[target > 0.02].sum() / light.sum(), ratio.std() / ratio.mean()


def test_the_design_grid_is_half_the_width_of_a_speckle():
    """wavelength z / (2 x 64 x 40 um), z by the thin-lens equation for 2 m."""
    z = 1 / (1 / 0.125 - 1 / 2.0)
    assert PLANE.pitch == pytest.approx((550e-9 * z / (2 * 64 * 40e-6),) * 2)
    assert PLANE.shape == (61, 64)


@pytest.mark.parametrize("start", STARTS)
def test_the_error_never_grows(start):
    """Theorem (Fienup 1982): | |F| - target | over the whole plane is non-increasing, which
    is the same as a non-decreasing overlap of |F| with the target's amplitude."""
    amplitude = np.zeros((128, 128))
    amplitude[64 - 30 : 64 + 31, 64 - 32 : 64 + 32] = np.sqrt(TARGET.numpy())
    overlap = [
        (far_field(solve(n, start), 128) * amplitude).sum() for n in (1, 2, 3, 4, 6, 10, 20, 40)
    ]
    assert (np.diff(overlap) >= -1e-5 * overlap[-1]).all()
    assert overlap[-1] > 1.01 * overlap[0]


@pytest.mark.parametrize(("start", "most"), [("quadratic", 0.5), ("random", 0.8)])
def test_the_light_goes_to_the_ring(start, most):
    """A neutral pattern sends almost nothing there; fully developed speckle has contrast 1."""
    efficiency, contrast = judged(solve(60, start))
    assert efficiency > 0.8
    assert contrast < most
    assert judged(np.zeros((60, 64)))[0] < 0.1


def test_the_seed_alone_decides_a_random_start():
    assert np.array_equal(solve(3, "random", 5), solve(3, "random", 5))
    assert not np.allclose(solve(3, "random", 5), solve(3, "random", 6))


def test_scaling_the_target_changes_nothing():
    scaled = gerchberg_saxton(
        CAMERA, 7 * TARGET, PLANE, WAVELENGTH, iterations=2, generator=torch.Generator()
    )
    assert np.abs(np.exp(1j * scaled.numpy()) - np.exp(1j * solve(2))).max() < 1e-3


def test_numpy_targets_give_numpy_patterns():
    phase = gerchberg_saxton(
        CAMERA, TARGET.numpy(), PLANE, WAVELENGTH, iterations=1, generator=torch.Generator()
    )
    assert isinstance(phase, np.ndarray)
    assert phase.shape == (60, 64)


def test_progress_is_reported_and_cancelling_stops():
    heard = []
    solve(4, progress=Progress(lambda f, m: heard.append((f, m))))
    assert [f for f, _ in heard] == pytest.approx([0, 0.25, 0.5, 0.75])
    assert heard[2][1] == "Gerchberg-Saxton 3/4"
    stopped = Progress()
    stopped.cancel()
    with pytest.raises(Cancelled):
        solve(4, progress=stopped)


@pytest.mark.parametrize(
    ("target", "words"),
    [
        (torch.zeros(61, 64), r"target .* somewhere positive"),
        (torch.full((61, 64), math.nan), r"target must be finite"),
        (torch.full((61, 64), math.inf), r"target must be finite"),
        (torch.ones(61, 64).index_fill(0, torch.tensor([2]), -1.0), r"nowhere negative"),
        (torch.ones(61, 1), r"target is \(61, 1\).*\(61, 64\)"),
    ],
)
def test_a_target_that_no_psf_can_have_is_refused(target, words):
    with pytest.raises(ValueError, match=words):
        gerchberg_saxton(
            CAMERA, target, PLANE, WAVELENGTH, iterations=1, generator=torch.Generator()
        )


def test_other_bad_arguments_are_refused_by_name():
    with pytest.raises(ValueError, match=r"iterations is 0; at least 1"):
        solve(0)
    with pytest.raises(ValueError, match=r"start is 'flat'; choose one of quadratic, random"):
        solve(1, "flat")
    with pytest.raises(ValueError, match=r"wavelength is 0 m; it must be positive"):
        gerchberg_saxton(CAMERA, TARGET, PLANE, 0.0, iterations=1, generator=torch.Generator())
    with pytest.raises(ValueError, match=r"wavelength is -1 m; it must be positive"):
        design_plane(CAMERA, -1.0, (4, 4))


def test_a_window_of_one_sample_is_solved_too():
    """All light to the axis: a constant phase, up to the last bits."""
    plane = Plane((1, 1), PLANE.pitch)
    phase = gerchberg_saxton(
        CAMERA, torch.ones(1, 1), plane, WAVELENGTH, iterations=2, generator=torch.Generator()
    ).numpy()[stop() > 0]
    assert np.abs(np.exp(1j * phase) - np.exp(1j * phase[0])).max() < 1e-3
