"""Read RAW files of an exposure bracket: mosaics of one sensor, with the levels that they state.

Pixels of a cell, rows and columns have levels of darkness of their own. All pixels are raised to
the highest of them, so that one number means one light, and clips, everywhere. Gain and read noise
are told, stated by the files, or measured on the frames.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from labapp.common.errors import UserError
from labapp.files.guarded_reading import read_bytes
from labapp.files.picture.encoding import Encoding
from labapp.files.raw import RawPhotograph, is_raw, read_raw
from labapp.pictures.merging.bracket_files import (
    BracketFiles,
    Frame,
    SensorNumbers,
    build_sensor,
    equal_times,
    group_darks,
    require_times,
    sensor_source,
)
from labapp.pictures.merging.exposure_facts import choose_times
from labapp.pictures.reconstructing.raw_to_restore import describe_levels, describe_turn
from optics import hdr

_HIGHEST = 65535
"""Highest number of a RAW file's pixels."""

_OTHER_WHITE = 0.01
"""Relative difference from which on white balances of a bracket's files differ. Chosen."""

_ROUNDING = 1 / 12
"""Variance of rounding to whole numbers, DN², which a stated variance of darkness includes."""

_UNLIKE = 1.1
"""Ratio of the gains that a file states for its colours from which on they are told. Chosen."""

_LEAST_SHARE = 0.8
"""Share of the frames' parts that differ by noise alone from which on their estimate is trusted.
Chosen: where something moves in a fifth of them, gains come out 3 % too small."""

Numbers = NDArray[np.uint16]


def find_raw_files(paths: Sequence[Path]) -> list[RawPhotograph] | None:
    """Read RAW photographs; None if none of the files is RAW.

    Raises UserError if only some are.
    """
    found: list[RawPhotograph] = []
    other: list[Path] = []
    for path in paths:
        data = b"" if path.suffix.lower() in (".npy", ".npz") else read_bytes(path)
        if data and is_raw(data, path):
            found.append(read_raw(path, data))
        else:
            other.append(path)
    if found and other:
        raise UserError(
            f"{other[0]}: is a picture and {found[0].path} a RAW file. Give the RAW files of all "
            "frames, or pictures of all, developed alike."
        )
    return found or None


def read_raw_bracket(
    raws: Sequence[RawPhotograph],
    exposures: Sequence[float] | None,
    darks: Sequence[Path],
    sensor_file: Path | None,
    numbers: SensorNumbers,
    encoding: Encoding | None,
) -> BracketFiles:
    """Return numbers, darkness, exposure times and noise of RAW photographs.

    As `read_bracket_files` otherwise. Noise that isn't told is what the files state, or what the
    frames show.
    """
    if encoding is not None and encoding.name != "linear":
        raise UserError(
            f"--encoding {encoding.name}: RAW files are proportional to light. Leave it out."
        )
    names = [one.path.name for one in raws]
    require_times(exposures, len(names), "files")
    _require_one_sensor(raws)
    times, notes, doubts = choose_times(raws, exposures, is_coded=False)
    frames, levels = _raised(raws, numbers.black)
    means, counts = _darkness(darks, raws, frames, levels)
    top = float(max(np.max(one) for one in levels))
    # The frame with the highest number tells from which level on pixels are clipped: a level that
    # another frame exceeds is none.
    brightest = max(raws, key=lambda one: int(one.mosaic.max()))
    full = numbers.full_scale or math.ceil(brightest.clip_level)
    told = SensorNumbers(numbers.gain, numbers.read_noise, top, full)
    told, source, noise_doubts = _find_noise(raws, frames, means, times, told, sensor_file)
    sensor = build_sensor(sensor_file, told, 16, frames[0].shape[1:])
    said = [describe_levels(raws[0], dark=numbers.black), *describe_turn(raws[0])]
    return BracketFiles(
        names, frames, times, means, counts, sensor, sensor_source=source,
        doubts=(*doubts, *equal_times(times), *noise_doubts),
        notes=(*said, *raws[0].notes, *notes, *_other_white(raws)), may_move=True, raw=raws[0],
    )  # fmt: skip


def _require_one_sensor(raws: Sequence[RawPhotograph]) -> None:
    """Raise UserError unless RAW photographs are of one sensor, read out alike."""
    first = raws[0]
    for one in raws[1:]:
        for what, own, other in (
            ("camera", f"{one.maker} {one.model}", f"{first.maker} {first.model}"),
            ("size", "{} x {}".format(*one.mosaic.shape), "{} x {}".format(*first.mosaic.shape)),
            ("pattern of filters", _letters(one), _letters(first)),
            ("white level", f"{one.white:g}", f"{first.white:g}"),
        ):
            if own != other:
                raise UserError(
                    f"{one.path}: has the {what} {own.strip() or 'unknown'} and {first.path} "
                    f"{other.strip() or 'unknown'}. Give frames of one camera, with one setting "
                    "but for the exposure time."
                )


