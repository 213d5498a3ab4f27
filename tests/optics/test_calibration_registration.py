"""Registration of panel and sensor, judged by a bench that computes its light another way."""

from __future__ import annotations

import numpy as np
import pytest
from judges.calibration_bench import NumpyBench, curve, mapped, turned

from optics.camera import Sensor
from optics.measuring.gratings import blazed_grating_phase, registration_vectors
from optics.measuring.registration import decompose_affine, register
from optics.measuring.spots import Spot, find_spot, frame_variance, measure_spot, without_hot_pixels

WAVELENGTH = 532e-9


def described(bench):
    return Sensor(shape=bench.sensor, gain=bench.gain, read_noise=bench.read_noise)


def seen(bench, reach, seconds=4e-3):
    """Vectors and the spots that a panel shows which is described by `reach` radians."""
    sensor = described(bench)
    dark = bench.dark()
    neutral = bench.frame(np.zeros(bench.panel, np.uint8), seconds)
    noise = frame_variance(neutral, sensor) + frame_variance(dark, sensor)
    spots = [find_spot(neutral - dark, noise)]
    compass = registration_vectors(0.23)
    for vector in compass:
        wave = np.mod(blazed_grating_phase(bench.panel, vector), 2 * np.pi)
        frame = bench.frame(np.round(wave / reach * 255).astype(np.uint8), seconds)
        spots.append(find_spot(frame - neutral, frame_variance(frame, sensor) + noise))
    return np.array([(0.0, 0.0), *compass]), spots


@pytest.mark.parametrize(
    ("degrees", "flip_x", "flip_y"),
    [
        (-5, False, True),
        pytest.param(3, True, False, marks=pytest.mark.sweep),
        pytest.param(170, False, False, marks=pytest.mark.sweep),
    ],
)
def test_a_turned_and_mirrored_panel_with_an_unknown_response_is_found(degrees, flip_x, flip_y):
    """Distorted by ten percent and differently in four regions, with noise and hot pixels: the
    corners of the frame come out to a twentieth of a pixel."""
    reach = 6.7 * np.pi
    phases = np.stack(
        [curve(reach * (1.1 + 0.02 * k), 1.15 - 0.05 * k, 0.01 * (k - 1)) for k in range(4)]
    ).reshape(2, 2, -1)
    matrix = turned(degrees, flip_x, flip_y, stretch=1.02)
    bench = NumpyBench(phases, matrix, unmodulated=0.05, finer=2)
    found = register(*seen(bench, reach), WAVELENGTH)
    corners = np.array([(0, 0), (0, 159), (119, 0), (119, 159)], float)
    vectors = (corners - np.array(bench.centre)) @ np.linalg.inv(matrix).T
    assert np.abs(found.to_pixels(vectors) - corners).max() < 0.05
    assert found.inliers.all()
    assert found.field_uncertainty(bench.sensor) < 0.05
    np.testing.assert_allclose(found.to_vectors(corners), vectors, atol=1e-3)


def exact(matrix, centre, vectors):
    places = np.asarray(centre) + vectors @ np.asarray(matrix).T
    return [Spot(y, x, 0.01, 1e4, 10.0) for y, x in places]


def test_spots_that_are_none_of_the_panel_are_left_out(rng):
    matrix, centre = turned(7.0, True), (60.0, 80.0)
    vectors = np.array([(0.0, 0.0), *registration_vectors(0.2)])
    spots = exact(matrix, centre, vectors)
    spots[3] = Spot(30.0, 40.0, 0.01, 1e4, 10.0)
    spots[5] = Spot(90.0, 11.0, 0.01, 1e4, 10.0)
    found = register(vectors, spots, WAVELENGTH)
    assert found.inliers.tolist() == [True, True, True, False, True, False, True]
    np.testing.assert_allclose(found.matrix, matrix, atol=1e-9)
    assert found.centre == pytest.approx(centre)


def test_a_shift_of_all_steered_spots_is_not_taken_for_the_map():
    matrix, vectors = turned(0.0), np.array([(0.0, 0.0), *registration_vectors(0.2)])
    spots = exact(matrix, (60.0, 80.0), vectors)
    moved = [spots[0], *exact(matrix, (60.4, 79.8), vectors[1:])]
    found = register(vectors, moved, WAVELENGTH)
    assert found.centre == pytest.approx((60.0, 80.0))
    assert found.shift == pytest.approx((0.4, -0.2))


def test_the_uncertainty_is_the_scatter_of_repeated_calibrations(rng):
    """Of 200 calibrations whose spots have a noise of 0.05 pixels."""
    matrix, vectors = turned(3.0), np.array([(0.0, 0.0), *registration_vectors(0.2)])
    corner = np.array([0.3, -0.25])
    landed, said = [], []
    for _ in range(200):
        spots = [
            Spot(s.y + rng.normal(0, 0.05), s.x + rng.normal(0, 0.05), 0.05, 1e4, 10.0)
            for s in exact(matrix, (60.0, 80.0), vectors)
        ]
        found = register(vectors, spots, WAVELENGTH)
        landed.append(found.to_pixels(corner))
        said.append(float(found.uncertainty(corner)))
    assert np.std(landed, axis=0) == pytest.approx(np.median(said), rel=0.35)


