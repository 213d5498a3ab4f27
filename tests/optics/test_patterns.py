import math
import re
from dataclasses import replace

import numpy as np
import pytest
import torch
from judges import positions

from optics.camera import Camera, Lens, Panel, Sensor
from optics.patterns import axicon, constant_phase, fresnel_lens
from optics.psf import PSFOperator

PANEL = Panel()
WAVELENGTH = 550e-9


def advised(error: ValueError) -> float:
    """The number of metres that the message advises."""
    return float(re.search(r"at (?:least|most) ([0-9.e+-]+) m", str(error)).group(1))


def test_a_constant_is_the_same_everywhere():
    phase = constant_phase(Panel(shape=(2, 3)), 1.5)
    assert phase.tolist() == [[1.5] * 3] * 2


@pytest.mark.parametrize("focal_length", [0.5, -0.5])
def test_a_fresnel_lens_is_the_thin_lens_phase(focal_length):
    """-pi r² / (wavelength f), thesis Eq. 2.14."""
    panel = Panel(shape=(5, 6))
    y, x = positions(5, panel.pitch)[:, None], positions(6, panel.pitch)[None, :]
    truth = -np.pi * (y**2 + x**2) / (WAVELENGTH * focal_length)
    assert np.allclose(fresnel_lens(panel, focal_length, WAVELENGTH).numpy(), truth, atol=1e-12)


def test_a_fresnel_lens_brings_a_nearer_object_into_focus():
    """A lens of f brings 1/d' = 1/d + 1/f to focus: with 2 m and 1 m that is 2/3 m."""
    panel = Panel(shape=(60, 60), pitch=20e-6, unmodulated=0.0)
    camera = Camera(panel, Lens(), Sensor(pitch=8e-6))
    lens = fresnel_lens(panel, 1.0, WAVELENGTH)
    near = PSFOperator(
        camera, 2 / 3, WAVELENGTH, camera.sensor.window_plane((15, 15)), integrate=False, tol=0.1
    )
    sharp = PSFOperator(
        camera, 2.0, WAVELENGTH, camera.sensor.window_plane((15, 15)), integrate=False
    )
    ideal = float(sharp(torch.zeros(panel.shape)).max())
    assert float(near(lens).max()) == pytest.approx(ideal, rel=0.01)
    assert float(near(torch.zeros(panel.shape)).max()) < 0.6 * ideal


@pytest.mark.parametrize("panel", [PANEL, Panel(shape=(333, 777), pitch=6.4e-6)])
@pytest.mark.parametrize("wavelength", [450e-9, 550e-9, 633e-9])
def test_a_lens_that_the_pixels_cannot_show_is_refused_with_one_that_they_can(panel, wavelength):
    """Half a wave per pixel at the edge: f = side x pitch / wavelength."""
    with pytest.raises(ValueError, match=r"focal_length changes .* at least") as caught:
        fresnel_lens(panel, 0.001, wavelength)
    limit = max(panel.shape) * panel.pitch**2 / wavelength
    assert advised(caught.value) == pytest.approx(limit, rel=0.02)
    phase = fresnel_lens(panel, advised(caught.value), wavelength)
    assert float(torch.diff(phase, dim=1).abs().max()) <= math.pi * 1.001
    with pytest.raises(ValueError, match="focal_length"):
        fresnel_lens(panel, -0.97 * limit, wavelength)


def test_a_lens_without_a_focal_length_is_refused():
    for focal_length in (0.0, math.inf, math.nan):
        with pytest.raises(ValueError, match=r"focal_length is .*; it must be finite and not zero"):
            fresnel_lens(PANEL, focal_length, WAVELENGTH)


def test_an_axicon_is_a_cone():
    """A slope s sends light to s wavelength z / 2 pi, so s = 2 pi R / (wavelength z)."""
    panel = Panel(shape=(7, 8))
    r = np.hypot(positions(7, panel.pitch)[:, None], positions(8, panel.pitch)[None, :])
    truth = 2 * np.pi * 100e-6 / (WAVELENGTH * 0.13) * r
    assert np.allclose(axicon(panel, 100e-6, 0.13, WAVELENGTH).numpy(), truth, atol=1e-12)


def test_an_axicon_sends_light_to_a_ring_of_its_radius():
    """The brightest radius, weighted by circumference, is where geometry puts it."""
    panel = Panel(shape=(128, 128), pitch=20e-6, unmodulated=0.0)
    camera = Camera(panel, Lens(), Sensor(pitch=10e-6))
    phase = axicon(panel, 300e-6, camera.lens.image_distance, WAVELENGTH)
    light = PSFOperator(
        camera, 2.0, WAVELENGTH, camera.sensor.window_plane((91, 91)), integrate=False
    )(phase).numpy()
    r = np.hypot(positions(91, 10e-6)[:, None], positions(91, 10e-6)[None, :])
    profile, edges = np.histogram(r, bins=np.arange(0, 450e-6, 10e-6), weights=light)
    assert edges[profile.argmax()] + 5e-6 == pytest.approx(300e-6, abs=25e-6)
    assert light[(r > 230e-6) & (r < 370e-6)].sum() > 0.6 * light.sum()


@pytest.mark.parametrize("sign", [1, -1])
def test_an_axicon_that_the_pixels_cannot_show_is_refused_with_one_that_they_can(sign):
    """Half a wave per pixel: R = wavelength z / (2 pitch), for either sign of the cone."""
    with pytest.raises(ValueError, match=r"radius changes the phase by .* at most") as caught:
        axicon(PANEL, sign * 0.01, 0.1333, WAVELENGTH)
    limit = WAVELENGTH * 0.1333 / (2 * PANEL.pitch)
    assert advised(caught.value) == pytest.approx(limit, rel=0.02)
    assert advised(caught.value) <= limit
    axicon(PANEL, sign * advised(caught.value), 0.1333, WAVELENGTH)


def test_lengths_that_are_not_positive_are_refused_by_name():
    for bad in (0.0, -1.0, math.nan):
        with pytest.raises(ValueError, match=r"wavelength is .*positive"):
            fresnel_lens(PANEL, 1.0, bad)
        with pytest.raises(ValueError, match=r"wavelength is .*positive"):
            axicon(PANEL, 1e-4, 0.13, bad)
        with pytest.raises(ValueError, match=r"distance is .*positive"):
            axicon(PANEL, 1e-4, bad, WAVELENGTH)
    with pytest.raises(ValueError, match=r"radius is nan"):
        axicon(PANEL, math.nan, 0.13, WAVELENGTH)


def test_patterns_fit_the_panel():
    for panel in (PANEL, replace(PANEL, shape=(5, 4))):
        assert constant_phase(panel).shape == panel.shape
        assert fresnel_lens(panel, 10.0, WAVELENGTH).shape == panel.shape
        assert axicon(panel, 1e-5, 0.1, WAVELENGTH).shape == panel.shape
