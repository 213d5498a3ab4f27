"""Frames as cameras send them, right and wrong, made without the drivers' code.

The layouts are those of the GenICam "Pixel Format Naming Convention" 2.4, section 6: words have the
least significant byte first and are justified right; "p" is a stream of bits, least significant
first; "Packed" has two pixels in three bytes, the high ones outside (GigE Vision 2.0, annex).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Picture = NDArray[np.uint16]
Bytes = NDArray[np.uint8]

SCENES = ("dark", "flat", "stars", "bars", "shading")


def scene(rng: np.random.Generator, kind: str, shape: tuple[int, int]) -> NDArray[np.float64]:
    """Light on the sensor; 1 fills the pixels' wells."""
    y, x = np.indices(shape)
    if kind == "dark":
        return np.zeros(shape)
    if kind == "flat":
        return np.full(shape, rng.uniform(0.15, 1.3))
    if kind == "shading":
        return rng.uniform(0.3, 0.9) * np.cos((x - rng.uniform(0, shape[1])) / shape[1]) ** 2
    if kind == "bars":
        period, turn = rng.uniform(6, 30), rng.uniform(0, np.pi)
        wave = np.sin(2 * np.pi * (x * np.cos(turn) + y * np.sin(turn)) / period)
        return 0.02 + rng.uniform(0.3, 1.2) / (1 + np.exp(-6 * wave))
    light = np.full(shape, 0.002)
    for _ in range(rng.integers(1, 10)):
        far = (y - rng.uniform(0, shape[0])) ** 2 + (x - rng.uniform(0, shape[1])) ** 2
        light += 10 ** rng.uniform(-1.5, 0.7) * np.exp(-far / (2 * rng.uniform(0.8, 3) ** 2))
    return light


@dataclass(frozen=True)
class Sensor:
    """A sensor by EMVA 1288's linear model: bits of its converter, electrons, black level in DN."""

    bits: int
    well: float
    read_noise: float
    black: float

    @staticmethod
    def drawn(rng: np.random.Generator, bits: int) -> Sensor:
        well = 10 ** rng.uniform(3.7, 5.1)
        black = rng.uniform(0.005, 0.03) * 2**bits
        return Sensor(bits, well, rng.uniform(2, 15), black)

    def numbers(self, rng: np.random.Generator, light: NDArray[np.float64]) -> Picture:
        top = 2**self.bits - 1
        electrons = rng.poisson(light * self.well) + rng.normal(0, self.read_noise, light.shape)
        return np.clip(np.rint(electrons / self.well * top + self.black), 0, top).astype(np.uint16)


def bits_of(name: str) -> int:
    return int("".join(letter for letter in name if letter.isdigit()))


def sent(picture: Picture, name: str) -> Bytes:
    """A picture's bytes in a pixel format."""
    if name.endswith("8"):
        return picture.reshape(-1).astype(np.uint8)
    if name.endswith("p"):
        return _bit_stream(picture, bits_of(name), "little")
    if name.endswith("Packed"):
        low = bits_of(name) - 8
        pairs = picture.reshape(-1, 2).astype(int)
        high, rest = pairs >> low, pairs & (1 << low) - 1
        middle = rest[:, 0] | rest[:, 1] << 4
        return np.stack([high[:, 0], middle, high[:, 1]], 1).astype(np.uint8).reshape(-1)
    return words(picture)


def words(picture: Picture, *, big: bool = False, left: int = 0) -> Bytes:
    shifted = (picture.astype(np.uint32) << left).astype(">u2" if big else "<u2")
    return np.frombuffer(shifted.tobytes(), np.uint8)


def most_significant_first(picture: Picture, bits: int) -> Bytes:
    return _bit_stream(picture, bits, "big")


def padded(picture: Picture, name: str, length: int) -> Bytes:
    """Lines with so many bytes of zeros after each."""
    lines = [np.append(sent(line[None], name), np.zeros(length, np.uint8)) for line in picture]
    return np.concatenate(lines)


def _bit_stream(picture: Picture, bits: int, first: str) -> Bytes:
    places = range(bits) if first == "little" else range(bits - 1, -1, -1)
    stream = np.stack([picture.reshape(-1) >> place & 1 for place in places], 1).astype(np.uint8)
    return np.packbits(stream.reshape(-1), bitorder=first)  # type: ignore[call-overload]


def telling(rng: np.random.Generator, shape: tuple[int, int], exposure: float) -> Picture:
    """A picture whose pixels tell its exposure's microseconds, with noise in two lowest bits."""
    return _digits(shape, exposure) << np.uint16(2) | rng.integers(0, 4, shape, dtype=np.uint16)


def tells(image: Picture, exposure: float) -> bool:
    """Whether every pixel of a picture tells this exposure."""
    return np.array_equal(image >> 2, _digits((image.shape[0], image.shape[1]), exposure))


def _digits(shape: tuple[int, int], exposure: float) -> Picture:
    us = round(exposure * 1e6)
    bytes_ = np.array([us >> place & 255 for place in (0, 8, 16, 24)], np.uint16)
    return np.broadcast_to(bytes_[np.arange(shape[1]) % 4], shape)


def pattern(rng: np.random.Generator, shape: tuple[int, int], top: int) -> Picture:
    """A test pattern: ramps, bars or squares, without noise."""
    y, x = np.indices(shape)
    step, level = int(rng.integers(1, 5)), rng.uniform(0.6, 0.8) * top
    made = [
        lambda: step * x % (top + 1),
        lambda: step * y % (top + 1),
        lambda: (x + y) * max(1, top // sum(shape)),
        lambda: np.floor(8 * x / shape[1]) / 8 * top,
        lambda: np.where((x // 8 + y // 8) % 2, level, level / 2),
    ]
    return np.asarray(made[rng.integers(len(made))]()).astype(np.uint16)
