import math
from dataclasses import replace

import numpy as np
import pytest

from optics.camera import Camera, Lens, Panel, Sensor
from optics.camera.system_mtf import electron_rate


def bright_camera(f_number: float) -> Camera:
    return Camera(
        Panel(shape=(1000, 2000), pitch=10e-6, reflectivity=0.5),
        Lens(focal_length=0.1, f_number=f_number, focus_distance=math.inf),
        Sensor(quantum_efficiency=0.4),
        transmission=0.25,
    )


def test_the_rate_equals_the_camera_equation_by_hand():
    """Panel 0.01 m x 0.02 m = 2e-4 m², inside a stop of 0.05 m; z = f = 0.1 m.
    L B = 3e6 x 1e-8 = 0.03 W/(sr m²); E = 0.03 x 2e-4 / 0.01 = 6e-4 W/m².
    Passed: 6e-4 x 0.5 x 0.25 = 7.5e-5 W/m². A photon of 500 nm has
    6.62607015e-34 x 299792458 / 500e-9 = 3.9728917e-19 J.
    0.4 x 7.5e-5 / 3.9728917e-19 = 7.5511750e13 electrons / (s m²)."""
    assert electron_rate(bright_camera(2.0), 3e6, 1e-8, 500e-9) == pytest.approx(
        7.5511750e13, rel=1e-6
    )


def test_a_small_stop_lets_a_circle_of_light_through():
    """f/20: a circle of 5 mm inside the panel; area ratio pi 0.0025² / 2e-4."""
    ratio = electron_rate(bright_camera(20.0), 1.0, 1e-8, 5e-7) / electron_rate(
        bright_camera(2.0), 1.0, 1e-8, 5e-7
    )
    assert ratio == pytest.approx(math.pi * 0.0025**2 / 2e-4, rel=1e-3)


def test_a_stop_that_cuts_the_panel_passes_what_both_leave_open():
    """A circle of 15 mm over 20 x 10 mm: counted on 4 million points."""
    y = ((np.arange(2000) + 0.5) / 2000 - 0.5) * 0.01
    x = ((np.arange(2000) + 0.5) / 2000 - 0.5) * 0.02
    inside = (y[:, None] ** 2 + x[None, :] ** 2 <= 0.0075**2).mean()
    ratio = electron_rate(bright_camera(0.1 / 0.015), 1.0, 1e-8, 5e-7) / electron_rate(
        bright_camera(2.0), 1.0, 1e-8, 5e-7
    )
    assert ratio == pytest.approx(inside, rel=2e-3)


def test_no_radiance_gives_no_light():
    assert electron_rate(bright_camera(2.0), 0.0, 1e-8, 5e-7) == 0


def test_a_longer_focus_spreads_the_light_by_the_image_distance_squared():
    near = replace(bright_camera(2.0), lens=Lens(0.1, 2.0, 0.2))  # z = 0.2 m
    far = electron_rate(bright_camera(2.0), 1.0, 1e-8, 5e-7)
    ratio = electron_rate(near, 1.0, 1e-8, 5e-7) / far
    assert ratio == pytest.approx(0.25)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((-1.0, 1e-8, 5e-7), r"radiance is -1 .*negative"),
        ((math.nan, 1e-8, 5e-7), r"radiance is nan"),
        ((1.0, 0.0, 5e-7), r"bandwidth is 0 m; it must be positive"),
        ((1.0, 1e-8, -5e-7), r"wavelength is -5e-07 m; it must be positive"),
    ],
)
def test_light_that_cannot_be_is_refused_by_name(arguments, words):
    with pytest.raises(ValueError, match=words):
        electron_rate(bright_camera(2.0), *arguments)
