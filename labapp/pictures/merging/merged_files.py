"""Write a merged bracket: HDF5 with variance and state, a 32-bit TIFF, and a picture to look at."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from labapp.files.hdf5_output import create_hdf5
from labapp.files.picture.photograph_writing import encode_srgb, write_float_tiff
from labapp.files.raw import RawPhotograph
from labapp.files.writing import draft_of, encode_image, write_atomically
from labapp.pictures.merging.bracket_motion import describe_motions
from labapp.pictures.merging.merged_bracket import MergedFiles
from optics import hdr

_ROWS = 256
"""Rows of a picture that are compressed together, which saves memory. Chosen."""

_TONE_PIXELS = 1_000_000
"""Pixels that tell a picture's key and white, evenly over it. Chosen."""


def merged_paths(path: Path) -> dict[str, Path]:
    """Return the paths of all files beside the HDF5 file, by their kind."""
    return {
        "data": path,
        "light": path.with_suffix(".tiff"),
        "picture": path.with_suffix(".png"),
        "report": path.with_suffix(".html"),
    }


def write_merged(merged: MergedFiles, paths: dict[str, Path]) -> bytes:
    """Write data, light and picture; return the picture's PNG."""
    with draft_of(paths["data"]) as draft:
        _write_hdf5(merged, draft)
    with draft_of(paths["light"]) as draft:
        write_float_tiff(draft, merged.shown)
    shown = encode_image(paths["picture"], picture_to_look_at(merged.shown)[..., ::-1])
    write_atomically(paths["picture"], shown)
    return shown


def describe_merged(merged: MergedFiles) -> dict[str, Any]:
    """Return what was merged, and how, as plain data."""
    source, factors = merged.source, merged.factors
    return {
        "method": merged.method,
        "files": source.names,
        "exposures_s": source.exposures,
        "factors": None if factors is None else factors.factors.tolist(),
        "factor_deviations": None if factors is None else _known_deviations(factors.deviations),
        "noise_scatter": None if factors is None else factors.scatter,
        "warnings": merged.told,
        "notes": list(merged.notes),
        "motion": merged.motions and describe_motions(merged.motions, merged.is_aligned),
        "time_check": merged.coded_times and _describe_times(merged.coded_times),
        "clipped_share": merged.clipped,
        "states": {state.name: merged.share(state) for state in hdr.PixelState},
        "raw": None if source.raw is None else _describe_raw(merged, source.raw),
    } | _describe_trust(merged)


def _describe_raw(merged: MergedFiles, raw: RawPhotograph) -> dict[str, Any]:
    """Return what RAW files say of sensor and colours, as plain data."""
    filters = merged.filters
    told = {
        "camera": " ".join(one for one in (raw.maker, raw.model) if one),
        "orientation": raw.orientation,
        "black": raw.black.tolist(),
        "white": raw.white,
    }
    if raw.pattern is not None:
        told["pattern"] = "/".join(raw.pattern)
    if filters is not None and filters.matrix is not None:
        told |= {
            "channels": filters.channels,
            "white_balance": filters.gains.tolist(),
            "matrix_to_linear_srgb": filters.matrix.tolist(),
        }
    return told


def _describe_times(found: hdr.CodedTimes) -> dict[str, Any]:
    """Return the check of exposure times of 8-bit pictures for JSON.

    factors: light of each frame over that of its time, if this one alone is wrong.
    """
    return {
        "suspects": [one + 1 for one in found.suspects],
        "factors": found.factors.tolist(),
        "deviations": _known_deviations(found.deviations),
        "corrections": found.corrections.tolist(),
    }


def _known_deviations(deviations: NDArray[np.float64]) -> list[float | None]:
    """Return deviations for JSON; None for what isn't known."""
    return [one if math.isfinite(one) else None for one in deviations.tolist()]


def _describe_trust(merged: MergedFiles) -> dict[str, Any]:
    """Return what the numbers rest on: sensor and accuracy, or response curves."""
    accuracy, sensor = merged.accuracy, merged.source.sensor
    if accuracy is None:
        return {
            "response": [
                {
                    "log_exposure": curve.logs.tolist(),
                    "number_noise_dn": curve.number_noise,
                    "light_noise_relative": curve.light_noise,
                }
                for curve in merged.curves
            ]
        }
    return {
        "sensor": {
            "source": merged.source.sensor_source,
            "gain_electrons_per_dn": sensor.gain,
            "read_noise_electrons": sensor.read_noise,
            "dark_current_electrons_per_s": sensor.dark_current,
            "full_scale_dn": sensor.full_scale,
        },
        "accuracy": {
            "electrons_per_s": accuracy.rates.tolist(),
            "relative_error": accuracy.errors.tolist(),
            "relative_bias": accuracy.biases.tolist(),
            "efficiency": accuracy.efficiencies.tolist(),
        },
    }


def _write_hdf5(merged: MergedFiles, path: Path) -> None:
    """Write the HDF5 file; grey light has two axes."""
    with path.open("w+b") as out, create_hdf5(out.fileno()) as file:
        for name in ("rate", "variance", "state"):
            whole = getattr(merged, name)
            file[name] = whole[0] if len(whole) == 1 else whole
        unit = "light per second, 1 for number 128" if merged.curves else "electrons per second"
        file["rate"].attrs["unit"] = f"{unit} and pixel"
        file["variance"].attrs["unit"] = f"({unit} and pixel)²; infinite: unknown"
        file["state"].attrs["states"] = json.dumps({one.value: one.name for one in hdr.PixelState})
        if merged.source.raw is not None:
            file["rate"].attrs.update(_describe_raw(merged, merged.source.raw))
        file["description"] = json.dumps(describe_merged(merged))


def picture_to_look_at(rate: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Return the light as 8-bit sRGB, (rows, columns, 3).

    Light is compressed by Reinhard's global operator (2002, doi 10.1145/566654.566575): its
    logarithmic mean becomes 0.18 of white, and what is much brighter approaches white.
    """
    key, white = _tone(rate)
    picture = np.empty((*rate.shape[1:], 3), dtype=np.uint8)
    for start in range(0, len(picture), _ROWS):
        rows = slice(start, start + _ROWS)
        luminance = key * _luminance(rate[:, rows])
        factor = key * (1 + luminance / white**2) / (1 + luminance)
        picture[rows] = encode_srgb(np.moveaxis(np.maximum(rate[:, rows], 0) * factor, 0, -1))
    return picture


def _tone(rate: NDArray[np.float32]) -> tuple[np.float32, np.float32]:
    """Return the factor of exposure, and the light that becomes white."""
    every = max(1, rate[0].size // _TONE_PIXELS)
    lit = _luminance(rate.reshape(len(rate), 1, -1)[..., ::every])
    lit = lit[lit > 0]
    if not lit.size:
        return np.float32(1), np.float32(1)
    key = np.float32(0.18 / np.exp(np.log(lit).mean()))
    return key, np.float32(max(1.0, float(np.quantile(key * lit, 0.999))))


def _luminance(rate: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the luminance: that of sRGB's primaries, or the light itself of one band."""
    light = np.maximum(rate, 0)
    if len(light) == 1:
        return light[0]
    red, green, blue = light
    weights = (np.float32(one) for one in (0.2126, 0.7152, 0.0722))
    return sum(weight * one for weight, one in zip(weights, (red, green, blue), strict=True))
