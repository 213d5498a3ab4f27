"""What a stop's edge scatters into a window, and how much of its error pixels average away."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from optics.accuracy import Budget
from optics.camera import Camera, Lens, Panel
from optics.plane import Plane
from optics.psf.edge_light import EdgeLight
from optics.psf.question import Question

WAVELENGTH = 550e-9


def test_a_fully_lit_disc_scatters_what_bessels_function_says():
    """Of even light, a disc of radius R turns 1 / (pi² R K) into a window from beyond K: the
    square of R J1(2 pi R K) / K is R / (2 pi² K³) on average."""
    panel = Panel((8000, 8000), 0.4e-6, fill_factor=1.0)
    camera = Camera(panel, Lens(0.1, 0.1 / 0.4e-3, 0.4), separation=1e-3)
    window = Plane((2, 2), (1e-7, 1e-7))
    # In focus, and near enough for light of 1e5 cycles a metre to come from the panel.
    question = Question(camera.lens, 0.399, WAVELENGTH, window, 1e-3, Budget(), separation=1e-3)
    edge = EdgeLight(question, camera)
    rays = edge.scattered
    far = np.hypot(rays.frequency[..., 0], rays.frequency[..., 1]) / edge.spread > 2e4
    lost = float(rays.light[far].sum()) / edge.straight
    # A pixel's envelope takes a little of it, at high frequencies.
    # Frequencies are looked at in steps of a fifth.
    assert lost == pytest.approx(1 / (np.pi**2 * 0.2e-3 * 2e4), rel=0.12)


SPECKLE = WAVELENGTH * 0.0513 / 0.6e-3
"""Metres, of a window behind the lens below."""


def behind_a_lens(pixel: float) -> EdgeLight:
    camera = Camera(Panel((100, 130), 8e-6), Lens(0.05, 0.05 / 0.6e-3, 2.0), separation=5e-3)
    window = Plane((40, 40), (SPECKLE, SPECKLE))
    question = Question(camera.lens, 1.5, WAVELENGTH, window, 1e-3, Budget(), separation=5e-3)
    return EdgeLight(replace(question, pixel=(pixel, pixel)), camera)


@pytest.mark.parametrize("speckles", [0.3, 0.8, 1.5])
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
    right = drawn(edge._places, edge._open.light.mean(axis=1))
    wrong = 1e-3 * drawn(edge._at, edge.scattered.light.sum(axis=(1, 2)))
    beat = 2 * (right.conj() * wrong).real
    whole, part = np.abs(right) ** 2, np.mean
    points = np.sqrt(part(beat**2) / part(whole**2))
    pixels = np.sqrt(part(beat.mean(1) ** 2) / part(whole.mean(1) ** 2))
    assert edge.relative(1.0) / single.relative(1.0) == pytest.approx(pixels / points, rel=0.06)


def test_samples_are_not_averaged():
    single = behind_a_lens(0.0)
    assert single.allowed(single.relative(0.01)) == pytest.approx(0.01)
    tiny = replace(single._q, pixel=(1e-9, 1e-9))
    camera = single._camera
    assert EdgeLight(tiny, camera).relative(1.0) == pytest.approx(single.relative(1.0), rel=1e-6)
