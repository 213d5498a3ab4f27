"""Nodes of wavelength, depth, place and time against integrals done slowly."""

import math
from dataclasses import replace

import numpy as np
import pytest
from optical_situations import CAMERA, PANEL, STAR, colour_curve, pattern, situation

from optics.camera.system_mtf import electron_rate
from optics.light import Band, Spectrum, Waveform, halogen
from optics.sensor import Mosaic
from simulator.formation.exposure_cells import exposure_cells
from simulator.formation.nodes import (
    depth_nodes,
    electrons_per_radiance,
    field_nodes,
    gauss_quadrature,
    interpolation_weights,
    wavelengths,
)
from simulator.panel_content import PanelContent
from simulator.recipe import Recipe
from simulator.scene.target import Part

BARE = Recipe(PANEL, 64, 2)
BAYER = Mosaic(
    ("RG", "GB"),
    {"R": colour_curve(600e-9, 50e-9), "G": colour_curve(550e-9, 40e-9),
     "B": colour_curve(450e-9, 50e-9)},
)  # fmt: skip


def integral(f, low, high, n=40001):
    x = np.linspace(low, high, n)
    return np.trapezoid(f(x), x)


def test_one_wavelength_in_an_even_band_is_the_camera_equation():
    """The gaussian's area is its width times 1.0645."""
    s = situation(band=Band(550e-9, 7e-9))
    part = s.target.layers[0].parts[0]
    found = wavelengths(s, BARE, [part])
    rate = float(found.weights[0, 0, 0]) * electrons_per_radiance(CAMERA, 1.0)
    width = 7e-9 * math.sqrt(math.pi / math.log(2)) / 2
    expected = electron_rate(CAMERA, 2e12, width, 550e-9, 1.0) * CAMERA.sensor.pitch**2
    assert rate == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize("nodes", [1, 2, 5, 9])
@pytest.mark.parametrize("mosaic", [True, False])
def test_every_channel_and_part_keeps_its_electrons_whatever_the_nodes(nodes, mosaic):
    camera = replace(CAMERA, sensor=replace(CAMERA.sensor, colour=BAYER))
    s = situation(camera=camera, band=Band(540e-9, 30e-9))
    red = Spectrum((400e-9, 560e-9, 600e-9, 800e-9), (0, 0.1, 0.9, 1))
    parts = [
        Part(halogen(), STAR.layers[0].parts[0].picture),
        Part(red, STAR.layers[0].parts[0].picture),
    ]
    found = wavelengths(s, BARE.with_changes(wavelengths=nodes, mosaic=mosaic), parts)
    curves = [BAYER.efficiencies[name] for name in BAYER.channels]
    if not mosaic:
        r, g, b = curves
        curves = [lambda x: 0.25 * r.at(x) + 0.5 * g.at(x) + 0.25 * b.at(x)]
    else:
        curves = [one.at for one in curves]
    for channel, curve in enumerate(curves):
        for number, part in enumerate(parts):
            true = integral(
                lambda x, p=part, c=curve: p.spectrum.at(x) * s.band.transmission(x) * c(x) * x,
                *s.band.support,
            )
            known = found.weights[channel, number].sum() * 6.62607015e-34 * 299792458
            assert known == pytest.approx(true, rel=1e-5)


def test_gauss_nodes_of_the_light_integrate_high_powers():
    x = np.linspace(-1, 1, 4001)
    weight = np.exp(-3 * x**2) * (1 + 0.5 * x)
    nodes, weights = gauss_quadrature(x, weight[None, None], 6)
    for power in range(12):
        assert weights[0, 0] @ nodes**power == pytest.approx(
            weight @ x**power, abs=1e-9 * weight.sum()
        )


def test_two_measures_share_nodes_and_each_is_exact_to_their_number():
    x = np.linspace(0, 1, 2001)
    measures = np.stack([np.exp(-x), x**2])[:, None]
    nodes, weights = gauss_quadrature(x, measures, 5)
    for k in range(2):
        for power in range(5):
            true = measures[k, 0] @ x**power
            assert weights[k, 0] @ nodes**power == pytest.approx(true, rel=1e-10)


def test_no_light_has_no_nodes():
    nodes, weights = gauss_quadrature(np.linspace(0, 1, 9), np.zeros((2, 3, 9)), 4)
    assert nodes.size == 0
    assert weights.shape == (2, 3, 0)


def test_the_leak_has_nodes_of_its_own():
    s = situation(band=Band(550e-9, 7e-9, leak=1e-3))
    part = s.target.layers[0].parts[0]
    found = wavelengths(s, BARE.with_changes(leak=4), [part])
    assert [node.leak for node in found.nodes] == [False, True, True, True, True]
    beside = found.weights[0, 0, 1:].sum() * 6.62607015e-34 * 299792458
    low, high = s.band.leak_range
    assert beside == pytest.approx(2e12 * 0.62 * 1e-3 * (high**2 - low**2) / 2, rel=1e-9)


def test_a_filter_that_leaks_nothing_has_no_nodes_beside_its_band():
    s = situation()
    found = wavelengths(s, BARE.with_changes(leak=4), s.target.layers[0].parts)
    assert [node.leak for node in found.nodes] == [False]
    assert found.weights.shape[2] == 1


def test_light_that_the_filter_stops_has_no_nodes():
    blue = Spectrum((400e-9, 450e-9), (1.0, 1.0))
    s = situation(band=Band(600e-9, 1e-9))
    found = wavelengths(s, BARE, [Part(blue, s.target.layers[0].parts[0].picture)])
    assert found.nodes == ()
    assert found.weights.shape == (1, 1, 0)