def _letters(raw: RawPhotograph) -> str:
    return "grey" if raw.pattern is None else "/".join(raw.pattern)


def _raised(
    raws: Sequence[RawPhotograph], black: float | None
) -> tuple[list[Numbers], list[Frame | float]]:
    """Return the numbers of RAW photographs with one level of darkness, and that level.

    Parts of a number can't be raised: where there are any, the level is one for each pixel. black:
    takes the place of the files' levels.
    """
    if black is not None:
        return [one.mosaic[None] for one in raws], [black] * len(raws)
    top = max(float(np.rint(one.dark_levels).max()) for one in raws)
    frames, levels = [], list[Frame | float]()
    for one in raws:
        whole = np.rint(one.dark_levels)
        rest = one.dark_levels - whole
        raised = one.mosaic + (top - whole).astype(np.uint32)
        frames.append(np.minimum(raised, _HIGHEST).astype(np.uint16)[None])
        levels.append((top + rest).astype(np.float32)[None] if rest.any() else top)
    return frames, levels


def _darkness(
    paths: Sequence[Path],
    raws: Sequence[RawPhotograph],
    frames: Sequence[Numbers],
    levels: list[Frame | float],
) -> tuple[list[Frame | float], list[float]]:
    """Return the darkness of each RAW photograph, and how many dark frames tell it."""
    if not paths:
        return levels, [math.inf] * len(raws)
    darks = find_raw_files([raws[0].path, *paths])
    assert darks is not None
    _require_one_sensor(darks)
    means, counts = group_darks([one.mosaic[None] for one in darks[1:]], len(raws))
    # Dark frames are raised as the frames are.
    raised = (
        frame - raw.mosaic.astype(np.float32) for frame, raw in zip(frames, raws, strict=True)
    )
    return [mean + one for mean, one in zip(means, raised, strict=True)], counts


def _other_white(raws: Sequence[RawPhotograph]) -> list[str]:
    """Say in words if RAW photographs have different white balances."""
    found = [one.colour.white for one in raws]
    known = [one / one.max() for one in found if one is not None]
    if not known or all(np.allclose(one, known[0], rtol=_OTHER_WHITE) for one in known):
        return []
    return [f"white balances of the files differ: that of {raws[0].path.name} is taken"]


def _find_noise(
    raws: Sequence[RawPhotograph],
    frames: Sequence[Numbers],
    darks: Sequence[Frame | float],
    times: Sequence[float],
    told: SensorNumbers,
    sensor_file: Path | None,
) -> tuple[SensorNumbers, str, tuple[str, ...]]:
    """Return numbers of a sensor with its gain and read noise, their source, and doubts, in words.

    Noise is what is told; else that of the files' noise profiles, if these are of one kind; else
    what the frames show. Raises UserError if none is known.
    """
    source = sensor_source(sensor_file, replace(told, black=None, full_scale=None))
    if sensor_file is not None or None not in (told.gain, told.read_noise):
        return told, source, ()
    own, gain, noise, doubts = _stated_noise(raws) or _measured_noise(
        raws, frames, darks, times, told
    )
    used = gain if told.gain is None else told.gain
    read_noise = noise * used if told.read_noise is None else told.read_noise
    numbers = replace(told, gain=used, read_noise=read_noise)
    return numbers, ", ".join(one for one in (source, own) if one), doubts


def _stated_noise(
    raws: Sequence[RawPhotograph],
) -> tuple[str, float, float, tuple[str, ...]] | None:
    """Return words, gain, electrons/DN, read noise, DN, and doubts by the files' noise profile.

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
    used = doubts if unlike > _UNLIKE else ()
    return "the files' noise profile", 1 / (scale * span), noise, used


def _measured_noise(
    raws: Sequence[RawPhotograph],
    frames: Sequence[Numbers],
    darks: Sequence[Frame | float],
    times: Sequence[float],
    told: SensorNumbers,
) -> tuple[str, float, float, tuple[str, ...]]:
    """Return words, gain, electrons/DN, read noise, DN, and doubts, as the frames show them.

    Raises UserError if they don't.
    """
    pattern = raws[0].pattern or ("W",)
    assert told.full_scale is not None
    period = len(pattern), len(pattern[0])
    levels: list[Any] = [dark[0] if isinstance(dark, np.ndarray) else dark for dark in darks]
    try:
        found = hdr.estimate_bracket_noise(
            [one[0] for one in frames], levels, times, told.full_scale, period
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
    used = doubts if found.share < _LEAST_SHARE else ()
    return words, found.gain, found.read_noise / found.gain, used
