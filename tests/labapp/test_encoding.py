"""Levels and light: known values of the standards, and the tables against the curves."""

from __future__ import annotations

import math

import numpy as np
import pytest

from labapp.common.errors import UserError
from labapp.files.picture.encoding import (
    BT709,
    HLG,
    LINEAR,
    PQ,
    SRGB,
    Encoding,
    decode_levels,
    gamma_encoding,
    parse_encoding,
)

ALL = [LINEAR, SRGB, BT709, PQ, HLG, gamma_encoding(2.2)]


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ("linear", "linear"),
        (" sRGB ", "srgb"),
        ("BT709", "bt709"),
        ("rec.709", "bt709"),
        ("gamma 2.2", "gamma 2.2"),
        ("gamma2.2", "gamma 2.2"),
        ("Gamma  1.80", "gamma 1.8"),
        ("gamma 1", "linear"),
        ("pq", "pq"),
    ],
)
def test_an_encoding_is_named_by_a_word(text, name):
    assert parse_encoding(text).name == name
    assert parse_encoding(parse_encoding(text).name).name == name


@pytest.mark.parametrize(
    "text", ["", "rgb", "icc", "gamma", "gamma 0", "gamma 11", "gamma 2,2", "gamma -2", "gamma nan"]
)
def test_other_words_are_answered_with_the_choices(text):
    with pytest.raises(UserError, match=r"encoding is .* Choose linear, srgb, bt709, gamma 2\.2"):
        parse_encoding(text)


@pytest.mark.parametrize(
    ("encoding", "level", "light"),
    [
        # IEC 61966-2-1: the line, and the power at a half and at levels 10 and 128 of 255.
        (SRGB, 0.04045, 0.04045 / 12.92),
        (SRGB, 0.5, 0.21404114),
        (SRGB, 10 / 255, 0.0030352698),
        (SRGB, 128 / 255, 0.21586050),
        # ITU-R BT.709-6, item 1.2.
        (BT709, 0.0405, 0.009),
        (BT709, 1.0992968 * 0.25**0.45 - 0.0992968, 0.25),
        # ITU-R BT.2408, table 1: 100 and 1000 cd/m2 have 0.508 and 0.752 of PQ's levels.
        (PQ, 0.50807842, 0.01),
        (PQ, 0.75182703, 0.1),
        # ITU-R BT.2100-2, table 5: 0.5 is a twelfth.
        (HLG, 0.5, 1 / 12),
        (HLG, 0.75, (math.exp((0.75 - 0.55991073) / 0.17883277) + 0.28466892) / 12),
        (gamma_encoding(2.2), 0.5, 0.5**2.2),
    ],
)
def test_known_levels_have_known_light(encoding, level, light):
    assert encoding.to_light(np.array([level]))[0] == pytest.approx(light, rel=5e-6)
    assert encoding.from_light(np.array([light]))[0] == pytest.approx(level, rel=5e-6)


@pytest.mark.parametrize("encoding", ALL, ids=lambda one: one.name)
@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_there_and_back_is_the_same(encoding, kind):
    levels = np.linspace(0, 1, 1001, dtype=kind)
    light = encoding.to_light(levels)
    assert light.dtype == kind
    assert light[0] == 0
    assert light[-1] == pytest.approx(1, rel=1e-4 if encoding in (HLG,) else 1e-6)
    assert (np.diff(light) > 0).all()
    # The constants of the standards are rounded, so that lines and powers don't meet exactly.
    assert np.abs(encoding.from_light(light) - levels).max() < 2e-5


@pytest.mark.parametrize("encoding", ALL, ids=lambda one: one.name)
def test_levels_below_0_and_above_1_stay_finite(encoding):
    light = encoding.to_light(np.array([-0.5, -0.01, 1.01, 1.05]))
    assert np.isfinite(light).all()
    assert (light[:2] <= 0).all()
    assert (light[2:] > 1).all()


@pytest.mark.parametrize("encoding", ALL, ids=lambda one: one.name)
@pytest.mark.parametrize(
    ("kind", "white"),
    [("u1", 255), ("u2", 65535), ("u2", 4095), (">u2", 1023), ("u4", 2**32 - 1), ("i2", 32767)],
)
def test_levels_are_decoded_as_their_curve_says(encoding, kind, white):
    levels = np.linspace(0, white, 5 * 7 * 3).astype(kind).reshape(3, 5, 7)
    light = decode_levels(levels, white, encoding)
    assert light.dtype == np.float32
    np.testing.assert_allclose(light, encoding.to_light(levels / white), rtol=1e-6, atol=1e-12)


def test_floats_are_decoded_block_by_block_and_linear_ones_keep_their_unit():
    levels = np.random.default_rng(3).random((3, 900, 500))
    expected = SRGB.to_light(levels).astype(np.float32)
    np.testing.assert_array_equal(decode_levels(levels, None, SRGB), expected)
    np.testing.assert_array_equal(
        decode_levels(levels * 1e9, None, LINEAR), (levels * 1e9).astype("f4")
    )


def test_curves_of_a_profile_belong_to_bands():
    nodes = np.linspace(0, 1, 65536)
    curves = Encoding("icc", np.stack([nodes**power for power in (1.0, 2.0, 3.0)]))
    levels = np.full((3, 2, 2), 128, np.uint8)
    for light in (decode_levels(levels, 255, curves), curves.to_light(levels / 255)):
        np.testing.assert_allclose(light[:, 0, 0], [(128 / 255) ** k for k in (1, 2, 3)], rtol=1e-6)
    back = curves.from_light(curves.to_light(levels / 255))
    np.testing.assert_allclose(back, levels / 255, rtol=1e-6)
    for call in (
        lambda: decode_levels(levels[:1], 255, curves),
        lambda: curves.to_light(levels[:1] / 255),
    ):
        with pytest.raises(UserError, match="ICC profile of 3 colours belongs to a grey picture"):
            call()


def test_a_curve_of_a_profile_that_falls_has_no_way_back():
    curve = Encoding("icc", np.array([[0.0, 0.6, 0.5, 1.0]]))
    with pytest.raises(UserError, match="curve of the ICC profile falls"):
        curve.from_light(np.zeros((1, 1, 1)))
