"""A lens' curve of relative illumination, in place of cos⁴, against what it says by hand."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from optical_situations import CAMERA, STAR, finest, rendered, situation

from optics.caching import ByteCache
from optics.camera import Camera, Lens
from simulator.effects.field_effects import Vignetting
from simulator.effects.panel_orders import PanelOrders
from simulator.effects.picture_norms import minimum_norms
from simulator.scene import Flat

CURVE = ((0.0, 1.0), (1e-4, 0.9), (2e-4, 0.75), (4e-4, 0.4))


def camera(curve=CURVE) -> Camera:
    return replace(CAMERA, lens=replace(CAMERA.lens, relative_illumination=curve))


def shares(curve=CURVE) -> np.ndarray:
    """Of each pixel, linear in the square of its height: loops over pixels and pairs."""
    rows, columns = CAMERA.sensor.shape
    found = np.empty((rows, columns))
    for i in range(rows):
        for j in range(columns):
            squared = ((i - rows // 2) ** 2 + (j - columns // 2) ** 2) * CAMERA.sensor.pitch**2
            for (a, low), (b, high) in pairwise(curve):
                if a**2 <= squared <= b**2:
                    found[i, j] = low + (high - low) * (squared - a**2) / (b**2 - a**2)
    return found


def test_even_light_falls_by_the_curve():
    s = situation(Flat(1.0, 1e7), camera())
    levels = {"PSF reach": 0, "light sampling": 2}
    lit = rendered(s, levels | {"vignetting": 1}, ByteCache())
    bare = rendered(s, levels, ByteCache())
    wanted = bare * shares()
    assert np.abs(lit - wanted).max() <= 0.01 * bare.max()
    assert np.linalg.norm(lit - wanted) <= 0.005 * np.linalg.norm(wanted)
    # What is left out is bounded, and the least light is known.
    change = np.linalg.norm(lit - bare)
    assert change <= Vignetting().error_bound(s, 0).mean <= 4 * change
    assert minimum_norms(s).mean <= np.linalg.norm(lit)


def test_a_star_has_the_share_of_its_image():
    scale = CAMERA.magnification(1.0)
    star = replace(STAR, offset=(1e-4 / scale, 1.2e-4 / scale))
    s = situation(star, camera())
    whole = finest(s) | {"panel orders": 0, "vignetting": 0}
    cache = ByteCache()
    bare, lit = (rendered(s, whole | {"vignetting": on}, cache).sum() for on in (0, 1))
    assert lit / bare == pytest.approx(0.75 + 0.15 * (4 - 2.44) / 3, rel=2e-3)


def test_a_curve_that_rises_again_is_bounded_where_it_is_least():
    """Between the places at which the bound looks."""
    dip = ((0.0, 1.0), (1.1e-4, 1.0), (1.2e-4, 0.3), (1.3e-4, 1.0), (4e-4, 1.0))
    s = situation(Flat(1.0, 1e7), camera(dip))
    change = np.linalg.norm(
        rendered(s, {"light sampling": 2, "vignetting": 1}, ByteCache())
        - rendered(s, {"light sampling": 2}, ByteCache())
    )
    assert 0 < change <= Vignetting().error_bound(s, 0).mean


@pytest.mark.parametrize(
    ("curve", "words"),
    [
        (((0.0, 1.0),), "give two pairs or more"),
        (((0.0, 0.9), (1e-3, 0.8)), r"the first of them \[0, 1\]"),
        (((0.0, 1.0), (1e-3, 0.8), (1e-3, 0.7)), "1 mm after 1 mm"),
        (((0.0, 1.0), (1e-3, 0.0)), "is 0 at 1 mm"),
        (((0.0, 1.0), (1e-3, 1.1)), r"is 1\.1 at 1 mm"),
        (((0.0, 1.0), (1e-3, float("nan"))), "is nan at 1 mm"),
    ],
)
def test_a_curve_that_cannot_be_is_refused(curve, words):
    with pytest.raises(ValueError, match=words):
        Lens(relative_illumination=curve)


def test_a_curve_that_ends_within_the_sensor_is_refused():
    with pytest.raises(ValueError, match=r"ends at 0\.1 mm, and the sensor's corner is 0\.31"):
        camera(((0.0, 1.0), (1e-4, 0.9)))


@pytest.mark.parametrize(
    ("curve", "gaps"),
    [
        (((0.0, 1.0), (6e-4, 1.0), (3e-3, 0.2)), {}),
        (((0.0, 1.0), (4e-4, 1.0), (5e-4, 0.8)), {"fill_factor": 0.5, "gap_reflection": 0.9}),
    ],
)
def test_light_that_orders_bring_from_dark_places_is_bounded(curve, gaps):
    """Even light, which blur doesn't change, isn't even beside the frame: a fifth is lost there.

    Gaps that reflect in phase with the pixels send more light than these.
    """
    dark = camera(curve)
    panel = replace(dark.panel, **gaps)
    s = situation(
        Flat(1.0, 1e7), replace(dark, panel=panel, sensor=replace(dark.sensor, pitch=4e-6))
    )
    levels = finest(s) | {"light sampling": 0, "pixel aperture": 0}
    cache = ByteCache()
    full = rendered(s, levels, cache)
    for effect, level in ((PanelOrders(), 0), (PanelOrders(), 1), (Vignetting(), 0)):
        change = np.linalg.norm(rendered(s, levels | {effect.name: level}, cache) - full)
        least, most = 0.002 * np.linalg.norm(full), effect.error_bound(s, level).mean
        assert least < change <= most, effect.name
