"""Write a merged bracket: HDF5 with variance and state, a 32-bit TIFF, and a picture to look at."""

from __future__ import annotations

import io
import json
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from labapp.files.photograph_file import encode_photograph, encode_srgb
from labapp.files.writing import encode_image, write_atomically
from labapp.pictures.merging.merged_bracket import MergedFiles
from optics import hdr


def merged_paths(path: Path) -> dict[str, Path]:
    """Return the files of a merged bracket beside its HDF5 file, by their kind."""
    return {
        "data": path,
        "light": path.with_suffix(".tiff"),
        "picture": path.with_suffix(".png"),
        "report": path.with_suffix(".html"),
    }


def write_merged(merged: MergedFiles, paths: dict[str, Path]) -> bytes:
    """Write a merged bracket's data, light and picture; return the picture's PNG."""
    write_atomically(paths["data"], _hdf5(merged))
    light = encode_photograph(paths["light"], merged.rate, in_srgb=False, white_level=1.0)
    write_atomically(paths["light"], light)
    shown = encode_image(paths["picture"], picture_to_look_at(merged.rate)[..., ::-1])
    write_atomically(paths["picture"], shown)
    return shown


def describe_merged(merged: MergedFiles) -> dict[str, Any]:
    """Return what a merged bracket was made of, and how, as plain data."""
    source, factors = merged.source, merged.factors
    accuracy = merged.accuracy
    return {
        "method": merged.method,
        "files": source.names,
        "exposures_s": source.exposures,
        "factors": None if factors is None else factors.factors.tolist(),
        "factor_deviations": None if factors is None else factors.deviations.tolist(),
        "noise_scatter": None if factors is None else factors.scatter,
        "warnings": merged.told,
        "clipped_share": merged.clipped,
        "states": {state.name: merged.share(state) for state in hdr.PixelState},
        "sensor": {
            "gain_electrons_per_dn": source.sensor.gain,
            "read_noise_electrons": source.sensor.read_noise,
            "dark_current_electrons_per_s": source.sensor.dark_current,
            "full_scale_dn": source.sensor.full_scale,
        },
        "accuracy": {
            "electrons_per_s": accuracy.rates.tolist(),
            "relative_error": accuracy.errors.tolist(),
            "relative_bias": accuracy.biases.tolist(),
            "efficiency": accuracy.efficiencies.tolist(),
        },
    }


def _hdf5(merged: MergedFiles) -> bytes:
    """Return the HDF5 file of a merged bracket; grey pictures have two axes."""
    held = io.BytesIO()
    with h5py.File(held, "w") as file:
        for name in ("rate", "variance", "state"):
            whole = getattr(merged, name)
            file[name] = whole[0] if len(whole) == 1 else whole
        file["rate"].attrs["unit"] = "electrons per second and pixel"
        file["variance"].attrs["unit"] = "(electrons per second and pixel)²; infinite: unknown"
        file["state"].attrs["states"] = json.dumps({one.value: one.name for one in hdr.PixelState})
        file["description"] = json.dumps(describe_merged(merged))
    return held.getvalue()


def picture_to_look_at(rate: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Return a merged bracket as an 8-bit sRGB picture, (rows, columns, 3).

    Light is compressed by Reinhard's global operator (2002, doi 10.1145/566654.566575): its
    logarithmic mean becomes 0.18 of white, and what is much brighter approaches white.
    """
    colours = np.repeat(rate, 3, axis=0) if len(rate) == 1 else rate
    light = np.maximum(np.moveaxis(colours, 0, -1), 0)
    luminance = light @ np.array([0.2126, 0.7152, 0.0722], dtype=np.float32)
    lit = luminance[luminance > 0]
    if not lit.size:
        return np.zeros(light.shape, dtype=np.uint8)
    key = 0.18 / np.exp(np.log(lit).mean())
    scaled = key * luminance
    white = max(1.0, float(np.quantile(scaled, 0.999)))
    factor = (1 + scaled / white**2) / (1 + scaled)
    return encode_srgb(light * (key * factor)[..., None])
