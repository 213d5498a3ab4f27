"""Direct quadrature of a chain, row by row: against sums over nodes that share no code with it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from judges import positions, relative
from judges.chain import Apart, by_chain
from judges.chain_sums import direct_chain

from optics.accuracy import ToleranceError
from optics.camera import Camera, Lens, Panel
from optics.camera.stop import Circle, Stop, rectangle, regular_polygon
from optics.camera.stop_rows import quadrature_rows, row_bands
from optics.plane import Plane
from optics.psf import PSFOperator

WAVELENGTH = 550e-9
SHAPE, PIXELS = (12, 16), Plane((5, 4), (8e-6, 8e-6))
DIRECT = "chain, direct"

STOPS = {
    "round": Stop(),
    "ring": Stop(Circle(), (Circle(0.4),)),
    "five blades": Stop(regular_polygon(5, turn=0.3)),
    "rectangle": Stop(rectangle(0.7, 1.1)),
    "spider": Stop(Circle(), (rectangle(0.05, 2.2), rectangle(2.2, 0.05))),
    "two spots": Stop(Circle(), (Circle(0.3, (0.2, 0.1)), Circle(0.3, (0.3, 0.3)))),
}


def camera(separation=0.02, **changes) -> Camera:
    panel = Panel(SHAPE, 20e-6, fill_factor=0.8, unmodulated=0.0)
    lens = replace(Lens(0.03, 75, 0.8), **changes)
    return Camera(panel, lens, separation=separation)


@pytest.fixture
def phase(rng) -> np.ndarray:
    return rng.uniform(0, 2 * np.pi, SHAPE)


def direct(optics: Camera, distance: float, pixels: Plane, **settings) -> PSFOperator:
    settings = {"tol": 1e-9, "integrate": False} | settings
    return PSFOperator(optics, distance, WAVELENGTH, pixels, **settings)


@pytest.mark.parametrize("stop", STOPS.values(), ids=STOPS.keys())
def test_rows_cover_the_open_part_of_a_stop(stop):
    rows = quadrature_rows(row_bands(stop), 50.0, 50.0, 1e-14)
    width = np.bincount(rows.row, rows.sign * rows.end)
    assert rows.weight @ width == pytest.approx(stop.area, rel=1e-12)


@pytest.mark.parametrize(
    ("optics", "distance", "field"),
    [
        (camera(aberrations=((4, 0, 150e-9),)), 0.5, (1e-4, -2e-4)),
        (camera(focus_distance=math.inf), math.inf, (0.0, 1e-4)),
    ],
    ids=["aberrated, off the axis", "far away"],
)
def test_direct_quadrature_is_the_sum_over_nodes_to_rounding(optics, distance, field, phase):
    y, x = positions(5, 8e-6), positions(4, 8e-6)
    wave = np.exp(1j * phase)
    truth = direct_chain(optics, wave, distance, WAVELENGTH, y, x, field=field) * 64e-12
    operator = direct(optics, distance, PIXELS, field=field, method=DIRECT)
    assert relative(operator(phase), truth) <= 1e-9
    assert operator.account.error <= 1e-9


@pytest.mark.parametrize("stop", ["five blades", "spider"])
def test_stops_of_any_shape_are_integrated_along_their_rows(stop, phase):
    optics = camera(stop=STOPS[stop], aberrations=((2, 2, 200e-9), (3, -1, 100e-9)))
    view = Apart(optics, PIXELS, 0.6, WAVELENGTH, integrate=False, phase=phase)
    value = direct(optics, 0.6, PIXELS, method=DIRECT)(phase)
    assert relative(value, by_chain(view)) <= 1e-8


def test_a_spot_beside_the_window_is_summed_directly(phase):
    """A window 3 mm from all light: a thousandth of it comes by the edge of the stop."""
    optics, pixels = camera(), Plane((3, 4), (8e-6, 8e-6), (0.0, 3e-3))
    operator = direct(optics, 0.8, pixels)
    y, x = pixels.coordinates(0).numpy(), pixels.coordinates(1).numpy()
    grating = np.broadcast_to(0.7 * np.arange(SHAPE[0])[:, None], SHAPE)
    truth = direct_chain(optics, np.exp(1j * grating), 0.8, WAVELENGTH, y, x, rings=130) * 64e-12
    assert relative(operator(grating), truth) <= 1e-8
    assert operator.account.error <= 1e-9


def test_gradients_in_the_phase_are_those_of_the_light(phase):
    operator = direct(camera(), 0.5, Plane((1, 2), (8e-6, 8e-6)), method=DIRECT)
    part = torch.from_numpy(phase).requires_grad_()
    operator(part)[0, 1].backward()
    step = np.zeros(SHAPE)
    step[3, 5] = 1e-4
    change = (operator(phase + step) - operator(phase - step))[0, 1] / 2e-4
    assert part.grad[3, 5] == pytest.approx(change, rel=1e-5)


def test_derivatives_in_lengths_are_refused_in_words():
    moved = torch.tensor(0.02, dtype=torch.float64, requires_grad=True)
    with pytest.raises(ToleranceError, match="no derivatives in lengths"):
        direct(camera(separation=moved), 0.5, PIXELS, method=DIRECT)
