"""A panel before a lens as one panel in a lens: ray matrices, shadows, and what is left out."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from judges import positions, relative
from judges.chain_sums import direct_chain
from sweeps import some

from optics.accuracy import ToleranceError
from optics.camera import Camera, Lens, Panel
from optics.camera.pupil import open_area, pupil_amplitude
from optics.plane import Plane
from optics.psf import PSFOperator
from optics.psf.chain_collapsed import collapse_to_thin_camera

WAVELENGTH = 550e-9


def ray_matrix(camera: Camera) -> np.ndarray:
    """From the panel to the sensor, for (height, slope)."""
    lens = camera.lens
    space = [np.array([[1, z], [0, 1]]) for z in (camera.separation, lens.image_distance)]
    return space[1] @ np.array([[1, 0], [-1 / lens.focal_length, 1]]) @ space[0]


@pytest.mark.parametrize("focus", [0.6, 3.0, math.inf])
@pytest.mark.parametrize("separation", [0.0, 0.01, 0.2])
def test_the_collapsed_lens_has_the_ray_matrix_of_the_chain(focus, separation):
    """Intensities depend on A and B alone: the sensor's own curvature is a phase."""
    camera = Camera(Panel(), Lens(0.1, 5.6, focus), separation=separation)
    thin = collapse_to_thin_camera(camera, 1.2)
    (a, b), _ = ray_matrix(camera)
    (a_thin, b_thin), _ = ray_matrix(thin)
    assert camera.ray_matrix_b == pytest.approx(b, rel=1e-12)
    assert b_thin == pytest.approx(b, rel=1e-12)
    assert a_thin == pytest.approx(a, rel=1e-9, abs=1e-12)
    assert thin.separation == 0
    assert thin.lens.focus_distance == pytest.approx(focus - separation)


def test_the_chief_ray_goes_through_the_middle_of_the_lens():
    camera = Camera(Panel(), Lens(0.1, 5.6, 2.0), separation=0.05)
    z2 = camera.lens.image_distance
    assert camera.magnification(1.95) == pytest.approx(z2 / 2.0)
    assert camera.magnification(math.inf) == 0


@pytest.mark.parametrize(("distance", "spread"), [(0.4, 1.125), (math.inf, 1.0)])
def test_the_shadow_is_where_rays_from_the_object_meet_the_panel(distance, spread):
    """A pixel is open if the ray to it from the object goes on through the stop."""
    camera = Camera(Panel((60, 70), 20e-6), Lens(0.1, 0.1 / 1e-3, 2.0), separation=0.05)
    field = (0.3e-3, -0.5e-3)
    thin = collapse_to_thin_camera(camera, distance, field)
    y, x = (positions(n, 20e-6) for n in (60, 70))
    z2 = camera.lens.image_distance
    # A ray through the panel at s meets the lens at s + z1 (s - object) / d.
    tilt = [-f / z2 * spread for f in field]
    at_y, at_x = y * spread - 0.05 * tilt[0], x * spread - 0.05 * tilt[1]
    away = np.hypot(at_y[:, None], at_x[None, :])
    share = pupil_amplitude(thin).numpy()
    assert np.all(share[away < 0.5e-3 - 20e-6 * spread] == 1)
    assert np.all(share[away > 0.5e-3 + 20e-6 * spread] == 0)
    assert open_area(thin) == pytest.approx(float(share.sum()) * 20e-6**2, rel=1e-9)


def test_only_a_parabola_collapses():
    lens = Lens(0.1, 5.6, 2.0, aberrations=((4, 0, 50e-9),))
    with pytest.raises(ValueError, match="aberrations"):
        collapse_to_thin_camera(Camera(Panel(), lens, separation=0.05), 2.0)
    with pytest.raises(ValueError, match="stigmatic"):
        collapse_to_thin_camera(
            Camera(Panel(), Lens(0.1, 5.6, 2.0, kind="stigmatic"), separation=0.05), 2.0
        )


def test_a_panel_beyond_the_plane_in_focus_has_no_place_for_a_lens():
    camera = Camera(Panel(), Lens(0.1, 5.6, 0.3), separation=0.4)
    assert camera.ray_matrix_b < 0
    with pytest.raises(ValueError, match="plane in focus"):
        collapse_to_thin_camera(camera, 2.0)


