"""The grid of design and judgement, and what is asked for on it."""

import math
import re

import numpy as np
import pytest
import torch
from judges import positions, relative
from judges.retrieval import (
    PITCH,
    WAVELENGTH,
    camera,
    ring,
    stop_share,
    tensor,
    whole_far_field,
)

from optics.camera import Camera, Lens
from optics.camera.stop import Circle, Stop
from optics.plane import Plane
from optics.retrieval import design_plane, window_for_reach
from optics.retrieval.goal import RetrievalGoal, far_field_length
from optics.slm import PanelMap

CAMERA = camera((60, 64), stop=55.0)
PLANE = design_plane(CAMERA, WAVELENGTH, (45, 50))
TARGET = tensor(ring((45, 50), 13, 2))
IMAGE_DISTANCE = 1 / (1 / 0.125 - 1 / 2.0)


def largest_prime(n: int) -> int:
    factor = 2
    while n > 1:
        if n % factor == 0:
            n //= factor
        else:
            factor += 1
    return factor


@pytest.mark.parametrize("side", [1, 2, 7, 15, 64, 97, 101, 127, 128, 129, 240, 1009, 1920, 2999])
def test_the_far_field_is_twice_as_fine_as_nyquist_and_fast(side):
    for shape in ((side, 1 + side // 2), (1 + side // 2, side)):
        length = far_field_length(camera(shape))
        assert length >= 2 * side
        assert length <= 1.2 * max(2 * side, 10)
        assert length == 2 or largest_prime(length) <= 5


def test_full_hd_wastes_nothing():
    assert far_field_length(camera((1080, 1920))) == 3840
    assert far_field_length(camera((1080, 1920)), 4) == 7680


def test_the_design_grid_is_a_fourier_grid():
    """wavelength z / (length x pitch), z by the thin-lens equation for 2 m."""
    pitch = WAVELENGTH * IMAGE_DISTANCE / (128 * PITCH)
    assert PLANE.pitch == pytest.approx((pitch, pitch), rel=1e-12)
    assert PLANE.shape == (45, 50)
    assert design_plane(CAMERA, WAVELENGTH, (3, 4), 4).pitch == pytest.approx((pitch / 2,) * 2)


@pytest.mark.parametrize("reach", [1e-6, 100e-6, 500e-6, 700e-6])
def test_a_window_holds_its_target_and_a_dark_margin(reach):
    optics = camera((200, 240))
    rows, columns = window_for_reach(optics, WAVELENGTH, reach)
    plane = design_plane(optics, WAVELENGTH, (rows, columns))
    for axis in (0, 1):
        seen = plane.coordinates(axis)
        assert float(seen.min()) <= -1.1 * reach
        assert float(seen.max()) >= 1.1 * reach
    assert rows == columns >= 128


def test_a_target_beyond_the_panels_reach_is_refused_with_the_farthest():
    """The steepest grating has two pixels a period: wavelength z / (2 pitch)."""
    farthest = WAVELENGTH * IMAGE_DISTANCE / (2 * PITCH)
    with pytest.raises(ValueError, match=r"reaches 2000 µm .* at most; choose a smaller") as caught:
        window_for_reach(CAMERA, WAVELENGTH, 2e-3)
    advised = float(re.search(r"light to (\S+) µm at most", str(caught.value))[1]) * 1e-6
    assert 0.99 * farthest < advised <= farthest
    assert window_for_reach(CAMERA, WAVELENGTH, advised) == (128, 128)


def test_bad_questions_about_the_grid_are_refused_by_name():
    with pytest.raises(ValueError, match=r"window is \(3, 129\); .* 128 samples at most: choose a"):
        design_plane(CAMERA, WAVELENGTH, (3, 129))
    assert design_plane(CAMERA, WAVELENGTH, (128, 128)).shape == (128, 128)
    for wavelength in (0.0, -1.0, math.nan, math.inf):
        with pytest.raises(ValueError, match=r"wavelength is .* must be positive and finite"):
            design_plane(CAMERA, wavelength, (4, 4))
    for reach in (0.0, -1e-6, math.nan, math.inf):
        with pytest.raises(ValueError, match=r"reach is .* must be positive and finite"):
            window_for_reach(CAMERA, WAVELENGTH, reach)


# What is asked for


def test_the_stop_leaves_the_panel_its_open_area():
    amplitude = RetrievalGoal(CAMERA, TARGET, PLANE, WAVELENGTH).amplitude
    truth = stop_share((60, 64), 55.0)
    assert np.abs(amplitude.numpy() - truth).max() < 0.01
    assert relative(amplitude, truth) < 2e-3


def test_the_amplitude_of_light_is_the_root_of_its_irradiance():
    """A Gaussian beam, given pixel by pixel; a slope of few cells is straight between them.

    In units of its mean over the panel.
    """
    y, x = positions(60, 1.0)[:, None], positions(64, 1.0)[None, :]
    beam = 7 * np.exp(-(y**2 + (x - 9) ** 2) / 30**2)
    lit = camera((60, 64), stop=55.0, illumination=PanelMap(beam))
    amplitude = RetrievalGoal(lit, TARGET, PLANE, WAVELENGTH).amplitude
    truth = stop_share((60, 64), 55.0) * np.sqrt(beam / beam.mean())
    assert relative(amplitude, truth) < 2e-3
    slope = camera((60, 64), illumination=PanelMap(np.array([[1.0, 3.0]])))
    amplitude = RetrievalGoal(slope, TARGET, PLANE, WAVELENGTH).amplitude.numpy()
    assert amplitude[:, 31:33].mean() == pytest.approx(1, rel=1e-3)
    assert amplitude[:, 0].mean() == pytest.approx(math.sqrt(0.5))


def test_the_intensity_has_all_the_light_there_is():
    """By Parseval, from a whole FFT of the panel; the target's scale doesn't count."""
    truth = (np.abs(whole_far_field(stop_share((60, 64), 55.0), 128)) ** 2).sum()
    for scale in (1.0, 1e-9, 1e12):
        goal = RetrievalGoal(CAMERA, scale * TARGET, PLANE, WAVELENGTH)
        assert float(goal.target_intensity.double().sum()) == pytest.approx(truth, rel=2e-3)
        assert goal.power == pytest.approx(truth, rel=2e-3)
        assert (
            relative(goal.target_intensity / goal.target_intensity.sum(), TARGET / TARGET.sum())
            < 1e-6
        )


def test_a_panel_without_light_is_refused():
    """Lit where the stop covers it, or behind the obscuration of a mirror lens."""
    corner = np.zeros((60, 64))
    corner[0, 0] = 1.0
    mirror = Lens(f_number=6.25, stop=Stop(Circle(), obscurations=(Circle(0.5),)))
    behind = Camera(CAMERA.panel, mirror)
    for optics in (camera((60, 64), stop=30.0, illumination=PanelMap(corner)), behind):
        with pytest.raises(ValueError, match=r"no light reaches the panel .* open the stop"):
            RetrievalGoal(optics, TARGET, PLANE, WAVELENGTH)


@pytest.mark.parametrize(
    ("target", "words"),
    [
        (torch.zeros(45, 50), "target must be finite, nowhere negative and somewhere positive"),
        (torch.full((45, 50), math.nan), "target must be finite"),
        (torch.ones(45, 50).index_fill(1, torch.tensor([7]), math.inf), "target must be finite"),
        (torch.ones(45, 50).index_fill(0, torch.tensor([2]), -1e-9), "nowhere negative"),
        (torch.ones(50, 45), r"target is \(50, 45\); its plane has \(45, 50\) samples"),
        (torch.ones(1, 45, 50), r"target is \(1, 45, 50\)"),
    ],
)
def test_a_target_that_no_psf_can_have_is_refused(target, words):
    with pytest.raises(ValueError, match=words):
        RetrievalGoal(CAMERA, target, PLANE, WAVELENGTH)


def test_a_plane_of_another_grid_is_refused():
    y, x = PLANE.pitch
    for pitch in ((y * 1.01, x), (y, x * 1.01)):
        with pytest.raises(ValueError, match=r"plane's pitch is .* take the plane from") as caught:
            RetrievalGoal(CAMERA, TARGET, Plane(PLANE.shape, pitch), WAVELENGTH)
        assert f"{pitch[0] * 1e6:.6g} x {pitch[1] * 1e6:.6g} µm" in str(caught.value)
    aside = Plane(PLANE.shape, PLANE.pitch, (0.0, 1e-6))
    with pytest.raises(ValueError, match=r"plane's centre is \(0\.0, 1e-06\) m; .* add a blaze"):
        RetrievalGoal(CAMERA, TARGET, aside, WAVELENGTH)
    wide = Plane((129, 3), PLANE.pitch)
    with pytest.raises(ValueError, match=r"window is \(129, 3\)"):
        RetrievalGoal(CAMERA, torch.ones(129, 3), wide, WAVELENGTH)
    with pytest.raises(ValueError, match=r"wavelength is -1 m; it must be positive"):
        RetrievalGoal(CAMERA, TARGET, PLANE, -1.0)
