import math

import numpy as np
import pytest
import torch

from optics.light import Spectrum
from optics.plane import Plane
from simulator.scene.charts import (
    checker,
    line_pairs,
    outline,
    siemens_star,
    slanted_edge,
    usaf_1951,
)
from simulator.scene.polygons import brick

WIDE = Plane((200, 200), (1e-5, 1e-5))


def sampled(chart, plane=WIDE):
    return chart.light(plane, 1.0).numpy()


def test_an_edge_leans_by_its_angle():
    """The place where each row is half bright, fitted by a line, as ISO 12233 does."""
    chart = slanted_edge(4e-3, math.radians(5), dark=0.1, bright=0.9)
    light = sampled(chart).astype(float)
    # Row by row the bright part's length from the right: edge = right end - length.
    lengths = ((light - 0.1) / 0.8).sum(axis=1)
    rows = np.arange(200) - 100.0
    slope, middle = np.polyfit(rows, 99.5 - lengths, 1)
    # The upper end leans to the right: x falls as y grows.
    assert slope == pytest.approx(-math.tan(math.radians(5)), rel=1e-5)
    assert middle == pytest.approx(0, abs=1e-4)


def test_a_level_edge_is_the_same_turned():
    upright, level = (
        sampled(slanted_edge(4e-3, 0.1, horizontal=turned)) for turned in (False, True)
    )
    assert level == pytest.approx(upright.T, abs=1e-6)


def test_a_siemens_star_has_its_spokes_on_every_circle():
    """Half of it is ink, and going round a circle the light falls and rises `spokes` times."""
    chart = siemens_star(1.8e-3, 12, dark=0.0, bright=1.0)
    light = sampled(chart)
    sheet = (1.1 * 1.8e-3 / 1e-5) ** 2
    assert light.sum() == pytest.approx(sheet - math.pi / 8 * (1.8e-3 / 1e-5) ** 2, rel=1e-4)
    turns = np.linspace(0, 2 * np.pi, 2000, endpoint=False) + 1e-3
    for radius in (40, 80):
        y = np.rint(100 + radius * np.sin(turns)).astype(int)
        x = np.rint(100 + radius * np.cos(turns)).astype(int)
        bright = light[y, x] > 0.5
        assert np.count_nonzero(np.diff(np.append(bright, bright[0]).astype(int)) == 1) == 12


@pytest.mark.parametrize(
    ("group", "element", "pairs"),
    # The published table of MIL-STD-150A, line pairs per millimetre.
    [(-2, 1, 0.250), (-2, 6, 0.445), (0, 1, 1.00), (0, 4, 1.41), (2, 3, 5.04), (5, 5, 50.8),
     (7, 6, 228.0)],
)  # fmt: skip
def test_the_usaf_elements_have_their_published_frequencies(group, element, pairs):
    assert line_pairs(group, element) == pytest.approx(pairs * 1e3, rel=5e-3)


def test_the_usaf_bars_are_as_wide_as_their_gaps_and_five_times_as_long():
    """Group 2 alone, 4 lp/mm: bars of 125 µm, 625 µm long; found in the picture."""
    chart = usaf_1951((2, 2), dark=0.0, bright=1.0)
    plane = Plane((700, 400), (1e-5, 1e-5))
    light = sampled(chart, plane)
    rows = np.flatnonzero(light.max(axis=1) > 0.5)
    columns = np.flatnonzero(light.max(axis=0) > 0.5)
    top, left = rows[0] + 25, columns[0] + 25
    # Down through the level bars of element 1: dark, bright, dark, bright, dark.
    down = light[top : top + 63, left + 30]
    assert (1 - down).sum() == pytest.approx(37.5, abs=0.51)
    assert (1 - light[top + 6, left : left + 70]).sum() == pytest.approx(62.5, abs=0.51)
    # All bars: for each element six of five times their width squared.
    ink = sum(6 * 5 * (0.5 / line_pairs(2, e)) ** 2 for e in range(1, 7)) / 1e-10
    sheet = np.count_nonzero(light.max(axis=1) > 0.5) * np.count_nonzero(light.max(axis=0) > 0.5)
    assert light.sum() == pytest.approx(sheet - ink, rel=0.02)


