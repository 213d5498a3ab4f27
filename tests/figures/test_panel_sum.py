"""The sum over a panel's pixels that judges encoders, against one over points of all pixels."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from judges.panel_sums import quadrature_psf

from figures.panel_sum import PanelSum
from optics.camera import Camera, Lens, Panel, Sensor

_CAMERA = Camera(Panel((20, 31), 8e-6, 0.9, unmodulated=0.0), Lens(0.1, 5.6, 2.0), Sensor())


def test_it_agrees_with_quadrature_over_all_points() -> None:
    pixels = _CAMERA.sensor.window_plane((24, 17))
    phase = 6 * torch.rand(20, 31, generator=torch.Generator().manual_seed(0)).double()
    truth = quadrature_psf(_CAMERA, phase.numpy(), 0.5, 520e-9, pixels.shape)
    rows, columns = np.array([3, 12, 23]), np.array([0, 16, 5])
    judge = PanelSum(_CAMERA, 0.5, 520e-9, pixels, rows, columns, integrate=True)
    np.testing.assert_allclose(judge(phase), truth[np.ix_(rows, columns)], rtol=1e-8)
    wrong = torch.from_numpy(1.01 * truth)
    assert judge.error(wrong, phase) == pytest.approx(0.01, rel=1e-6)


def test_centres_take_the_density_times_the_area() -> None:
    """A neutral panel in focus: at the axis, the light is the pixel's area over the wave's."""
    camera = Camera(_CAMERA.panel, Lens(0.1, 5.6, math.inf), Sensor())
    pixels = camera.sensor.window_plane((3, 3))
    judge = PanelSum(camera, math.inf, 520e-9, pixels, np.array([1]), np.array([1]), False)
    open_area = 20 * 31 * 0.9 * 8e-6**2
    expected = open_area * camera.sensor.pitch**2 / (520e-9 * 0.1) ** 2
    assert float(judge(torch.zeros(20, 31))[0, 0]) == pytest.approx(expected, rel=1e-9)
