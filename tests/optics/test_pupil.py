import math
from dataclasses import replace

import numpy as np
import pytest
from judges import positions

from optics.camera import Camera, Lens, Panel
from optics.camera.pupil import (
    phase_step_per_pixel,
    pupil_amplitude,
    pupil_phase_on_panel,
    vergence_error,
)


def camera_with_stop(shape, pitch, diameter) -> Camera:
    return Camera(Panel(shape=shape, pitch=pitch), Lens(focal_length=0.1, f_number=0.1 / diameter))


@pytest.mark.parametrize("shape", [(40, 50), (41, 51)])
def test_a_stop_inside_the_panel_has_the_area_of_a_circle(shape):
    camera = camera_with_stop(shape, 10e-6, 333e-6)
    area = float(pupil_amplitude(camera).sum()) * 10e-6**2
    assert area == pytest.approx(math.pi / 4 * 333e-6**2, rel=2e-4)


def test_edge_pixels_count_the_share_inside_the_stop():
    """A million-point count of one edge pixel, in place of the 256 of the code."""
    camera = camera_with_stop((20, 20), 10e-6, 100e-6)
    amplitude = pupil_amplitude(camera)
    offset = ((np.arange(1000) + 0.5) / 1000 - 0.5) * 10e-6
    for row, column in ((10, 15), (13, 14), (10, 5)):
        y, x = positions(20, 10e-6)[[row, column]]
        inside = ((y + offset)[:, None] ** 2 + (x + offset)[None, :] ** 2 <= (50e-6) ** 2).mean()
        assert 0 < inside < 1
        assert float(amplitude[row, column]) == pytest.approx(inside, abs=0.02)


def test_a_stop_larger_than_the_panel_leaves_it_open():
    assert np.allclose(pupil_amplitude(camera_with_stop((8, 12), 10e-6, 1e-3)), 1.0, atol=1e-12)


@pytest.mark.parametrize("distance", [0.5, 3.0, math.inf])
def test_defocus_is_the_spherical_wave_the_lens_does_not_focus(small_camera, distance):
    """pi r² / wavelength (1/d + 1/z - 1/f), with z from the thin-lens equation."""
    lens = small_camera.lens
    z = 1 / (1 / lens.focal_length - 1 / lens.focus_distance)
    y = positions(24, 40e-6)[:, None]
    x = positions(32, 40e-6)[None, :]
    excess = 1 / distance + 1 / z - 1 / lens.focal_length
    truth = np.pi / 500e-9 * excess * (y**2 + x**2)
    assert np.allclose(
        pupil_phase_on_panel(small_camera, distance, 500e-9).numpy(), truth, atol=1e-9
    )


def test_defocus_is_exactly_zero_in_focus(small_camera):
    assert vergence_error(small_camera.lens, 2.0) == 0
    assert not pupil_phase_on_panel(small_camera, 2.0, 500e-9).any()


def test_the_phase_step_is_the_steepest_inside_the_stop(small_camera):
    """2 pi r V / wavelength x pitch at the panel's corner, or at that of a pixel at the stop's
    edge."""
    vergence = abs(1 / 1.5 - 1 / 2.0)
    corner = math.hypot(12, 16) * 40e-6
    expected = 2 * math.pi / 500e-9 * vergence * corner * 40e-6
    assert phase_step_per_pixel(small_camera, 1.5, 500e-9) == pytest.approx(expected)
    stopped = replace(small_camera, lens=replace(small_camera.lens, f_number=0.125 / 0.5e-3))
    assert phase_step_per_pixel(stopped, 1.5, 500e-9) == pytest.approx(
        expected * (0.25e-3 + math.sqrt(2) * 40e-6) / corner
    )
