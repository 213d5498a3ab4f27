"""Pixel formats: every bit where the convention says, against a slow unpacker of its own."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from drivers.aravis.pixel_formats import FORMATS, PixelFormat, unpack
from simulator.wire.fake_gige import pack_pixels


def bit(data: NDArray[np.uint8], index: int) -> int:
    return int(data[index // 8]) >> index % 8 & 1


def number(data: NDArray[np.uint8], places: list[int]) -> int:
    """The number whose bits, the least significant first, lie in these places."""
    return sum(bit(data, place) << order for order, place in enumerate(places))


def places(form: PixelFormat, pixel: int) -> list[int]:
    """Where a pixel's bits lie, from the convention's drawings."""
    bits = form.bits
    if form.name.endswith("Packed"):
        # Two pixels in three bytes: high bits in the outer ones, low bits in the middle one's
        # lower and upper half.
        start, extra = pixel // 2 * 24, bits - 8
        low = start + 8 + (4 if pixel % 2 else 0)
        high = start + (16 if pixel % 2 else 0)
        return [low + i for i in range(extra)] + [high + i for i in range(8)]
    step = bits if form.name.endswith("p") else 8 if bits == 8 else 16
    return [pixel * step + i for i in range(bits)]


def slowly(data: NDArray[np.uint8], form: PixelFormat, shape: tuple[int, int]) -> list[list[int]]:
    flat = [number(data, places(form, pixel)) for pixel in range(shape[0] * shape[1])]
    return [flat[row * shape[1] : (row + 1) * shape[1]] for row in range(shape[0])]


@pytest.mark.parametrize("shape", [(1, 1), (1, 2), (3, 5), (4, 6), (5, 7)])
@pytest.mark.parametrize("form", FORMATS.values(), ids=FORMATS)
def test_random_bytes_become_the_numbers_of_a_slow_unpacker(
    form: PixelFormat, shape: tuple[int, int]
) -> None:
    rng = np.random.default_rng(len(form.name) + shape[1])
    data = rng.integers(0, 256, form.byte_count(shape) + 3, dtype=np.uint8)
    if form.layout == "words":
        # Unused high bits are zero, as the convention has it.
        data[1::2] &= (1 << form.bits - 8) - 1
    image = unpack(data, form, shape)
    assert image.dtype == np.uint16
    assert image.tolist() == slowly(data, form, shape)


@pytest.mark.parametrize("form", FORMATS.values(), ids=FORMATS)
def test_what_was_packed_is_unpacked(form: PixelFormat) -> None:
    rng = np.random.default_rng(1)
    for shape in ((7, 9), (8, 16)):
        image = rng.integers(0, form.full_scale + 1, shape, dtype=np.uint16)
        data = pack_pixels(image, form)
        assert data.size == form.byte_count(shape)
        np.testing.assert_array_equal(unpack(data, form, shape), image)


@pytest.mark.parametrize(
    ("name", "data", "numbers"),
    [
        ("Mono12p", [0x21, 0x43, 0x65], [0x321, 0x654]),
        ("Mono10p", [0x01, 0x08, 0x30, 0x00, 0x01], [1, 2, 3, 4]),
        ("Mono12Packed", [0x32, 0x41, 0x65], [0x321, 0x654]),
        ("BayerRG12Packed", [0xFF, 0x0F, 0x00], [0xFFF, 0]),
        ("Mono10Packed", [0x80, 0x21, 0x40], [0x201, 0x102]),
        ("Mono16", [0x34, 0x12, 0xFF, 0xFF], [0x1234, 0xFFFF]),
    ],
)
def test_layouts_by_hand(name: str, data: list[int], numbers: list[int]) -> None:
    form = FORMATS[name]
    image = unpack(np.array(data, np.uint8), form, (1, len(numbers)))
    assert image.tolist() == [numbers]


def test_too_few_bytes_are_refused() -> None:
    with pytest.raises(ValueError, match="5 bytes; a Mono12p picture"):
        unpack(np.zeros(5, np.uint8), FORMATS["Mono12p"], (2, 2))


def test_a_format_tells_its_pattern_and_full_scale() -> None:
    assert FORMATS["BayerGB12p"].bayer == "GB"
    assert FORMATS["Mono12"].bayer == ""
    assert [FORMATS[f"Mono{bits}"].full_scale for bits in (8, 10, 12, 14, 16)] == [
        255,
        1023,
        4095,
        16383,
        65535,
    ]