def test_bars_never_meet():
    """Where two bars overlapped, the light would be less than the ink's."""
    light = sampled(usaf_1951((1, 4), dark=0.05, bright=0.9), Plane((900, 1000), (4e-6, 4e-6)))
    assert light.min() >= 0.05 - 1e-5
    assert light.max() <= 0.9 + 1e-5


def test_a_checkers_patches_have_their_own_reflectances():
    wavelengths = tuple(np.linspace(400e-9, 700e-9, 31))
    rng = np.random.default_rng(3)
    curves = np.abs(rng.normal(0.4, 0.2, (24, 5)) @ np.abs(rng.normal(size=(5, 31))) / 5)
    patches = [Spectrum(wavelengths, tuple(c)) for c in curves]
    painted = checker(patches, 1.2e-3)
    assert len(painted) <= 7
    asked = np.array([404e-9, 555e-9, 690e-9])
    cube = sum(
        torch.from_numpy(sampled(picture))[..., None] * torch.from_numpy(spectrum.at(asked))
        for spectrum, picture in painted
    )
    for k, patch in enumerate(patches):
        row, column = divmod(k, 6)
        y, x = round(100 + (row - 1.5) * 20), round(100 + (column - 2.5) * 20)
        assert cube[y, x].numpy() == pytest.approx(patch.at(asked), rel=2e-3)
    # Between patches there is the frame's grey, in all colours, and nothing outside.
    assert cube[100, 100].numpy() == pytest.approx([0.03] * 3, abs=1e-3)
    assert not cube[10, 10].any()


def test_a_brick_hides_its_body_and_its_studs():
    picture, cover = brick((5e-4, 8e-4), studs=4, offset=(1e-4, 0.0))
    hidden, light = sampled(cover), sampled(picture)
    area = 5e-4 * 8e-4 + 4 * (0.19 * 5e-4) * (0.6 * 2e-4)
    assert hidden.sum() == pytest.approx(area / 1e-10, rel=1e-4)
    assert ((hidden == 0) == (light == 0)).all()
    assert (light <= hidden + 1e-6).all()


def test_an_outline_is_the_sheet():
    chart = siemens_star(1e-3, 8)
    assert sampled(outline(chart)).sum() == pytest.approx((1.1e-3 / 1e-5) ** 2, rel=1e-5)


GREY = Spectrum((4e-7, 7e-7), (0.5, 0.5))


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: slanted_edge(1.0, 1.0), r"angle is 57.*-45° to 45°"),
        (lambda: slanted_edge(-1.0), "size is -1 m"),
        (lambda: slanted_edge(1.0, dark=0.9, bright=0.1), "the darker first"),
        (lambda: siemens_star(1.0, 1), "spokes is 1"),
        (lambda: siemens_star(0.0), "diameter is 0 m"),
        (lambda: usaf_1951((2, 1)), "the coarser first"),
        (lambda: usaf_1951((-9, 1)), "give -4 to 9"),
        (lambda: line_pairs(0, 7), "element is 7"),
        (lambda: checker([GREY] * 3, 1.0), "3 reflectances"),
        (lambda: checker([GREY] * 23 + [Spectrum.flat(1.0)], 1.0), "wavelengths differ"),
        (lambda: checker([GREY] * 24, -1.0), "width is -1 m"),
        (lambda: brick((1.0, 0.0)), "width is 0 m"),
        (lambda: brick((1.0, 1.0), 0), "studs is 0"),
    ],
)
def test_a_chart_that_cannot_be_printed_is_refused(make, words):
    with pytest.raises(ValueError, match=words):
        make()
