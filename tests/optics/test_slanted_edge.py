"""The MTF that is found in an exact picture of an edge is the one that it was made with."""

import functools
import math

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from optics.camera import Camera, Lens, Panel, Sensor
from optics.camera.system_mtf import neutral_panel_otf, system_mtf
from optics.measuring.slanted_edge import measure_edge_response


@functools.cache
def nodes_and_weights(count):
    """They are an eigenvalue problem of that many unknowns: solved once."""
    return np.polynomial.legendre.leggauss(count)


def edge(transfer, cutoff, angle, shape=(120, 100), offset=0.37):
    """Pixels of an edge behind any transfer function of cycles per pixel across it.

    A step's picture is 1/2 + ∫ OTF(f) sin(2π f d) / (π f) df at a distance d; a square pixel
    multiplies the OTF by the sinc of each of its sides.
    """
    nodes, weights = nodes_and_weights(1200)
    f = cutoff * (nodes + 1) / 2
    sides = np.sinc(f * math.cos(angle)) * np.sinc(f * math.sin(angle))
    amount = transfer(f) * sides / (math.pi * f) * weights * cutoff / 2
    y, x = np.mgrid[0 : shape[0], 0 : shape[1]]
    distance = (x - shape[1] / 2 - offset) * math.cos(angle) - (y - shape[0] / 2) * math.sin(angle)
    # Splines through 25 or more places in a pixel: within 1e-6 of the integral at each distance.
    steps = np.linspace(distance.min(), distance.max(), 4001)
    spread = 0.5 + np.sin(2 * np.pi * np.outer(steps, f)) @ amount
    return CubicSpline(steps, spread)(distance)


def with_pixels(transfer, angle, f):
    return np.abs(transfer(f) * np.sinc(f * math.cos(angle)) * np.sinc(f * math.sin(angle)))


NYQUIST = np.linspace(0, 0.5, 26)


@pytest.mark.parametrize("degrees", [-8.0, 3.0, 5.0, 11.0])
@pytest.mark.parametrize("sigma", [0.35, 0.7, 1.5])
def test_a_gaussian_blur_is_found_again(degrees, sigma):
    angle = math.radians(degrees)

    def gaussian(f):
        return np.exp(-2 * (math.pi * sigma * f) ** 2)

    found = measure_edge_response(100 + 900 * edge(gaussian, 3 / sigma / 2, angle))
    assert found.angle == pytest.approx(angle, abs=math.radians(0.02))
    assert found.mtf_at(NYQUIST) == pytest.approx(with_pixels(gaussian, angle, NYQUIST), abs=0.01)


CAMERA = Camera(
    panel=Panel(shape=(1080, 1920), pitch=8e-6), lens=Lens(0.1, 5.6, 2.0), sensor=Sensor()
)


@pytest.mark.parametrize("horizontal", [False, True])
@pytest.mark.parametrize("distance", [2.0, 1.97])
def test_a_cameras_own_transfer_is_found_again(horizontal, distance):
    """Diffraction at panel and stop, which differ along both axes, and defocus."""
    angle = math.radians(5)
    across = math.pi / 2 - angle if horizontal else -angle
    pitch = CAMERA.sensor.pitch

    def transfer(f):
        return neutral_panel_otf(CAMERA, 550e-9, f / pitch, across, distance)

    cutoff = pitch * CAMERA.lens.stop_diameter / (550e-9 * CAMERA.lens.image_distance)
    picture = edge(transfer, cutoff, angle)
    found = measure_edge_response(picture.T if horizontal else picture)
    truth = system_mtf(CAMERA, 550e-9, NYQUIST / pitch, across, distance)
    assert found.horizontal == horizontal
    assert found.mtf_at(NYQUIST) == pytest.approx(truth, abs=0.01)


def test_an_edge_may_fall_instead_of_rising():
    def gaussian(f):
        return np.exp(-2 * (math.pi * 0.7 * f) ** 2)

    picture = edge(gaussian, 2.5, math.radians(5))
    assert measure_edge_response(1 - picture).mtf_at(NYQUIST) == pytest.approx(
        measure_edge_response(picture).mtf_at(NYQUIST), abs=1e-6
    )


def plain(degrees=5.0, **more):
    return edge(lambda f: np.exp(-10 * f**2), 1.5, math.radians(degrees), **more)


@pytest.mark.parametrize(
    ("picture", "message"),
    [
        (np.ones((40, 40)), "picture has no edge: it is the same everywhere"),
        (np.ones((8, 40)), r"picture is \(8, 40\); give 16 rows and columns or more"),
        (np.full((40, 40), math.nan), "picture has numbers that aren't finite"),
        (plain(0.0), "too little to tell 4 places in a pixel; turn it by about 5 degrees"),
        (plain(offset=48.0, shape=(20, 100)), "pixels beside the edge in some row; give 4 or more"),
    ],
)
def test_pictures_without_a_slanted_edge_are_refused(picture, message):
    with pytest.raises(ValueError, match=message):
        measure_edge_response(picture)


def test_only_what_is_known_is_told():
    with pytest.raises(ValueError, match=r"frequencies reach 1\.2 cycles a pixel; 0 to 0.997"):
        measure_edge_response(plain()).mtf_at(1.2)
    with pytest.raises(ValueError, match="oversampling is 0; give 1 or more"):
        measure_edge_response(plain(), 0)
