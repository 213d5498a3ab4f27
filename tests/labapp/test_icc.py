"""Curves of ICC profiles: read as lcms uses them, and written so that lcms takes them."""

from __future__ import annotations

import contextlib
import io
import struct

import colour
import imagecodecs
import numpy as np
import pytest
from PIL import Image, ImageCms

from labapp.common.errors import UserError
from labapp.files.picture.encoding import LINEAR, SRGB, Encoding
from labapp.files.picture.icc import PRIMARIES, icc_encoding, icc_profile
from labapp.files.picture.photograph import read_photograph

SRGB_PRIMARIES = [0.64, 0.33, 1.0, 0.3, 0.6, 1.0, 0.15, 0.06, 1.0]
"""x, y and Y of the primaries (IEC 61966-2-1)."""


def pillow_srgb() -> bytes:
    return ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()


def with_tags(profile: bytes, changed: dict[bytes, bytes | None]) -> bytes:
    """A profile with tags changed or left out, put together by the format's definition."""
    (count,) = struct.unpack_from(">I", profile, 128)
    tags = {}
    for k in range(count):
        name, at, size = struct.unpack_from(">4sII", profile, 132 + 12 * k)
        tags[name] = profile[at : at + size]
    tags = {name: tag for name, tag in {**tags, **changed}.items() if tag is not None}
    at, table, body = 132 + 12 * len(tags), b"", b""
    for name, tag in tags.items():
        table += struct.pack(">4sII", name, at + len(body), len(tag))
        body += tag + bytes(-len(tag) % 4)
    size = struct.pack(">I", at + len(body))
    return size + profile[4:128] + struct.pack(">I", len(tags)) + table + body


def with_curve(curve: bytes) -> bytes:
    return with_tags(pillow_srgb(), dict.fromkeys((b"rTRC", b"gTRC", b"bTRC"), curve))


def light_by_lcms(profile: bytes, levels: np.ndarray) -> np.ndarray:
    """Linear light of levels of 16 bits, (pixels,) or (pixels, 3), in sRGB's primaries, by lcms."""
    colours = np.stack([levels] * 3, axis=-1) if levels.ndim == 1 else levels
    linear = imagecodecs.cms_profile(
        "rgb", whitepoint=[0.3127, 0.329, 1.0], primaries=SRGB_PRIMARIES, gamma=1.0
    )
    return imagecodecs.cms_transform(
        np.ascontiguousarray(colours[None]),
        profile,
        linear,
        colorspace="rgb",
        outcolorspace="rgb",
        outdtype="float32",
        intent=1,
    )[0]


CURVES = {
    "sampled": struct.pack(">4s4xI5H", b"curv", 5, 0, 4000, 16000, 37000, 65535),
    "power": struct.pack(">4s4xIH", b"curv", 1, 461),
    "para 0": struct.pack(">4s4xHxxi", b"para", 0, round(65536 * 1.8)),
    "para 1": struct.pack(">4s4xHxx3i", b"para", 1, *(round(65536 * x) for x in (2.0, 0.9, 0.1))),
    "para 2": struct.pack(
        ">4s4xHxx4i", b"para", 2, *(round(65536 * x) for x in (2.0, 0.9, -0.1, 0.2))
    ),
    "para 3": struct.pack(
        ">4s4xHxx5i", b"para", 3, *(round(65536 * x) for x in (3.0, 0.862, 0.138, 0.1107, 0.08))
    ),
    "para 4": struct.pack(
        ">4s4xHxx7i",
        b"para",
        4,
        *(round(65536 * x) for x in (2.0, 0.9, 0.1, 0.3, 0.1, 0.0, -0.01)),
    ),
}


@pytest.mark.parametrize("name", CURVES)
def test_curves_are_those_that_lcms_uses(name):
    profile = with_curve(CURVES[name])
    levels = np.linspace(0, 65535, 400).astype(np.uint16)
    found = icc_encoding(profile).encoding
    assert found is not None
    ours = found.to_light(levels / 65535)
    theirs = light_by_lcms(profile, levels)
    np.testing.assert_allclose(ours, theirs[:, 1].clip(0), atol=2e-4)


def test_the_profile_of_srgb_is_known_by_its_curve():
    stated = icc_encoding(pillow_srgb())
    assert stated.encoding is SRGB
    assert "sRGB" in stated.source
    assert stated.notes == ()
    # As version 2 has it: a table of 1024 numbers of 16 bits.
    table = np.rint(65535 * SRGB.to_light(np.linspace(0, 1, 1024))).astype(">u2").tobytes()
    assert icc_encoding(with_curve(struct.pack(">4s4xI", b"curv", 1024) + table)).encoding is SRGB


def test_plain_powers_have_their_name():
    for curve, name in (
        (struct.pack(">4s4xI", b"curv", 0), "linear"),
        (struct.pack(">4s4xIH", b"curv", 1, 256), "linear"),
        (struct.pack(">4s4xIH", b"curv", 1, 563), "gamma 2.19921875"),
        (struct.pack(">4s4xHxxi", b"para", 0, round(65536 * 2.2)), "gamma 2.2"),
    ):
        found = icc_encoding(with_curve(curve)).encoding
        assert found is not None
        assert found.name == name


