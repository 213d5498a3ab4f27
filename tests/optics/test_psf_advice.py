"""What a refused PSF advises: taken at its word, it works."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest

from optics.accuracy import Budget, ToleranceError
from optics.camera import Lens
from optics.camera.stop import Stop, regular_polygon
from optics.plane import Plane
from optics.psf import PSFOperator

WAVELENGTH = 520e-9


def test_a_spot_beside_the_pixels_is_told_the_pixel_tol_that_works():
    """Light on the neighbouring pixel is far brighter than that on the window."""

    def light(**settings):
        operator = PSFOperator(
            Lens(0.05, 4.0, math.inf),
            math.inf,
            WAVELENGTH,
            Plane((3, 3), (4e-6, 4e-6)),
            phase_slope=2000.0,
            **settings,
        )
        y, x = operator.points
        return operator(2 * math.pi / (WAVELENGTH * 0.05) * 8e-6 * x + 0 * y)

    with pytest.raises(ToleranceError, match="plan a PSFOperator with pixel_tol=") as refused:
        light(tol=1e-3)
    advised = float(str(refused.value).split("pixel_tol=")[1])
    found = light(tol=1e-3, pixel_tol=advised)
    truth = light(tol=1e-8, pixel_tol=1e-11, method="scattered")
    assert float((found - truth).norm() / truth.norm()) <= 1e-3


def test_distances_and_memory_that_are_advised_are_enough():
    lens = Lens(0.05, 4.0, 2.0, Stop(regular_polygon(6)))
    pixels = Plane((16, 16), (2e-6, 2e-6))
    with pytest.raises(ToleranceError, match="in focus, to") as refused:
        PSFOperator(lens, 1e-6, WAVELENGTH, pixels)
    nearer = float(re.findall(r"in focus, to (\S+) m", str(refused.value))[0])
    assert np.isfinite(PSFOperator(lens, nearer, WAVELENGTH, pixels)().numpy()).all()
    asked = {"integrate": False, "tol": 1e-6}
    with pytest.raises(ToleranceError, match="allow more memory: ") as refused:
        PSFOperator(lens, 1.0, WAVELENGTH, pixels, budget=Budget(memory=100_000), **asked)
    memory = int(re.findall(r"more memory: (\d+) MB", str(refused.value))[0]) * 1_000_000
    operator = PSFOperator(lens, 1.0, WAVELENGTH, pixels, budget=Budget(memory=memory), **asked)
    assert float(operator().sum()) > 0
