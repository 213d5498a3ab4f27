"""What a stop's edge scatters into a window, and how much of its error pixels average away."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from sweeps import some

from optics.accuracy import Budget
from optics.camera import Camera, Lens, Panel
from optics.camera.stop import Circle, Stop
from optics.plane import Plane
from optics.psf.edge_scatter import StopEdgeScatter, _normal_distance_steps, window_frequencies
from optics.psf.request import PSFRequest

WAVELENGTH = 550e-9


def test_a_fully_lit_disc_scatters_what_bessels_function_says():
    """Of even light, a disc of radius R turns 1 / (pi² R K) into a window from beyond K: the
    square of R J1(2 pi R K) / K is R / (2 pi² K³) on average."""
    panel = Panel((8000, 8000), 0.4e-6, fill_factor=1.0)
    camera = Camera(panel, Lens(0.1, 0.1 / 0.4e-3, 0.4), separation=1e-3)
    window = Plane((2, 2), (1e-7, 1e-7))
    # In focus, and near enough for light of 1e5 cycles a metre to come from the panel.
    question = PSFRequest(camera.lens, 0.399, WAVELENGTH, window, 1e-3, Budget(), separation=1e-3)
    edge = StopEdgeScatter(question, camera)
    rays = edge.scattered_rays
    far = np.hypot(rays.frequency[..., 0], rays.frequency[..., 1]) / edge.shadow_magnification > 2e4
    lost = float(rays.light[far].sum()) / edge.direct_area
    # A pixel's envelope takes a little of it, at high frequencies.
    # Frequencies are looked at in steps of a fifth.
    assert lost == pytest.approx(1 / (np.pi**2 * 0.2e-3 * 2e4), rel=0.12)


SPECKLE = WAVELENGTH * 0.0513 / 0.6e-3
"""Metres, of a window behind the lens below."""


def behind_a_lens(pixel: float) -> StopEdgeScatter:
    camera = Camera(Panel((100, 130), 8e-6), Lens(0.05, 0.05 / 0.6e-3, 2.0), separation=5e-3)
    window = Plane((40, 40), (SPECKLE, SPECKLE))
    question = PSFRequest(camera.lens, 1.5, WAVELENGTH, window, 1e-3, Budget(), separation=5e-3)
    return StopEdgeScatter(replace(question, pixel=(pixel, pixel)), camera)


@pytest.mark.parametrize("speckles", some([0.3, 0.8, 1.5], 0, 2))
def test_pixels_average_the_error_as_in_drawn_speckles(speckles):
    """Waves of random phases from the stop, and weak ones from its edge, one by one."""
    pixel = speckles * SPECKLE
    edge, single = behind_a_lens(pixel), behind_a_lens(0.0)
    rng, scale = np.random.default_rng(0), WAVELENGTH * edge._q.lens.image_distance

    def drawn(at, power):
        """The field on 8 x 8 points of a pixel, of 4000 drawings."""
        line = (np.arange(8) + 0.5) / 8 * pixel
        waves = np.exp(2j * np.pi / scale * np.multiply.outer(at, line))
        kernel = np.einsum("ny,nx->nyx", waves[:, 0], waves[:, 1]).reshape(len(at), 64)
        drawings = rng.standard_normal((4000, len(at), 2)) @ [1, 1j]
        return (drawings * np.sqrt(power)) @ kernel

    # Behind this lens the panel's shadow covers the stop, so that all of it is lit alike.
    right = drawn(edge._stop.open_points, edge._direct_rays.light.mean(axis=1))
    wrong = 1e-3 * drawn(edge._edge_points, edge.scattered_rays.light.sum(axis=(1, 2)))
    beat = 2 * (right.conj() * wrong).real
    whole, part = np.abs(right) ** 2, np.mean
    points = np.sqrt(part(beat**2) / part(whole**2))
    pixels = np.sqrt(part(beat.mean(1) ** 2) / part(whole.mean(1) ** 2))
    assert edge.relative_error(1.0) / single.relative_error(1.0) == pytest.approx(
        pixels / points, rel=0.06
    )


def test_samples_are_not_averaged():
    single = behind_a_lens(0.0)
    assert single.allowed_light_loss(single.relative_error(0.01)) == pytest.approx(0.01)
    tiny = replace(single._q, pixel=(1e-9, 1e-9))
    camera = single._camera
    assert StopEdgeScatter(tiny, camera).relative_error(1.0) == pytest.approx(
        single.relative_error(1.0), rel=1e-6
    )


# Rays from the panel to the lens, by geometry.

ROWS, COLUMNS, PITCH, APART, AWAY = 100, 130, 8e-6, 5e-3, 1.5
STOP = 0.6e-3
FIELD = (1e-4, -2e-4)


def off_the_axis(**more) -> StopEdgeScatter:
    lens = Lens(0.05, 0.05 / (2 * STOP), 2.0)
    camera = Camera(Panel((ROWS, COLUMNS), PITCH, fill_factor=0.81), lens, separation=APART)
    window = Plane((42, 32), (SPECKLE, 2 * SPECKLE), more.pop("centre", (0.0, 0.0)))
    question = PSFRequest(
        lens, AWAY, WAVELENGTH, window, 1e-3, Budget(), margin=(1, 1), separation=APART,
        **{"field": FIELD} | more,
    )  # fmt: skip
    return StopEdgeScatter(question, camera)


def test_rays_go_straight_from_the_object_through_the_panel_and_turn_by_their_frequency():
    edge, z = off_the_axis(), off_the_axis()._q.lens.image_distance
    panel, frequency = np.array([1e-4, 2e-4]), np.array([300.0, -900.0])
    source = -np.array(FIELD) / z * (AWAY + APART)
    slope = (panel - source) / AWAY + WAVELENGTH * frequency
    rays = edge.trace_rays(panel + APART * slope, frequency / edge.shadow_magnification)
    np.testing.assert_allclose(rays.panel_position, panel, rtol=1e-9)
    np.testing.assert_allclose(rays.frequency, frequency)
    assert edge.shadow_magnification == pytest.approx(1 + APART / AWAY)
    # Over a Fresnel zone, light of that many cycles a metre is as wide as it has moved.
    assert APART * WAVELENGTH * edge.fresnel_zone_frequency == pytest.approx(
        edge.shadow_magnification / edge.fresnel_zone_frequency
    )


def test_beside_the_panel_there_is_what_its_edges_bend():
    """1 / (2 pi)² of the light at a Fresnel zone from the edge; nothing is lost on the panel."""
    edge = off_the_axis(field=(0.0, 0.0))
    zone = np.sqrt(WAVELENGTH * APART / edge.shadow_magnification)
    # Of an even number of pixels the first lies half of them from the axis.
    low, high = -(ROWS / 2 + 0.5) * PITCH, (COLUMNS / 2 - 0.5) * PITCH
    starts = [(0, 0), (low + 1e-7, 0), (0, high - 1e-7), (low - zone, 0), (0, high + 2 * zone),
              (low - zone, high + 2 * zone), (low - 1e-9, 0)]  # fmt: skip
    rays = edge.trace_rays(np.array(starts) * edge.shadow_magnification, np.zeros((len(starts), 2)))
    one, two = 1 / (2 * np.pi) ** 2, 1 / (4 * np.pi) ** 2
    np.testing.assert_allclose(rays.light, [1, 1, 1, one, two, one * two, 1], rtol=1e-6)
    assert (rays.unbounded_light == 1).all()


@pytest.mark.parametrize("turns", [0.0, 0.4, 0.9, 1.5, 7.0])
def test_pixels_send_their_envelope_and_the_mean_of_its_lobes(turns):
    edge = off_the_axis()
    side = 0.9 * PITCH
    behind = np.array([turns, 0.3]) / side / edge.shadow_magnification
    light = float(edge.trace_rays(np.zeros(2), behind).unbounded_light)
    envelope = np.sinc(turns) ** 2 if turns < 1 else 0.5 / (np.pi * turns) ** 2
    assert light == pytest.approx(envelope * np.sinc(0.3) ** 2)


@pytest.mark.parametrize("stop", [Stop(), Stop(Circle(0.5), (Circle(0.2),))])
def test_all_of_a_stop_is_lit_by_a_panel_that_is_larger_than_it(stop):
    """And what goes into the window is that share of what passes, which is what the panel sends
    to a unit of frequency area: a pixel's own area, of a panel that is lit alike."""
    wide = Camera(Panel((400, 400), PITCH), Lens(0.05, 50.0, 2.0, stop), separation=1e-4)
    window = Plane((12, 22), (3e-6, 4e-6))
    question = PSFRequest(wide.lens, 2.0, WAVELENGTH, window, 1e-3, Budget(), margin=(1, 1),
                        separation=1e-4)  # fmt: skip
    edge = StopEdgeScatter(question, wide)
    area = np.pi * 0.5e-3**2 * (1.0 if stop == Stop() else 0.25 - 0.04)
    assert edge.direct_area == pytest.approx(area, rel=0.03)
    seen = 10 * 20 * 3e-6 * 4e-6 / (WAVELENGTH * wide.lens.image_distance) ** 2
    assert edge.share_per_frequency_area == pytest.approx(
        PITCH**2 * wide.panel.fill_factor, rel=0.04
    )
    assert edge.window_share == pytest.approx(edge.share_per_frequency_area * seen)
    assert edge.speckle_count == pytest.approx(max(1.0, area * seen), rel=0.03)