def test_three_curves_are_applied_each_to_its_colour():
    three = dict(
        zip(
            (b"rTRC", b"gTRC", b"bTRC"),
            (CURVES["power"], CURVES["para 0"], CURVES["sampled"]),
            strict=True,
        )
    )
    profile = with_tags(pillow_srgb(), three)
    found = icc_encoding(profile).encoding
    assert found is not None
    assert found.name == "icc"
    levels = np.linspace(0, 65535, 50).astype(np.uint16)
    ours = found.to_light(np.broadcast_to(levels / 65535, (3, 1, 50)))
    np.testing.assert_allclose(ours[:, 0].T, light_by_lcms(profile, levels), atol=4e-4)


def test_other_primaries_are_told():
    wide = with_tags(
        pillow_srgb(),
        {
            b"rXYZ": struct.pack(
                ">4s4x3i", b"XYZ ", *(round(65536 * x) for x in (0.515, 0.241, -0.001))
            )
        },
    )
    (note,) = icc_encoding(wide).notes
    assert "its colours are those of its ICC profile" in note
    assert "not sRGB's; they are kept" in note


def test_a_profile_of_tables_alone_is_refused_by_its_name():
    without = dict.fromkeys((b"rTRC", b"gTRC", b"bTRC"))
    profile = with_tags(pillow_srgb(), {**without, b"A2B0": b"mft2" + bytes(60)})
    with pytest.raises(UserError, match=r'ICC profile ".*" has a table of colours .* name its enc'):
        icc_encoding(profile)


def test_whoever_names_the_encoding_needs_no_profile(tmp_path):
    """The remedy that the refusal prints helps, in TIFF as in PNG."""
    without = dict.fromkeys((b"rTRC", b"gTRC", b"bTRC"))
    profile = with_tags(pillow_srgb(), {**without, b"A2B0": b"mft2" + bytes(60)})
    levels = np.full((4, 5, 3), 188, np.uint8)
    for name in ("a.tiff", "a.png"):
        Image.fromarray(levels).save(tmp_path / name, icc_profile=profile)
        with pytest.raises(UserError, match=rf"{name}: .*has a table of colours"):
            read_photograph(tmp_path / name)
        # Level 188 is half the light of white (IEC 61966-2-1).
        light = read_photograph(tmp_path / name, encoding=SRGB).light
        assert light == pytest.approx(0.5, abs=3e-3)


@pytest.mark.parametrize(
    "curve",
    [
        b"curv",
        b"nono" + bytes(20),
        struct.pack(">4s4xI", b"curv", 2**32 - 1),
        struct.pack(">4s4xIH", b"curv", 1, 0),
        struct.pack(">4s4xHxxi", b"para", 9, 1),
        struct.pack(">4s4xHxx3i", b"para", 1, 65536, 0, 0),
        struct.pack(">4s4xHxxi", b"para", 0, -65536),
        struct.pack(">4s4xHxx5i", b"para", 3, -(2**31), 65536, 0, 0, 0),
    ],
)
def test_curves_that_make_no_sense_are_told(curve):
    stated = icc_encoding(with_curve(curve))
    assert stated.encoding is None
    assert "can't be read" in stated.notes[0]


def test_damaged_profiles_are_told():
    profile = pillow_srgb()
    for hurt in (b"", b"x" * 400, profile[:140], profile[:-200]):
        stated = icc_encoding(hurt)
        assert stated.encoding is None
        assert stated.notes
    generator = np.random.default_rng(4)
    for _ in range(40):
        noisy = np.frombuffer(profile, np.uint8).copy()
        noisy[generator.integers(0, noisy.size, 5)] = generator.integers(0, 256, 5)
        with contextlib.suppress(UserError):
            icc_encoding(noisy.tobytes())


@pytest.mark.parametrize("bands", [1, 3])
@pytest.mark.parametrize("encoding", [LINEAR, SRGB], ids=["linear", "srgb"])
def test_a_profile_that_is_written_is_taken_by_lcms(bands, encoding):
    profile = icc_profile(encoding, bands)
    assert len(profile) < 800
    assert icc_encoding(profile).encoding is encoding
    assert icc_encoding(profile).notes == ()
    read = ImageCms.ImageCmsProfile(io.BytesIO(profile))
    assert read.profile.xcolor_space.strip() == {1: "GRAY", 3: "RGB"}[bands]
    levels = np.linspace(0, 65535, 60).astype(np.uint16)
    if bands == 3:
        light = light_by_lcms(profile, levels)
        np.testing.assert_allclose(light[:, 0], encoding.to_light(levels / 65535), atol=2e-4)
        primaries = (65535 * np.eye(3)).astype(np.uint16)
        np.testing.assert_allclose(light_by_lcms(profile, primaries), np.eye(3), atol=1e-3)


def test_only_known_curves_are_written():
    with pytest.raises(ValueError, match="profiles are written for linear and srgb"):
        icc_profile(Encoding("bt709"))


def test_primaries_are_srgbs_adapted_to_d50():
    space = colour.RGB_COLOURSPACES["sRGB"]
    d50 = (0.9642, 1.0, 0.8249)
    d65 = colour.xy_to_XYZ(space.whitepoint)
    adapted = colour.adaptation.chromatic_adaptation_VonKries(
        space.matrix_RGB_to_XYZ.T, d65, d50, transform="Bradford"
    )
    np.testing.assert_allclose(list(PRIMARIES.values()), adapted, atol=3e-4)
