"""A picture file of a public format together with the array that made it."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from judges.basics import natural_image

Numbers = NDArray[Any]
"""(bands, rows, columns), bands 1 or 3 (red, green, blue)."""


@dataclass(frozen=True, eq=False)
class PictureFile:
    """A file and what a reader must find in it.

    numbers: as the file's bits say them, photometric and palette applied, alpha left out; None
    where only `light` counts (colour spaces that have to be converted).
    also: numbers that are right as well, such as both readings of an associated alpha, and how
    far from them, in shares of white, a reader may be.
    encodings: that a reader may claim; several where the format leaves it open.
    light: relative to white = 1, where it isn't `numbers` under the encoding that is claimed.
    loss: rms error in shares of white that the file's own compression may make; 0 means exact.
    must_tell: a note has to hold one of these words; must_name: a refusal has to, lower case.
    valid: whether a reader that reads everything would read it; others have to be refused.
    """

    path: Path
    numbers: Numbers | None = None
    encodings: tuple[str, ...] = ("linear",)
    white: float | None = None
    also: tuple[Numbers, ...] = ()
    also_loss: float = 0.0
    light: Numbers | None = None
    loss: float = 0.0
    orientation: int = 1
    pages: tuple[Numbers, ...] = ()
    exposure: dict[str, float] = field(default_factory=dict)
    is_mosaic: bool = False
    valid: bool = True
    must_tell: tuple[str, ...] = ()
    must_name: tuple[str, ...] = ()
    page: int | None = None

    def lights(self, encoding: str) -> Iterator[Numbers]:
        """Every right light under an encoding, white 1, and for linear ones in the file's unit."""
        if self.light is not None:
            yield self.light
            return
        assert self.numbers is not None
        for numbers in (self.numbers, *self.also):
            values = numbers.astype(np.float64)
            if encoding == "linear":
                yield values
                # Fewer bits than 8 may be spread over 8.
                yield values * (255 / self.white if self.white and self.white < 255 else 1)
            if self.white:
                yield decoded(values / self.white, encoding)


Maker = Callable[[np.random.Generator, Path], PictureFile]
"""Writes a file at a path (which may get another ending) and says what is in it."""

KINDS: dict[str, Maker] = {}


def add_kind(name: str, maker: Maker) -> None:
    """Register a kind of file under a name of its own."""
    assert name not in KINDS, name
    KINDS[name] = maker


def make_file(kind: str, seed: int, folder: Path) -> PictureFile:
    """Draw a file of a kind: the same kind and seed give the same file."""
    number = zlib.crc32(kind.encode())
    # The name says nothing of the kind: a message that holds it must not pass for one that tells.
    return KINDS[kind](np.random.default_rng([seed, number]), folder / f"p{number:08x}-{seed}")


def size(rng: np.random.Generator) -> tuple[int, int]:
    """Rows and columns, odd and unequal, so that no tile, strip or block of 8 fits them."""
    rows, columns = (2 * rng.choice(range(18, 35), 2, replace=False) + 1).tolist()
    return rows, columns


def scene(rng: np.random.Generator, bands: int = 3, at: tuple[int, int] | None = None) -> Numbers:
    """Light of a random scene between 0 and 1, other structure in each band."""
    rows, columns = at or size(rng)
    seeds = rng.integers(1 << 31, size=bands)
    return np.stack([natural_image(rows, columns, int(seed)) for seed in seeds])


def smooth_scene(rng: np.random.Generator, bands: int = 3) -> Numbers:
    """Waves that a lossy format keeps: slow, and of other direction in each band."""
    rows, columns = size(rng)
    y, x = np.mgrid[:rows, :columns] / 64.0
    waves = []
    for _ in range(bands):
        fy, fx, phase = rng.uniform(0.6, 1.4), rng.uniform(-1.4, 1.4), rng.uniform(0, 6.28)
        waves.append(0.5 + 0.35 * np.sin(6.283 * (fy * y + fx * x) + phase) * (0.4 + 0.6 * x / 1.1))
    return np.clip(np.stack(waves), 0.02, 0.98)


def quantised(light: Numbers, bits: int) -> Numbers:
    """Whole numbers of so many bits."""
    top = 2**bits - 1
    if bits == 1:
        return (light > np.median(light)).astype(np.uint8)
    dtype = np.uint8 if bits <= 8 else np.uint16 if bits <= 16 else np.uint32
    return np.rint(light * top).astype(dtype)


def last(numbers: Numbers) -> Numbers:
    """(rows, columns, bands), or (rows, columns) of one band, as libraries want it."""
    moved = np.ascontiguousarray(np.moveaxis(numbers, 0, -1))
    return moved[..., 0] if moved.shape[-1] == 1 else moved


def decoded(values: Numbers, encoding: str) -> Numbers:
    """Light of values between 0 and 1: IEC 61966-2-1 for sRGB, a power for "gamma X"."""
    if encoding == "srgb":
        above = ((np.maximum(values, 0.04045) + 0.055) / 1.055) ** 2.4
        return np.where(values <= 0.04045, values / 12.92, above)
    words = encoding.split()
    if len(words) == 2 and words[0] == "gamma":
        return np.maximum(values, 0) ** float(words[1])
    return values


def save(path: Path, ending: str, data: bytes) -> Path:
    """Write bytes beside the path under an ending; the path's own name may hold a dot."""
    target = path.with_name(path.name + ending)
    target.write_bytes(data)
    return target