def test_a_window_is_looked_at_in_its_middle_and_a_third_of_the_way_to_its_sides():
    edge = off_the_axis(centre=(40 * SPECKLE, 0.0))
    # Of 42 and 32 samples, one at each side is margin, and the origin is at half of them.
    middle = np.array([40 * SPECKLE - 0.5 * SPECKLE, -0.5 * 2 * SPECKLE])
    third = np.array([39 / 2 * SPECKLE, 29 / 2 * 2 * SPECKLE]) * 2 / 3
    scale = WAVELENGTH * edge._q.lens.image_distance
    signs = [(0, 0), (1, 1), (1, -1), (-1, 1), (-1, -1)]
    expected = [(middle + third * sign) / scale for sign in np.array(signs)]
    np.testing.assert_allclose(window_frequencies(edge._q), expected, rtol=1e-9)


def test_what_passes_straight_is_what_the_lens_turns_into_the_window():
    """Out of focus by Δ dioptres, the lens turns light at its rim by Δ R / wavelength."""
    edge = off_the_axis(field=(0.0, 0.0))
    rim = np.array([[STOP, 0.0], [0.0, -STOP]])
    blur = (1 / (AWAY + APART) - 1 / 2.0) * STOP / WAVELENGTH
    turned = np.array([[blur, 0], [0, -blur]])
    np.testing.assert_allclose(edge.lens_frequency_shift(rim), turned, atol=1e-9)
    # Whoever wants no derivatives gets the same estimates.
    with torch.no_grad():
        np.testing.assert_allclose(edge.lens_frequency_shift(rim), turned, atol=1e-9)
    low, high = edge.passing_band
    seen, third = (
        edge.max_window_frequency * edge.shadow_magnification,
        abs(window_frequencies(edge._q)).max(axis=0),
    )
    # A place in the window's middle third, turned at the rim; and half of the window around it.
    most = edge.shadow_magnification * (third + abs(blur))
    assert (high > 0).all()
    assert (low < 0).all()
    assert (high <= most + seen / 2 + 1e-6).all()
    # Only what the panel lights counts, and it ends before the stop does along y.
    assert (high > 0.5 * (most + seen / 2)).all()
    scale = WAVELENGTH * edge._q.lens.image_distance
    np.testing.assert_allclose(edge.max_window_frequency, np.array([21, 32]) * SPECKLE / scale)


