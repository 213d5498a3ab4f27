"""Prepare a RAW photograph for its restoration: light, clipped pixels, filters and noise."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from labapp.common.errors import UserError
from labapp.files.guarded_reading import read_bytes
from labapp.files.picture.photograph import Light
from labapp.files.raw import RawPhotograph, is_raw, read_raw
from labapp.pictures.analysis.colour_filters import ColourFilters
from labapp.pictures.analysis.raw_colours import raw_filters
from labapp.pictures.reconstructing.problem import BlurredPicture

_NEVER_RAW = (".npy", ".npz", ".h5", ".hdf5")


def find_raw(path: Path) -> bytes | None:
    """Return the contents of a RAW file; None if it is of another kind."""
    if path.suffix.lower() in _NEVER_RAW:
        return None
    data = read_bytes(path)
    return data if is_raw(data, path) else None


def prepare_raw(
    path: Path, data: bytes, *, is_grey: bool, clip: float | None, dark: float | None
) -> BlurredPicture:
    """Read a RAW file, and prepare its photograph; light of 1 fills a well.

    `clip` and `dark` take the place of the file's levels. Raises UserError for a file that can't be
    used, and for levels that leave no light.
    """
    raw = read_raw(path, data)
    if dark is not None and not dark < raw.white:
        raise UserError(f"--dark {dark:g}: {path} has a white level of {raw.white:g}. Give less.")
    clipped = raw.mosaic >= (raw.clip_level if clip is None else clip)
    if clipped.all():
        raise UserError(
            f"{path}: every pixel is clipped, at {raw.clip_level if clip is None else clip:g} or "
            "above. Expose more briefly, or give the level of a full well: --clip LEVEL."
        )
    filters, said = (None, []) if raw.pattern is None else raw_filters(raw, is_grey=is_grey)
    notes = (describe_levels(raw, clip, dark), *describe_turn(raw), *raw.notes, *said)
    light = raw.light(dark)
    return BlurredPicture(
        light[None],
        clipped[None],
        str(path),
        "of a full well",
        notes=notes,
        noise_floor=_stated_noise(raw, light, clipped, filters),
        filters=filters,
        encoding="linear, RAW numbers are proportional to light",
    )


def _stated_noise(
    raw: RawPhotograph, light: Light, clipped: NDArray[np.bool_], filters: ColourFilters | None
) -> float:
    """Return the rms noise of the unclipped pixels that the RAW file states; 0 if none."""
    stated, sound = raw.colour.noise, ~clipped
    if stated is None or not sound.any():
        return 0.0
    which = np.zeros(sound.shape, dtype=np.intp)
    if filters is not None:
        which = filters.channel_map(light.shape)
    variance = stated[which, 0] * np.clip(light, 0, None) + stated[which, 1]
    return float(np.sqrt(variance[sound].mean()))


def with_reference_in_bands(picture: BlurredPicture) -> BlurredPicture:
    """Convert the truth of a RAW photograph, linear sRGB, to the bands of its filters."""
    known, filters = picture.reference, picture.filters
    if known is None or filters is None or filters.matrix is None:
        return picture
    back = np.linalg.pinv(filters.matrix)
    light = np.tensordot(back, known.light, axes=1).astype(np.float32)
    return replace(picture, reference=replace(known, light=light))


def describe_levels(
    raw: RawPhotograph, clip: float | None = None, dark: float | None = None
) -> str:
    """Say what a RAW photograph is, and between which levels its light lies."""
    low, high = float(raw.dark_levels.min()), float(raw.dark_levels.max())
    black = f"{low:g}" if low == high else f"{low:g} to {high:g}"
    if dark is not None:
        black = f"{dark:g} as told"
    full = ""
    if clip is None and raw.clip_level != raw.white:
        full = f"; pixels at {raw.clip_level:g} and above count as clipped"
    return f"{raw.kind}: black {black}, white {raw.white:g}{full}"


def describe_turn(raw: RawPhotograph) -> list[str]:
    """Say so if the camera was turned, and the photograph isn't upright."""
    if raw.orientation == 1:
        return []
    return [
        f"the camera was turned (orientation {raw.orientation}); the picture stays in the sensor's "
        "order, as its PSF is"
    ]