def test_depths_lie_between_their_neighbours_in_vergence():
    found = depth_nodes([0.5, 1.0, 2.0, 4.0], 3)
    assert found[0.5] == [(pytest.approx(0.5), pytest.approx(1.0))]
    for distance, nodes in found.items():
        assert sum(w for _, w in nodes) == pytest.approx(1)
        assert sum(w / d for d, w in nodes) == pytest.approx(1 / distance)


def test_one_depth_is_in_the_middle_of_vergence_and_many_are_the_layers_own():
    assert depth_nodes([1.0, 2.0], 1)[1.0] == [(pytest.approx(4 / 3), 1.0)]
    assert depth_nodes([1.0, math.inf], 2) == {1.0: [(1.0, 1.0)], math.inf: [(math.inf, 1.0)]}
    with pytest.raises(ValueError, match="depths"):
        depth_nodes([1.0], 0)


def test_places_are_chebyshevs_and_carry_polynomials():
    nodes = field_nodes(5, 2.0)
    at = np.linspace(-2, 2, 41)
    weights = interpolation_weights(nodes, at)
    for power in range(5):
        assert np.allclose(np.array(nodes) ** power @ weights, at**power, atol=1e-12)
    beyond = interpolation_weights(nodes, np.array([-5.0, 5.0]))
    assert np.allclose(beyond[:, 0], [1, 0, 0, 0, 0])


# Time.


def video(s_panel=PANEL, frame_time=1 / 100):
    rng = np.random.default_rng(1)
    return PanelContent.of(
        np.stack([pattern(rng, s_panel) + k for k in range(3)]).astype(np.uint8), frame_time
    )


def test_a_still_exposure_is_one_cell_of_its_length():
    (cell,) = exposure_cells(situation(exposure=0.02), BARE)
    assert cell.weight.tolist() == [0.02]
    assert (cell.shift, cell.path) == ((0.0, 0.0), (0.0, 0.0))


def test_a_lamp_weighs_an_exposure_by_its_mean():
    lamp = Waveform("sine", 100.0, 0.4, 0.3)
    s = situation(replace(STAR, lamp=lamp), exposure=0.0123, moment=0.004)
    (cell,) = exposure_cells(s, BARE.with_changes(lamp=True))
    true = integral(lambda t: 1 + 0.4 * np.sin(2 * np.pi * 100 * t + 0.3), 0.004, 0.0163)
    assert float(cell.weight[0]) == pytest.approx(true, rel=1e-6)


@pytest.mark.parametrize("rolling", [True, False])
@pytest.mark.parametrize("crystal", [True, False])
def test_rows_see_frames_by_their_own_time(rolling, crystal):
    """Each cell's weight by a fine sum over time, row by row."""
    camera = replace(
        CAMERA,
        panel=replace(PANEL, response_time=3e-3),
        sensor=replace(CAMERA.sensor, shutter="rolling" if rolling else "global", line_time=4e-4),
    )
    lamp = Waveform("square", 130.0, 0.6, 0.1)
    shown = video()
    s = situation(
        replace(STAR, lamp=lamp), camera=camera, shown=shown, exposure=0.017, moment=0.0031
    )
    found = exposure_cells(s, BARE.with_changes(lamp=True, rolling=rolling, crystal=crystal))
    n = 200_000
    for row in (0, 7, 19):
        begin = 0.0031 + (row * 4e-4 if rolling else 0)
        t = begin + (np.arange(n) + 0.5) / n * 0.017
        frame = np.floor(t / shown.frame_time).astype(int) % 3
        light = lamp.at(t) * 0.017 / n
        seen = dict.fromkeys(shown.names, 0.0)
        for cell in found:
            weight = float(cell.weight[row if rolling else 0])
            if crystal:
                for span in cell.panel_state.spans:
                    seen[shown.names[span.frame]] += span.share * weight
            else:
                for name, share in cell.panel_state.shares:
                    seen[name] += share * weight
        for k, name in enumerate(shown.names):
            assert seen[name] == pytest.approx(light[frame == k].sum(), abs=2e-6)


def test_a_moving_objects_parts_follow_each_other():
    s = situation(replace(STAR, velocity=(0.1, -0.2)), exposure=0.01, moment=0.5)
    found = exposure_cells(s, BARE.with_changes(motion=4))
    assert [float(c.weight[0]) for c in found] == pytest.approx([0.0025] * 4)
    assert [c.shift[0] for c in found] == pytest.approx(
        [0.1 * (k + 0.5) * 0.0025 for k in range(4)]
    )
    assert found[0].path == pytest.approx((0.1 * 0.0025, -0.2 * 0.0025))


def test_without_motion_the_object_stands_in_the_middle():
    s = situation(replace(STAR, velocity=(0.1, -0.2)), exposure=0.01)
    (cell,) = exposure_cells(s, BARE)
    assert cell.shift == pytest.approx((0.0005, -0.001))
    assert cell.path == (0.0, 0.0)


@pytest.mark.parametrize("exposure", [0.0, -1.0, math.inf, math.nan])
def test_no_exposure_is_refused(exposure):
    with pytest.raises(ValueError, match="exposure"):
        exposure_cells(situation(exposure=exposure), BARE)


def test_too_many_frames_under_a_lamp_are_refused():
    lamp = Waveform("sine", 100.0, 0.4)
    s = situation(replace(STAR, lamp=lamp), shown=video(frame_time=1e-6), exposure=10.0)
    with pytest.raises(ValueError, match="frames"):
        exposure_cells(s, BARE.with_changes(lamp=True))
