"""What `labapp accuracy` calls exact, against judges that share no code with it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from judges import Apart, View, by_chain, by_lines, by_panel, by_rings, covered, relative
from judges.fields import Cells, Gaussians, Points, Pulse

from labapp.accuracy.references.chain_integral import chain_density
from labapp.accuracy.references.free_space import (
    CellLight,
    Gaussian,
    Places,
    SmoothLight,
    exact_field,
    product_count,
)
from labapp.accuracy.references.lens_integral import lens_psf, open_area_shares
from labapp.accuracy.references.panel_integral import ImagingChain
from labapp.accuracy.references.panel_matrices import PanelMatrices
from labapp.accuracy.references.psf_problem import ChainProblem, PSFProblem, draw_samples
from labapp.accuracy.references.round_lens import round_lens_psf
from optics.camera import Camera, Lens, Panel
from optics.camera.stop import Circle, Stop, rectangle, regular_polygon
from optics.plane import Plane

WAVELENGTH = 550e-9
HEXAGON = Stop(regular_polygon(6, turn=0.3), (Circle(0.2, (0.1, -0.2)),))
SPIDER = Stop(Circle(), (rectangle(0.05, 2.2), rectangle(2.2, 0.05)))


@pytest.mark.parametrize(("stop", "kind"), [(HEXAGON, "thin"), (SPIDER, "stigmatic")])
def test_a_lens(stop, kind):
    lens = Lens(0.05, 8.0, math.inf, stop, ((4, 0, 90e-9), (3, -1, 120e-9)), kind)
    pixels = Plane((6, 5), (3e-6, 2.5e-6), (8e-6, -11e-6))
    truth = by_lines(View(lens, pixels, 4.0, WAVELENGTH, integrate=False))
    assert relative(lens_psf(lens, 4.0, WAVELENGTH, pixels), truth) <= 1e-9


def test_a_clear_round_lens():
    lens, pixels = Lens(0.1, 8.0, math.inf), Plane((9, 9), (3e-6, 3e-6))
    truth = by_rings(View(lens, pixels, 2.0, WAVELENGTH, integrate=False))
    assert relative(round_lens_psf(lens, 2.0, WAVELENGTH, 3e-6, 9), truth) <= 1e-9


@pytest.mark.parametrize("stop", [Stop(), HEXAGON, SPIDER])
def test_open_shares_of_cells(stop):
    plane = Plane((7, 9), (0.4e-3, 0.3e-3), (0.1e-3, -0.2e-3))
    truth = covered(stop, 1.1e-3, plane)
    assert np.abs(open_area_shares(stop, 1.1e-3, plane) - truth).max() <= 1e-9
    assert 0 < truth.sum() < truth.size


def test_matrices_of_a_panels_pixels():
    camera = Camera(Panel((9, 14), 8e-6, 0.8, unmodulated=0.0), Lens(0.05, 450.0, 2.0, HEXAGON))
    pixels, chance = Plane((6, 5), (7e-6, 5e-6), (8e-6, -11e-6)), np.random.default_rng(0)
    phase, weights = chance.uniform(0, 6, (9, 14)), chance.uniform(size=(6, 5))
    matrices = PanelMatrices(camera, 0.02, WAVELENGTH, pixels)
    truth = by_panel(View(camera, pixels, 0.02, WAVELENGTH, integrate=False, phase=phase))
    assert relative(matrices.light(phase), truth) <= 1e-9
    way, step = chance.uniform(-1, 1, (9, 14)), 1e-4
    ends = [(weights * matrices.light(phase + sign * step * way)).sum() for sign in (1, -1)]
    slope = float((matrices.gradient(phase, weights) * way).sum())
    assert slope == pytest.approx((ends[0] - ends[1]) / (2 * step), rel=1e-6)


def test_cells_that_lie_beside_a_stop_are_dark():
    plane = Plane((3, 3), (1e-3, 1e-3), (0.0, 9e-3))
    assert not open_area_shares(Stop(), 1e-3, plane).any()


def camera(separation: float) -> tuple[Camera, np.ndarray]:
    lens = Lens(0.05, 0.05 / 0.3e-3, 1.5, Stop(rectangle(1.1, 0.9)), ((3, 1, 90e-9),))
    panel = Panel((6, 7), 40e-6, 0.8, unmodulated=0.1)
    phase = np.random.default_rng(0).uniform(0, 6, panel.shape)
    return Camera(panel, lens, separation=separation), phase


@pytest.mark.parametrize("integrate", [False, True])
def test_a_panel_in_the_plane_of_its_lens(integrate):
    optics, phase = camera(0.0)
    pixels = Plane((4, 4), (25e-6, 25e-6))
    judge = PSFProblem(optics, 1.2, WAVELENGTH, pixels, integrate, 1e-3, phase).build_reference(
        np.ones((4, 4))
    )
    view = View(optics, pixels, 1.2, WAVELENGTH, integrate=integrate, phase=phase)
    assert relative(judge.exact_samples, judge.weighted_samples(by_panel(view))) <= 1e-9


@pytest.mark.parametrize(("field", "sphere"), [((2e-4, -3e-4), False), ((0.0, 0.0), True)])
def test_a_panel_before_its_lens(field, sphere):
    optics, phase = camera(0.04)
    pixels = Plane((4, 4), (25e-6, 25e-6))
    problem = ChainProblem(optics, 0.3, WAVELENGTH, pixels, False, 1e-3, phase, field, sphere)
    judge = problem.build_reference(np.ones((4, 4)))
    view = Apart(
        optics, pixels, 0.3, WAVELENGTH, integrate=False, phase=phase, off_axis=field, sphere=sphere
    )
    assert relative(judge.exact_samples, judge.weighted_samples(by_chain(view))) <= 1e-8


def test_a_sphere_from_very_far_away_is_that_from_infinity():
    """Its amplitude, distance over path, is the cosine of the angle off the axis."""
    optics, phase = camera(0.04)
    found = [
        ChainProblem(optics, far, WAVELENGTH, PLANE, False, 1e-3, phase, (2e-3, -3e-3), sphere=True)
        .build_reference(np.ones(PLANE.shape))
        .exact_samples
        for far in (1e12, math.inf)
    ]
    assert relative(found[0], found[1]) <= 1e-9


def test_a_stop_whose_end_is_rounded_either_way():
    """A hair's breadth more of a stop changes next to nothing."""
    optics, phase = camera(0.04)
    places = np.array([-20e-6, 30e-6])
    for width in np.linspace(0.8, 1.1, 30):
        found = [
            chain_density(
                ImagingChain(
                    replace(optics, lens=replace(optics.lens, stop=stop)), 0.3, WAVELENGTH
                ),
                [np.exp(1j * phase)],
                places,
                places,
            )
            for stop in (Stop(rectangle(0.9, side)) for side in (width, width * (1 + 1e-12)))
        ]
        assert relative(found[0], found[1]) <= 1e-9, width