def small_camera(stop: float, **changes) -> Camera:
    panel = Panel((12, 16), 20e-6, fill_factor=0.8, unmodulated=0.0)
    camera = Camera(panel, Lens(0.03, 0.03 / stop, 0.8), separation=1e-2)
    return replace(camera, **changes)


@pytest.mark.parametrize(
    ("distance", "field"), some([(math.inf, (4e-5, -6e-5)), (0.5, (0.0, 0.0))])
)
def test_it_keeps_its_tolerance_where_the_stop_is_wide(distance, field, rng):
    """Against a double sum over panel and stop; light is out of focus, and off the axis."""
    camera = small_camera(0.7e-3)
    modulation = np.exp(1j * rng.uniform(0, 2 * np.pi, (12, 16)))
    plane = Plane((9, 10), (8e-6, 8e-6))
    y, x = positions(9, 8e-6), positions(10, 8e-6)
    nodes = {"across_pixel": 10, "rings": 70}
    truth = direct_chain(camera, modulation, distance, WAVELENGTH, y, x, field=field, **nodes)
    operator = PSFOperator(
        camera,
        distance,
        WAVELENGTH,
        plane,
        field=field,
        integrate=False,
        tol=0.5,
        method="collapsed",
    )
    value = operator(np.angle(modulation))
    # A stricter tolerance is kept by the whole chain, which the account then names.
    assert operator.account.method == "collapsed"
    assert relative(value, truth * 64e-12) <= operator.account.sampling_error.value <= 0.5


def test_it_refuses_where_the_stop_cuts_what_the_window_sees():
    with pytest.raises(ToleranceError, match='take method="chain"'):
        PSFOperator(
            small_camera(0.2e-3),
            0.5,
            WAVELENGTH,
            Plane((9, 10), (8e-6, 8e-6)),
            tol=1e-3,
            method="collapsed",
        )


def test_a_window_in_the_dark_gets_the_whole_chain(rng):
    """What a collapsed camera leaves out is little of all the light, and much of that there."""
    camera, phase = small_camera(0.7e-3), np.zeros((12, 16))
    plane = Plane((9, 10), (8e-6, 8e-6), (0.0, 2.5e-4))
    settings = {"integrate": False, "tol": 0.3, "method": "collapsed"}
    operator = PSFOperator(camera, 0.8, WAVELENGTH, plane, **settings)
    value = operator(phase)
    y, x = positions(9, 8e-6), positions(10, 8e-6, 2.5e-4)
    nodes = {"across_pixel": 10, "rings": 70}
    truth = direct_chain(camera, np.ones((12, 16)), 0.8, WAVELENGTH, y, x, **nodes) * 64e-12
    assert relative(value, truth) <= 0.3
    assert operator.account.method == "chain"


def test_an_account_names_and_prices_the_engine_that_stood_in(rng):
    """In a dark window a stricter engine stands in: the cheapest, of whichever method."""
    camera, phase = small_camera(0.3e-3), np.zeros((12, 16))
    plane = Plane((5, 6), (8e-6, 8e-6), (0.0, 1.5e-4))
    settings = {"integrate": False, "tol": 1e-3, "calls": 1}
    operator = PSFOperator(camera, 0.8, WAVELENGTH, plane, **settings)
    planned = operator.account
    value, spent = operator(phase), operator.account
    y, x = positions(5, 8e-6), positions(6, 8e-6, 1.5e-4)
    nodes = {"across_pixel": 10, "rings": 80}
    truth = direct_chain(camera, np.ones((12, 16)), 0.8, WAVELENGTH, y, x, **nodes) * 64e-12
    assert (planned.method, spent.method) == ("chain", "chain, direct")
    # The truth's own slices of the open area are good for eleven digits.
    assert relative(value, truth) <= max(spent.error, 1e-10)
    assert spent.error <= 1e-3
    # Both engines have computed, so that both are in the price.
    alone = PSFOperator(camera, 0.8, WAVELENGTH, plane, **settings, method="chain, direct")
    assert spent.cpu_predicted > max(planned.cpu_predicted, alone.account.cpu_predicted)
    assert spent.planning_predicted > planned.planning_predicted


def test_derivatives_of_a_cut_panel_are_refused():
    distance = torch.tensor(0.5, dtype=torch.float64, requires_grad=True)
    with pytest.raises(ToleranceError, match="derivatives"):
        PSFOperator(
            small_camera(0.2e-3),
            distance,
            WAVELENGTH,
            Plane((9, 10), (8e-6, 8e-6)),
            tol=0.5,
            method="collapsed",
        )
