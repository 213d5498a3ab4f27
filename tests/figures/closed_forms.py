"""What textbooks know in closed form, beside what the engine computes."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from judges import relative
from judges.transfer import clear_stop, hopkins_series
from numpy.typing import NDArray
from scipy.special import j0, j1

from figures import Figure
from figures.free_space import positions
from optics.camera import Camera, Lens, Panel
from optics.camera.stop import Stop, rectangle
from optics.otf import lens_transfer_function
from optics.plane import Plane
from optics.psf import PSFOperator

Array = NDArray[np.float64]

_LENS = Lens(focal_length=0.1, f_number=5.6, focus_distance=2.0)
_WAVELENGTH = 520e-9
_SCALE = _WAVELENGTH * _LENS.image_distance
_RADIUS = _LENS.stop_diameter / 2
_CUTOFF = _LENS.stop_diameter / _SCALE
_TOL = 1e-9


def closed_forms(folder: Path) -> list[Figure]:
    """In double precision, relative L2 errors, or absolute ones of transfer functions."""
    errors = {name: measure() for name, measure in _FORMS.items()}
    worst = max(errors.values())
    told = ", ".join(f"{name} {error:.0e}" for name, error in errors.items())
    return [Figure("closed forms, largest error in float64", "≤ 1e-6", told, worst <= 1e-6)]


def _light(lens: Lens, plane: Plane, distance: float = 2.0) -> Array:
    operator = PSFOperator(lens, distance, _WAVELENGTH, plane, integrate=False, tol=_TOL)
    return np.asarray(operator(), dtype=np.float64)


def _airy() -> float:
    """(2 J1(v) / v)² (Born and Wolf 8.5.2)."""
    plane = Plane((65, 64), (1.1e-6, 1.3e-6))
    y, x = positions(plane)
    v = 2 * np.pi * _RADIUS * np.hypot(y, x) / _SCALE
    safe = np.where(v > 0, v, 1.0)
    peak = np.pi * _RADIUS**2 / _SCALE**2 * plane.pitch[0] * plane.pitch[1]
    return relative(_light(_LENS, plane), peak * np.where(v > 0, 2 * j1(safe) / safe, 1.0) ** 2)


def _sinc() -> float:
    """sinc² along each axis, of a rectangular stop and of a panel's pixels."""
    plane, (height, width) = Plane((65, 64), (1.1e-6, 1.3e-6)), (1.2, 0.9)
    y, x = positions(plane)
    area = plane.pitch[0] * plane.pitch[1]

    def truth(a: float, b: float) -> Array:
        return np.asarray(
            area * a * b / _SCALE**2 * (np.sinc(a * y / _SCALE) * np.sinc(b * x / _SCALE)) ** 2
        )

    lens = Lens(0.1, 5.6, 2.0, Stop(rectangle(height, width)))
    alone = relative(_light(lens, plane), truth(height * _RADIUS, width * _RADIUS))
    panel = Panel((300, 400), 8e-6, fill_factor=1.0, unmodulated=0.0)
    camera = Camera(panel, Lens(0.1, 5.6, 2.0))
    operator = PSFOperator(camera, 2.0, _WAVELENGTH, plane, integrate=False, tol=_TOL)
    behind = relative(np.asarray(operator()), truth(300 * 8e-6, 400 * 8e-6))
    return max(alone, behind)


def _transfer() -> float:
    v = np.linspace(0.01, 0.99, 50)
    truth = clear_stop(v)
    value = lens_transfer_function(_LENS, 2.0, _WAVELENGTH, np.zeros(50), v * _CUTOFF, tol=_TOL)
    return float(np.abs(np.asarray(value) - truth).max())


def _hopkins() -> float:
    v = np.array([1e-3, 0.03, 0.2, 0.5, 0.77, 0.99])
    worst = 0.0
    for waves in (0.3, 2.0, 20.0):
        vergence = waves * 2 * _WAVELENGTH / _RADIUS**2
        value = lens_transfer_function(
            _LENS, 1 / (0.5 + vergence), _WAVELENGTH, 0 * v, v * _CUTOFF, tol=_TOL
        )
        truth = [hopkins_series(one, waves) for one in v]
        worst = max(worst, float(np.abs(np.asarray(value) - truth).max()))
    return worst


def _encircled() -> float:
    """1 - J0² - J1² (Born and Wolf 8.5.2), by Simpson's rule along a radius."""
    count, step = 2001, 1e-8
    # The origin stands at n // 2: the radius is the right half of a row.
    density = _light(_LENS, Plane((1, 2 * count - 1), (1e-6, step)))[0, count - 1 :] / (1e-6 * step)
    r = step * np.arange(count)
    weights = np.full(count, 2.0)
    weights[1::2], weights[[0, -1]] = 4.0, 1.0
    inside = float(np.sum(weights * 2 * np.pi * r * density) * step / 3)
    v = 2 * np.pi * _RADIUS * r[-1] / _SCALE
    truth = float(1 - j0(v) ** 2 - j1(v) ** 2)
    return abs(inside - truth) / truth


def _strehl() -> float:
    """sinc²(W20): the peak falls with the waves of defocus at the stop's edge."""
    plane, worst = Plane((1, 1), (1e-6, 1e-6)), 0.0
    sharp = float(_light(_LENS, plane)[0, 0])
    for waves in (0.25, 0.5, 0.8, 1.7):
        vergence = waves * 2 * _WAVELENGTH / _RADIUS**2
        value = float(_light(_LENS, plane, 1 / (0.5 + vergence))[0, 0])
        worst = max(worst, abs(value / sharp - np.sinc(waves) ** 2))
    return worst


_FORMS: dict[str, Callable[[], float]] = {
    "Airy": _airy,
    "sinc²": _sinc,
    "round stop's MTF": _transfer,
    "Hopkins' OTF": _hopkins,
    "encircled energy": _encircled,
    "Strehl ratio": _strehl,
}

MEASUREMENTS = {"closed-forms": closed_forms}
