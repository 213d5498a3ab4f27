"""The ways in which a virtual bench may differ from its description, written out."""

import math

import numpy as np
import pytest
import torch

from optics.camera import Panel
from optics.slm import grey_to_phase, max_phase
from simulator.panel_imperfections import flatness_map, illumination_map, nonlinear_response

PANEL = Panel(shape=(48, 64), pitch=40e-6)


@pytest.mark.parametrize(("gamma", "wiggle", "highest"), [(1.3, 0.02, 0.92), (0.8, -0.05, 1.1)])
def test_a_bent_response_is_its_formula(gamma, wiggle, highest):
    panel = Panel(shape=(16, 16), response=nonlinear_response(256, gamma, wiggle, highest))
    grey = torch.arange(256, dtype=torch.uint8).reshape(16, 16)
    for wavelength in (500e-9, 550e-9, 620e-9):
        phase = grey_to_phase(panel, grey, wavelength) / max_phase(panel, wavelength)
        for level in (0, 1, 100, 254, 255):
            x = level / 255
            expected = highest * (x**gamma + wiggle * math.sin(2 * math.pi * x))
            assert float(phase.flatten()[level]) == pytest.approx(expected, abs=1e-12)


def test_a_response_that_falls_is_refused():
    with pytest.raises(ValueError, match=r"the response falls from level \d+ to \d+"):
        nonlinear_response(256, 1.0, 0.5, 1.0)


def test_a_figure_is_zernike_polynomials_over_the_circle_around_the_panel():
    """Written out: Z(2, 0) is sqrt(3) (2 r² - 1), Z(3, -1) sqrt(8) (3 r² - 2) y, Z(1, 1) 2 x."""
    reach = 0.5 * PANEL.pitch * math.hypot(*PANEL.shape)
    y, x = (p.numpy() / reach for p in PANEL.plane.mesh())
    r2 = x**2 + y**2
    expected = 60e-9 * math.sqrt(3) * (2 * r2 - 1) + 25e-9 * math.sqrt(8) * (3 * r2 - 2) * y
    expected = expected - 200e-9 * x
    values = (
        flatness_map(PANEL, ((2, 0, 60e-9), (3, -1, 25e-9), (1, 1, -100e-9)))
        .at_pixels(PANEL)
        .numpy()
    )
    assert np.abs(values - expected).max() <= 1e-18


def test_a_beam_has_its_radius_and_its_centre():
    """At its radius from its centre, 1/e² of what it has there."""
    radius, (row, column) = 10 * PANEL.pitch, (20, 40)
    centre = ((row - 24) * PANEL.pitch, (column - 32) * PANEL.pitch)
    values = illumination_map(PANEL, radius, centre).at_pixels(PANEL).numpy()
    assert values[row, column] == pytest.approx(1)
    for at in ((10, 40), (30, 40), (20, 30), (20, 50), (26, 48), (12, 34)):
        assert values[at] == pytest.approx(math.exp(-2))
