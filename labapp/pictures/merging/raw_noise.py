"""Find gain and read noise of RAW photographs: told, stated by the files, or measured."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from labapp.common.errors import UserError
from labapp.files.raw import RawPhotograph
from labapp.pictures.merging.bracket_files import SensorNumbers, sensor_source
from optics import hdr

_ROUNDING = 1 / 12
"""Variance of rounding to whole numbers, DN², which a stated variance of darkness includes."""

_UNLIKE = 1.1
"""Ratio of the gains that a file states for its colours from which on they are told. Chosen."""

_LEAST_SHARE = 0.8
"""Share of the frames' parts that differ by noise alone from which on their estimate is trusted.
Chosen: where something moves in a fifth of them, gains come out 3 % too small."""


@dataclass(frozen=True)
class FoundNoise:
    """The numbers of a sensor, what they rest on, and doubts, in words."""

    numbers: SensorNumbers
    source: str
    doubts: tuple[str, ...] = ()


def find_noise(
    raws: Sequence[RawPhotograph],
    frames: Sequence[Any],
    darks: Sequence[Any],
    times: Sequence[float],
    told: SensorNumbers,
    sensor_file: Path | None,
) -> FoundNoise:
    """Find gain and read noise.

    They are those that are told; else those of the files' noise profiles, if these are of one kind;
    else those that the frames show. frames: (rows, columns). darks: (1, rows, columns), or numbers.
    Raises UserError if none is known.
    """
    given = replace(told, black=None, full_scale=None)
    source = sensor_source(sensor_file, given)
    if sensor_file is not None or None not in (told.gain, told.read_noise):
        return FoundNoise(told, source)
    levels = [dark[0] if isinstance(dark, np.ndarray) else dark for dark in darks]
    stated = _stated_noise(raws)
    if stated is not None:
        gain, noise = stated[:2]
        own, doubts = "the files' noise profile", stated[2]
    else:
        own, gain, noise, doubts = _measured(raws, frames, levels, times, told)
    numbers = _completed(told, gain, noise)
    return FoundNoise(numbers, ", ".join(one for one in (source, own) if one), doubts)


def _completed(told: SensorNumbers, gain: float, noise: float) -> SensorNumbers:
    """Return a sensor's numbers with gain and read noise, DN, for what isn't told."""
    used = gain if told.gain is None else told.gain
    return replace(
        told, gain=used, read_noise=noise * used if told.read_noise is None else told.read_noise
    )


def _stated_noise(raws: Sequence[RawPhotograph]) -> tuple[float, float, tuple[str, ...]] | None:
    """Return gain, electrons/DN, and read noise, DN, by the files' noise profile.

    The variance of light x is S x + O, white at 1 (Adobe, Digital Negative Specification 1.7.1,
    NoiseProfile), so that S times the range in numbers is one over the gain. Colours count by their
    pixels. Returns None where the files state none, or different ones.
    """
    profiles = [one.colour.noise for one in raws]
    first, raw = profiles[0], raws[0]
    if first is None or not (first[:, 0] > 0).all():
        return None
    if any(one is None or not np.allclose(one, first, rtol=1e-3) for one in profiles):
        return None
    letters = "".join(raw.pattern or ())
    counts = np.array([letters.count(one) for one in raw.channels] or [1])
    scale, offset = (np.average(first[: len(counts)], axis=0, weights=counts)).tolist()
    span = raw.white - float(raw.dark_levels.mean())
    noise = math.sqrt(max(offset * span**2 - _ROUNDING, 0.0))
    unlike = float(first[:, 0].max() / first[:, 0].min())
    doubts = (
        f"the files' noise profile has gains that differ {unlike:.2g} times between colours: "
        "their mean is taken",
    )
    return 1 / (scale * span), noise, doubts if unlike > _UNLIKE else ()


def _measured(
    raws: Sequence[RawPhotograph],
    frames: Sequence[Any],
    levels: Sequence[Any],
    times: Sequence[float],
    told: SensorNumbers,
) -> tuple[str, float, float, tuple[str, ...]]:
    """Return words, gain, electrons/DN, and read noise, DN, as the frames show them.

    Raises UserError if they don't.
    """
    pattern = raws[0].pattern or ("W",)
    full = told.full_scale
    assert full is not None
    try:
        found = hdr.estimate_bracket_noise(
            frames, levels, times, full, (len(pattern), len(pattern[0]))
        )
    except ValueError as error:
        raise UserError(
            f"the noise of the sensor isn't known: the files don't state it, and {error}. Give "
            "--sensor FILE, or --gain (electrons per digital number) and --read-noise (electrons). "
            "labapp calibrate --camera measures them."
        ) from error
    words = (
        f"noise estimated from the frames: gain {found.gain:.3g} ± {found.gain_deviation:.1g} "
        f"electrons/DN, read noise {found.read_noise:.2g} ± {found.read_noise_deviation:.1g} "
        "electrons"
    )
    doubts = (
        f"more than noise differs in {1 - found.share:.0%} of the frames' parts, so that the gain "
        "that was estimated from them may be too small: give --gain and --read-noise",
    )
    return (
        words, found.gain, found.read_noise / found.gain,
        doubts if found.share < _LEAST_SHARE else (),
    )  # fmt: skip