def fields() -> torch.Tensor:
    y, x = np.mgrid[:ROWS, :COLUMNS]
    random = np.exp(2j * np.pi * np.random.default_rng(1).random((ROWS, COLUMNS)))
    return torch.from_numpy(np.stack([np.ones_like(random), (-1.0) ** (x + y) + 0j, random]))


def test_a_pattern_is_as_bright_where_light_passes_as_its_spectrum_says():
    """By a direct sum over frequencies in the band, of each pixel's wave under its envelope."""
    edge = off_the_axis(field=(0.0, 0.0))
    low, high = edge.passing_band
    side, found = 0.9 * PITCH, []
    lines = [np.linspace(low[k], high[k], 301) for k in (0, 1)]
    steps = [line[1] - line[0] for line in lines]
    even = [(np.sinc(line * side) ** 2).sum() * step * side for line, step in
            zip(lines, steps, strict=True)]  # fmt: skip
    y, x = ((np.arange(n) - n // 2) * PITCH for n in (ROWS, COLUMNS))
    waves = [np.exp(-2j * np.pi * np.outer(f, at)) for f, at in zip(lines, (y, x), strict=True)]
    envelope = np.outer(*(np.sinc(line * side) ** 2 for line in lines))
    for field in fields().numpy():
        sent = np.abs(waves[0] @ field @ waves[1].T) ** 2 * envelope
        sent = sent.sum() * np.prod(steps) * side**2 / (np.abs(field) ** 2).sum()
        found.append(sent / np.prod(even))
    assert edge.passing_share == pytest.approx(np.prod(even), rel=0.02)
    for field, expected in zip(fields(), found, strict=True):
        least, most = edge.passing_brightness(field)
        assert least == most == pytest.approx(expected, rel=0.03, abs=1e-3)
    assert edge.passing_brightness(fields()) == pytest.approx(
        (min(found), max(found)), rel=0.03, abs=1e-3
    )
    assert found[0] > 2 * found[2]
    assert edge.passing_brightness(fields()[:0]) == (1.0, 1.0)


def test_steps_in_distance_are_even_near_the_edges_own_frequency_and_then_by_a_factor():
    steps = _normal_distance_steps(10.0, 1000.0, 89)
    np.testing.assert_allclose(steps[:, :7], np.broadcast_to(np.arange(7) / 6 * 10, (89, 7)))
    assert (np.diff(steps[:, 7:], axis=1) > 0).all()
    factors = steps[:, 8:] / steps[:, 7:-1]
    np.testing.assert_allclose(factors, 100 ** (1 / 48))
    # The first of each piece: neighbours fill each other's gaps, so that all are met evenly.
    first = np.sort(np.log(steps[:, 7] / 10.0) / np.log(100) * 48)
    assert 0 <= first[0] < 0.05
    assert 0.95 < first[-1] < 1
    assert np.diff(first).max() < 2.7 / 89


def test_a_few_speckles_may_be_wronger_than_many():
    """In the window, and along the rim, where one is as wide as the light that a panel spreads."""
    edge = off_the_axis()
    wide = np.sqrt(ROWS * COLUMNS) * PITCH
    at_the_rim = 2 * np.pi * STOP / (WAVELENGTH * APART / (1 + APART / AWAY) / wide)
    assert 0.01 * edge.safety_factor == pytest.approx(
        0.01 * (1.3 + 2.5 / np.sqrt(edge.speckle_count) + 4 / np.sqrt(at_the_rim)), rel=1e-3
    )
    assert edge.relative_error(edge.allowed_light_loss(0.02)) == pytest.approx(0.02)


def test_a_collapsed_stop_is_wrong_by_the_phase_that_its_scattered_light_has_run_on():
    """So little apart that no phase turns far, its error goes with the way between both planes;
    of light that is scattered by a way that passes, only a part."""
    errors = []
    for apart in (1e-7, 2e-7):
        camera = Camera(Panel((400, 400), PITCH), Lens(0.05, 50.0, 2.0), separation=apart)
        window = Plane((20, 20), (3e-6, 3e-6))
        question = PSFRequest(camera.lens, 2.0, WAVELENGTH, window, 1e-3, Budget(),
                            separation=apart)  # fmt: skip
        edge = StopEdgeScatter(question, camera)
        rays = edge.scattered_rays
        behind = edge._window - edge.lens_frequency_shift(edge._edge_points)[:, None]
        goes = (edge.shadow_magnification * behind) ** 2
        apart_by = (rays.frequency**2).sum(-1) - goes.sum(-1)[:, :, None]
        turned = np.pi * WAVELENGTH * apart / edge.shadow_magnification * apart_by
        lost = float((rays.light * 4 * np.sin(turned / 2) ** 2).sum())
        error, passing_share = edge.collapse_error()
        errors.append(error)
        assert errors[-1] == pytest.approx(edge.relative_error(lost), rel=0.02)
        assert 0 < passing_share < 1
    assert errors[1] == pytest.approx(2 * errors[0], rel=0.05)