PLANE = Plane((64, 70), (4e-6, 4e-6))
GAUSSIANS = (
    Gaussian(1.0 + 0j, (0.0, 0.0), (0.0, 0.0), 20e-6),
    Gaussian(0.5j, (10e-6, -15e-6), (2e4, -1e4), 18e-6),
)


def places(distance: float) -> tuple[Places, Points]:
    y, x = np.random.default_rng(1).uniform(-8e-5, 8e-5, (2, 6))
    return Places(y, x, distance, 600e-9), Points(y, x, 0 * y, distance, 600e-9)


@pytest.mark.parametrize("paraxial", [False, True])
@pytest.mark.parametrize("distance", [2e-3, -3e-3])
def test_smooth_light_through_free_space(paraxial, distance):
    where, points = places(distance)
    pulses = tuple(
        (
            one.strength,
            *(Pulse(one.middle[k], one.frequency[k], complex(one.width**-2)) for k in (0, 1)),
        )
        for one in GAUSSIANS
    )
    truth = Gaussians(pulses).field(points, paraxial=paraxial)
    found = exact_field(SmoothLight(PLANE, GAUSSIANS), where, paraxial=paraxial)
    assert relative(found, truth) <= 1e-9


@pytest.mark.parametrize("paraxial", [False, True])
@pytest.mark.parametrize("distance", [2e-3, -3e-3])
def test_cells_of_light_through_free_space(paraxial, distance):
    plane = Plane((6, 7), (9e-6, 8e-6), (1e-5, 0.0))
    rng = np.random.default_rng(2)
    values = rng.normal(size=(6, 7)) + 1j * rng.normal(size=(6, 7))
    where, points = places(distance)
    truth = Cells(plane, plane.pitch, values).field(points, paraxial=paraxial)
    assert relative(exact_field(CellLight(plane, values), where, paraxial=paraxial), truth) <= 1e-9


def test_a_wide_cell_is_cut_into_panels():
    """Of a million turns a metre a piece holds six; one that isn't cut would be wrong."""
    plane = Plane((1, 1), (2e-3, 2e-3))
    where, points = places(5e-3)
    truth = Cells(plane, plane.pitch, np.ones((1, 1), complex)).field(points, paraxial=True)
    light = CellLight(plane, np.ones((1, 1), complex))
    assert relative(exact_field(light, where, paraxial=True), truth) <= 1e-9
    assert product_count(light, where, paraxial=True) > 6 * 24 * 100


def test_what_a_sum_takes_is_known_before():
    where, _ = places(2e-3)
    light = CellLight(PLANE, np.ones(PLANE.shape, complex))
    near = replace(where, distance=1e-4)
    assert product_count(light, near, paraxial=False) > product_count(light, where, paraxial=False)
    assert product_count(light, where, paraxial=False) >= 6 * 64 * 70 * 16


def test_drawn_samples_stand_for_the_whole_picture():
    rng = np.random.default_rng(3)
    light = rng.exponential(size=(40, 50)) ** 3
    values = light * rng.uniform(0.5, 1.5, light.shape)
    sums = []
    for _ in range(400):
        where, weight = draw_samples(rng, light, 30)
        sums.append(float((values.ravel()[where] * weight).sum()) / 30)
    assert np.mean(sums) == pytest.approx(values.sum(), rel=0.03)
    everything, ones = draw_samples(rng, light, light.size)
    assert np.array_equal(everything, np.arange(light.size))
    assert (ones == 1).all()