def test_a_longer_wavelength_sends_light_farther_in_proportion():
    vectors = np.array([(0.0, 0.0), *registration_vectors(0.2)])
    found = register(vectors, exact(turned(0.0), (60.0, 80.0), vectors), WAVELENGTH)
    near, far = found.to_pixels(vectors), found.to_pixels(vectors, 1.2 * WAVELENGTH)
    np.testing.assert_allclose(far - found.centre, 1.2 * (near - found.centre), atol=1e-9)
    np.testing.assert_allclose(found.to_vectors(far, 1.2 * WAVELENGTH), vectors, atol=1e-9)


@pytest.mark.parametrize("degrees", [-60.0, -3.0, 0.0, 12.0, 88.0])
@pytest.mark.parametrize("flips", [(False, False), (True, False), (False, True)])
def test_a_matrix_is_taken_apart_into_what_it_was_made_of(degrees, flips):
    flip_x, flip_y = flips
    parts = decompose_affine(turned(degrees, flip_x, flip_y, scale=200.0, stretch=1.1))
    assert parts.flip == {(False, False): "none", (True, False): "left-right"}.get(flips, "up-down")
    assert np.degrees(parts.rotation) == pytest.approx(degrees)
    assert parts.scale == pytest.approx((220.0, 200.0))
    assert parts.shear == pytest.approx(0.0, abs=1e-12)


def test_half_a_turn_is_two_mirrors():
    assert decompose_affine(turned(180.0)).flip == "both"
    assert decompose_affine(turned(180.0)).rotation == pytest.approx(0.0, abs=1e-12)


def test_a_centroid_is_that_of_the_light_wherever_it_falls_between_pixels():
    """Gaussian spots of 1.3 pixels, integrated over pixels by an error function."""
    from scipy.special import erf

    def across(n, centre):
        edges = (np.arange(n + 1) - 0.5 - centre) / (1.3 * np.sqrt(2))
        return np.diff(erf(edges)) / 2

    for y, x in [(20.0, 31.0), (20.5, 31.5), (20.27, 30.81)]:
        light = 1e4 * across(40, y)[:, None] * across(60, x)[None, :]
        spot = measure_spot(light, np.ones_like(light), (21.0, 30.0))
        assert (spot.y, spot.x) == pytest.approx((y, x), abs=2e-3)


def test_the_noise_of_a_centroid_is_the_one_that_it_says(rng):
    y, x = np.mgrid[:41, :41]
    shape = 500 * np.exp(-((y - 20.2) ** 2 + (x - 19.6) ** 2) / (2 * 1.5**2))
    found = [
        measure_spot(shape + rng.normal(0, 20, shape.shape), np.full(shape.shape, 400.0), (20, 20))
        for _ in range(150)
    ]
    assert np.std([spot.y for spot in found]) == pytest.approx(found[0].sigma, rel=0.3)


def test_hot_pixels_go_and_the_finest_star_stays():
    """A star that is a point of the sensor's own pixel width keeps a quarter of its peak in its
    neighbours; a hot pixel keeps nothing there."""
    frame = np.zeros((30, 30))
    frame[10, 10] = 900.0
    frame[20, 19:22] = 130.0, 500.0, 120.0
    frame[19, 20] = frame[21, 20] = 125.0
    clean = without_hot_pixels(frame, np.full(frame.shape, 9.0))
    assert clean[10, 10] == 0
    assert clean[20, 20] == 500


def test_a_dark_frame_has_no_spot(rng):
    frame = rng.normal(0, 2, (50, 60))
    with pytest.raises(ValueError, match=r"no spot stands out of the noise.*expose longer"):
        find_spot(frame, np.full(frame.shape, 4.0))


def test_arrays_that_do_not_fit_are_refused():
    with pytest.raises(ValueError, match="rows and columns"):
        find_spot(np.zeros((3, 4)), np.ones((4, 3)))
    with pytest.raises(ValueError, match="variance positive"):
        find_spot(np.zeros((5, 5)), np.zeros((5, 5)))


@pytest.mark.parametrize(
    ("vectors", "message"),
    [
        (registration_vectors(0.2), "zeroth order"),
        (np.array([(0, 0), (0.1, 0.1), (0.2, 0.1), (0.1, 0.2)]), "needs 4"),
        (np.array([(0, 0), (0.1, 0.1), (0.2, 0.2), (0.05, 0.05), (0.15, 0.15)]), "on a line"),
    ],
)
def test_too_little_for_a_map_is_refused(vectors, message):
    with pytest.raises(ValueError, match=message):
        register(vectors, exact(turned(0.0), (60, 80), vectors), WAVELENGTH)


def test_spots_that_agree_with_nothing_are_refused(rng):
    vectors = np.array([(0.0, 0.0), *registration_vectors(0.2)])
    spots = [Spot(y, x, 0.01, 1e4, 10.0) for y, x in rng.uniform(10, 110, (7, 2))]
    with pytest.raises(ValueError, match="agree on one map"):
        register(vectors, spots, WAVELENGTH)


def test_a_flat_matrix_is_no_registration():
    with pytest.raises(ValueError, match="no registration"):
        decompose_affine(np.array([[1.0, 2.0], [2.0, 4.0]]))


def test_a_registration_without_its_spots_still_maps():
    made = mapped((1.0, 2.0), turned(0.0))
    np.testing.assert_allclose(made.to_pixels(np.array([0.0, 0.1])), [1.0, 21.0])
