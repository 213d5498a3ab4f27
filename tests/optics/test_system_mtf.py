"""The pupil's autocorrelation against closed forms and a brute-force sum."""

import math
from dataclasses import replace

import numpy as np
import pytest
from sweeps import some

from optics.camera import Camera, Lens, Panel, Sensor
from optics.camera.stop import Circle, Stop
from optics.camera.system_mtf import neutral_panel_otf, system_mtf

GREEN = 550e-9
BIG = Panel(shape=(2000, 2000), pitch=20e-6)
ROUND = Camera(panel=BIG, lens=Lens(0.05, 5.0, 2.0), sensor=Sensor(pitch=4e-6))
WIDE = Camera(panel=Panel(shape=(100, 200), pitch=20e-6), lens=Lens(0.05, 5.0, 2.0))


def test_a_round_pupil_has_the_diffraction_limit_of_the_textbook():
    """2/π (acos ν - ν sqrt(1 - ν²)) with ν = f λ z / D (Goodman, Eq. 6-32)."""
    lens = ROUND.lens
    share = np.linspace(0, 1.2, 13)
    cutoff = lens.stop_diameter / (GREEN * lens.image_distance)
    inside = np.minimum(share, 1)
    truth = 2 / math.pi * (np.arccos(inside) - inside * np.sqrt(1 - inside**2))
    for angle in (0.0, 0.7, math.pi / 2):
        assert neutral_panel_otf(ROUND, GREEN, share * cutoff, angle) == pytest.approx(
            truth, abs=1e-5
        )


@pytest.mark.parametrize("angle", [0.0, 0.4, math.pi / 2])
def test_a_rectangular_panel_has_two_triangles(angle):
    """2 x 4 mm before a stop of 10 mm: Λ(λ z fy / h) Λ(λ z fx / w)."""
    f = np.linspace(0, 120e3, 9)
    z = WIDE.lens.image_distance
    triangles = [
        np.maximum(1 - GREEN * z * f * part / size, 0)
        for part, size in ((abs(math.sin(angle)), 2e-3), (math.cos(angle), 4e-3))
    ]
    assert neutral_panel_otf(WIDE, GREEN, f, angle) == pytest.approx(
        triangles[0] * triangles[1], abs=1e-9
    )


def test_defocus_of_a_rectangle_is_hopkins_closed_form():
    """Λ(s/w) sinc(w s ε (1 - s/w) / λ) along x: Goodman, Eq. 6-42."""
    f = np.linspace(0, 60e3, 15)
    shift = GREEN * WIDE.lens.image_distance * f
    bend = 1 / 1.9 - 1 / 2.0
    truth = np.maximum(1 - shift / 4e-3, 0) * np.sinc(bend * shift * (4e-3 - shift) / GREEN)
    assert neutral_panel_otf(WIDE, GREEN, f, 0.0, 1.9) == pytest.approx(truth, abs=1e-9)


@pytest.mark.parametrize(("angle", "distance"), some([(0.6, 1.8), (0.0, 2.0), (1.2, 3.0)]))
def test_a_cut_circle_is_the_sum_over_its_samples(angle, distance):
    """A panel of 8 x 14 mm that cuts a stop of 10 mm, and stands 30 mm before it."""
    camera = Camera(panel=Panel(shape=(400, 450), pitch=20e-6), lens=Lens(0.05, 5.0, 2.03),
                    separation=0.03)  # fmt: skip
    f = 40e3
    shift = GREEN * camera.lens.image_distance * f
    scale = (distance + 0.03) / distance
    x = (np.arange(3000) - 1499.5) * 4e-6
    dy, dx = shift * math.sin(angle), shift * math.cos(angle)

    def opened(y, x):
        return (np.abs(y) < 4e-3 * scale) & (np.abs(x) < 4.5e-3 * scale) & (np.hypot(y, x) < 5e-3)

    y = x[:, None]
    both = opened(y + dy / 2, x + dx / 2) & opened(y - dy / 2, x - dx / 2)
    bend = 1 / (distance + 0.03) - 1 / 2.03
    phase = 2 * math.pi / GREEN * bend * (dy * y + dx * x)
    truth = (both * np.cos(phase)).sum() / opened(y, x).sum()
    told = neutral_panel_otf(camera, GREEN, f, angle, distance)
    assert float(told) == pytest.approx(truth, abs=2e-3)


def test_pixels_take_their_sinc():
    f = np.array([0.0, 30e3, 60e3])
    angle = 0.3
    pixel = np.sinc(4e-6 * f * math.cos(angle)) * np.sinc(4e-6 * f * math.sin(angle))
    assert system_mtf(ROUND, GREEN, f, angle) == pytest.approx(
        neutral_panel_otf(ROUND, GREEN, f, angle) * pixel
    )


@pytest.mark.parametrize(
    "lens",
    [
        replace(ROUND.lens, aberrations=((2, 2, 50e-9),)),
        replace(ROUND.lens, kind="stigmatic"),
        replace(ROUND.lens, stop=Stop(Circle(), (Circle(0.3),))),
    ],
)
def test_lenses_without_a_closed_form_are_refused(lens):
    with pytest.raises(ValueError, match="isn't known in closed form; give a thin lens"):
        system_mtf(replace(ROUND, lens=lens), GREEN, 1e3)


def test_what_makes_no_sense_is_refused():
    with pytest.raises(ValueError, match="a frequency is negative or not finite"):
        system_mtf(ROUND, GREEN, [-1.0])
    with pytest.raises(ValueError, match="wavelength is 0 m; it must be positive"):
        system_mtf(ROUND, 0.0, 1.0)
    with pytest.raises(ValueError, match="distance is -1 m; the object must be in front of the"):
        system_mtf(ROUND, GREEN, 1.0, distance=-1.0)
