"""Prepare a RAW photograph for its restoration: light, clipped pixels, filters and noise."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from labapp.common.errors import UserError
from labapp.files.guarded_reading import read_bytes
from labapp.files.picture.photograph import Light
from labapp.files.raw import RawPhotograph, is_raw, read_raw
from labapp.pictures.analysis.colour_filters import ColourFilters
from labapp.pictures.analysis.raw_colours import raw_filters
from labapp.pictures.analysis.score import ReferencePicture
from labapp.pictures.reconstructing.problem import RestorationProblem
from optics.inverse.blur import Border

_UNIT = "of a full well"

_NEVER_RAW = (".npy", ".npz", ".h5", ".hdf5")


@dataclass(frozen=True, eq=False)
class RawToRestore:
    """A RAW photograph that is to be restored.

    raw: the photograph as its file has it.
    light: light behind the filters, (1, rows, columns), of which 1 fills a well.
    clipped: (1, rows, columns), pixels whose wells were full.
    filters: of the sensor; None without any.
    notes: remarks for the user.
    """

    raw: RawPhotograph
    light: Light
    clipped: NDArray[np.bool_]
    filters: ColourFilters | None
    notes: tuple[str, ...]

    @property
    def band_count(self) -> int:
        """Return the number of bands that are restored."""
        return 1 if self.filters is None else self.filters.response.shape[1]

    def bands(self, noise: float | None) -> Light:
        """Return the bands before their restoration, (bands, rows, columns)."""
        if self.filters is None:
            return self.light
        return self.filters.separate(self.light[0], noise, self.clipped[0])

    def build_problem(
        self,
        psf: Light,
        psf_source: str,
        noise: float | None = None,
        border: Border = "unknown",
        notes: tuple[str, ...] = (),
        reference: ReferencePicture | None = None,
    ) -> RestorationProblem:
        """Pose the restoration with this PSF."""
        return RestorationProblem(
            self.light,
            psf,
            self.clipped,
            str(self.raw.path),
            psf_source,
            _UNIT,
            noise=noise,
            border=border,
            notes=(*self.notes, *notes),
            noise_floor=self._stated_noise,
            reference=self._reference_in_bands(reference),
            filters=self.filters,
            encoding="linear, RAW numbers are proportional to light",
        )

    @property
    def _stated_noise(self) -> float:
        """Return the rms noise of the unclipped pixels that the RAW file states; 0 if none."""
        stated = self.raw.colour.noise
        sound = ~self.clipped[0]
        if stated is None or not sound.any():
            return 0.0
        which = np.zeros(sound.shape, dtype=np.intp)
        if self.filters is not None:
            which = self.filters.channel_map(self.light[0].shape)
        variance = stated[which, 0] * np.clip(self.light[0], 0, None) + stated[which, 1]
        return float(np.sqrt(variance[sound].mean()))

    def _reference_in_bands(self, known: ReferencePicture | None) -> ReferencePicture | None:
        """Convert the truth, linear sRGB, to the bands of the filters."""
        if known is None or self.filters is None or self.filters.matrix is None:
            return known
        back = np.linalg.pinv(self.filters.matrix)
        light = np.tensordot(back, known.light, axes=1).astype(np.float32)
        return replace(known, light=light)


def find_raw(path: Path) -> bytes | None:
    """Return the contents of a RAW file; None if it is of another kind."""
    if path.suffix.lower() in _NEVER_RAW:
        return None
    data = read_bytes(path)
    return data if is_raw(data, path) else None


def prepare_raw(
    path: Path,
    data: bytes,
    *,
    is_grey: bool = False,
    clip: float | None = None,
    dark: float | None = None,
) -> RawToRestore:
    """Read a RAW file, and prepare its photograph.

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
    return RawToRestore(raw, raw.light(dark)[None], clipped[None], filters, notes)


def describe_levels(
    raw: RawPhotograph, clip: float | None = None, dark: float | None = None
) -> str:
    """Say what a RAW photograph is, and between which levels its light lies."""
    low, high = float(raw.dark_levels.min()), float(raw.dark_levels.max())
    black = f"{low:g}" if low == high else f"{low:g} to {high:g}"
    if dark is not None:
        black = f"{dark:g} as told"
    full = (
        ""
        if clip is not None or raw.clip_level == raw.white
        else (f"; pixels at {raw.clip_level:g} and above count as clipped")
    )
    return f"{raw.kind}: black {black}, white {raw.white:g}{full}"


def describe_turn(raw: RawPhotograph) -> list[str]:
    """Say so if the camera was turned, and the photograph isn't upright."""
    if raw.orientation == 1:
        return []
    return [
        f"the camera was turned (orientation {raw.orientation}); the picture stays in the sensor's "
        "order, as its PSF is"
    ]
