"""Frames that can't be, told by their bytes and their noise, and sound ones, which are taken."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from judges import wire_frames as made
from numpy.typing import NDArray

from drivers.aravis.arrivals import BadFrame, FrameArrivals
from drivers.aravis.byte_checks import require_possible_layout, require_possible_numbers
from drivers.aravis.frame_layout import line_distance
from drivers.aravis.noise_checks import NoiseChecks
from drivers.aravis.pixel_formats import FORMATS, unpack, unpack_lines

SHAPE = (48, 64)


def picture(name: str, kind: str = "shading", seed: int = 0, bits: int = 0) -> made.Picture:
    rng = np.random.default_rng(seed)
    all_bits = made.bits_of(name)
    sensor = made.Sensor.drawn(rng, bits or all_bits)
    numbers = sensor.numbers(rng, made.scene(rng, kind, SHAPE))
    return numbers << np.uint16(all_bits - sensor.bits)


def check(data: NDArray[np.uint8], name: str, **how: Any) -> NDArray[np.uint16]:
    form = replace(FORMATS[name], **how)
    image = unpack(data, form, SHAPE)
    require_possible_numbers(image, form)
    NoiseChecks(form, 1).require_noise(image)
    require_possible_layout(data, image, form)
    return image


@pytest.mark.parametrize("kind", ["shading", "dark"])
@pytest.mark.parametrize("name", ["Mono10", "Mono12", "Mono14"])
def test_order_and_justification_are_told_apart_by_the_pixels(name: str, kind: str) -> None:
    there, bits = picture(name, kind, seed=1), made.bits_of(name)
    for data, option, how in (
        (made.words(there, big=True), 'byte_order = "big"', {"byte_order": "big"}),
        (made.words(there, left=16 - bits), 'justification = "left"', {"justification": "left"}),
    ):
        with pytest.raises(BadFrame) as refused:
            check(data, name)
        assert option in refused.value.remedy
        np.testing.assert_array_equal(check(data, name, **how), there)


@pytest.mark.parametrize(
    ("name", "data", "words"),
    [
        ("Mono16", made.words(picture("Mono16"), big=True), "read as big-endian"),
        ("Mono12p", made.sent(picture("Mono12p"), "Mono12Packed"), "read as Mono12Packed"),
        ("Mono12Packed", made.sent(picture("Mono12p"), "Mono12p"), "read as Mono12p"),
        ("Mono10p", made.most_significant_first(picture("Mono10p"), 10), "most significant"),
        ("Mono10Packed", made.sent(picture("Mono12p"), "Mono12Packed"), "leaves zero are set"),
        ("Mono12", made.words(picture("Mono14")), "Mono12 ends at 4095: it is another format"),
        ("Mono12", made.padded(picture("Mono12"), "Mono12", 8)[: 2 * 48 * 64], "4 of padding"),
        ("Mono8", made.padded(picture("Mono8"), "Mono8", 3)[: 48 * 64], "3 of padding"),
    ],
)
def test_bytes_of_another_format_are_named(name: str, data: Any, words: str) -> None:
    with pytest.raises(BadFrame, match=words):
        check(data, name)


@pytest.mark.parametrize("name", ["Mono8", "Mono10", "Mono12p", "Mono16"])
def test_pictures_without_noise_are_named(name: str) -> None:
    rng, top = np.random.default_rng(0), FORMATS[name].full_scale
    for _ in range(20):
        with pytest.raises(BadFrame, match="test pattern"):
            check(made.sent(made.pattern(rng, SHAPE, top), name), name)


@pytest.mark.parametrize("kind", made.SCENES)
@pytest.mark.parametrize(
    "name", ["Mono8", "Mono10p", "Mono10Packed", "Mono12", "Mono12p", "Mono16"]
)
def test_sound_frames_are_taken(name: str, kind: str) -> None:
    for seed in range(8):
        there = picture(name, kind, seed, bits=8 + seed if name == "Mono16" else 0)
        np.testing.assert_array_equal(check(made.sent(there, name), name), there)


def test_a_plateau_at_a_clip_level_that_is_not_told_is_taken() -> None:
    """A converter of 10 bits in words for 12, justified right, as of a star that is clipped."""
    rng, sensor = np.random.default_rng(0), made.Sensor(10, 2e4, 5.0, 10.0)
    y, x = np.indices(SHAPE)
    light = 40.0 * np.exp(-((y - 24) ** 2 + (x - 32) ** 2) / 50)
    there = sensor.numbers(rng, light)
    np.testing.assert_array_equal(check(made.words(there), "Mono12"), there)


def test_black_and_clipped_frames_are_taken_again_and_again() -> None:
    form = FORMATS["Mono12"]
    noise = NoiseChecks(form, 1)
    # A converter of 10 bits clips at 1023.
    for value in (0, 0, 1023, 1023, 4095, 4095):
        image = np.full(SHAPE, value, np.uint16)
        require_possible_numbers(image, form)
        noise.require_noise(image)
        noise.require_new(image)
        require_possible_layout(made.words(image), image, form)


@pytest.mark.parametrize("kind", ["shading", "dark"])
def test_noise_that_comes_again_is_named(kind: str) -> None:
    noise, images = NoiseChecks(FORMATS["Mono12"], 1), [picture("Mono12", kind, n) for n in (1, 2)]
    for image in images:
        noise.require_new(image)
    with pytest.raises(BadFrame, match="an earlier frame came again"):
        noise.require_new(images[0])


def note(size: int, padding: int = 0) -> dict[str, Any]:
    return {"number": 7, "size": size, "padding": [padding, 0], "chunks": False}


def test_padding_that_is_told_is_left_out() -> None:
    there, form = picture("Mono12p"), FORMATS["Mono12p"]
    data = made.padded(there, "Mono12p", 5)
    stride = line_distance(note(data.size, 5), form, SHAPE)
    np.testing.assert_array_equal(unpack_lines(data, form, SHAPE, stride), there)


def test_lines_that_end_within_a_byte_are_read_if_each_is_filled_up() -> None:
    there, form = picture("Mono12p")[:, :33], FORMATS["Mono12p"]
    filled = np.append(there, np.zeros((48, 1), np.uint16), 1)
    data = made.sent(filled, "Mono12p").reshape(48, 51)[:, :50].reshape(-1)
    stride = line_distance(note(data.size), form, there.shape)
    np.testing.assert_array_equal(unpack_lines(data, form, there.shape, stride), there)


@pytest.mark.parametrize(
    ("name", "size", "remedy"),
    [
        ("Mono12p", 1584 - 1, "33 aren't a multiple: give a roi 34 or 32 pixels wide"),
        ("Mono12", 33 * 32 * 2 + 32 * 4, "Give a roi whose lines need no padding"),
    ],
)
def test_a_size_that_does_not_fit_gives_advice_on_the_region(
    name: str, size: int, remedy: str
) -> None:
    with pytest.raises(BadFrame) as refused:
        line_distance(note(size), FORMATS[name], (32, 33))
    assert remedy in refused.value.remedy


@pytest.mark.parametrize(
    ("stamp", "words"),
    [(1, "stands still"), (0, "went back"), (4_200_000_000, "counted"), (3_700_000_000, "counted")],
)
def test_a_wrong_clock_is_named(stamp: int, words: str) -> None:
    arrivals = FrameArrivals()
    arrivals.require_right_clock({"stamp": 1, "arrived": 1.1}, 1.0)
    with pytest.raises(BadFrame, match=words):
        arrivals.require_right_clock({"stamp": stamp, "arrived": 5.1}, 5.0)


@pytest.mark.parametrize("triggered", [True, False])
@pytest.mark.parametrize("rate", [1e9, 1e9 * (1 + 1e-4), 0.0])
def test_clocks_that_are_right_or_missing_are_taken(rate: float, triggered: bool) -> None:
    arrivals, rng = FrameArrivals(), np.random.default_rng(0)
    for second in range(1000):
        # A busy computer notices frames late.
        note = {
            "stamp": int(rate * (second + 0.02)),
            "arrived": second + 0.03 + rng.exponential(0.3),
        }
        arrivals.require_right_clock(note, float(second) if triggered else None)
