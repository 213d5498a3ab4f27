"""Read the files that a restoration request names, and build its restoration problem."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from labapp.common.errors import UserError
from labapp.files.picture.encoding import parse_encoding
from labapp.files.picture.photograph import Light, Photograph, read_photograph
from labapp.pictures.analysis.score import ReferencePicture
from labapp.pictures.reconstructing.merged_photograph import is_merged, read_merged
from labapp.pictures.reconstructing.problem import BlurredPicture, RestorationProblem
from labapp.pictures.reconstructing.psf_files import read_psf_file
from labapp.pictures.reconstructing.raw_to_restore import (
    find_raw,
    prepare_raw,
    with_reference_in_bands,
)
from labapp.pictures.reconstructing.recorded_photograph import (
    RecordedPhotograph,
    RecordSelection,
    is_record,
    read_recorded_photograph,
)
from optics.inverse.blur import BORDERS, Border
from optics.progress import Progress


@dataclass(frozen=True)
class RestorationRequest:
    """A request to restore a photograph, as the options of `labapp reconstruct` state it.

    source: record, merged bracket, RAW file or picture to restore.
    psf: file of the PSF; None for the star of the record `source`.
    choice: photograph of a record.
    encoding: name of how levels stand for light; None for what the file says.
    noise: standard deviation of a pixel's light; None to estimate it.
    border: what the scene does beyond the frame.
    clip: level of a full well; None to read it from the picture.
    dark: level that is subtracted.
    blind: largest side in pixels of an unknown PSF that is estimated from the picture.
    truth: picture of the light before it was blurred.
    """

    source: Path
    psf: Path | None = None
    choice: RecordSelection = field(default_factory=RecordSelection)
    encoding: str | None = None
    noise: float | None = None
    border: Border = "unknown"
    clip: float | None = None
    dark: float | None = None
    blind: int | None = None
    truth: Path | None = None

    def __post_init__(self) -> None:
        if self.border not in BORDERS:
            raise UserError(f"--border {self.border}: take one of {', '.join(BORDERS)}.")
        if self.noise is not None and not (self.noise > 0 and math.isfinite(self.noise)):
            raise UserError(f"--noise {self.noise:g}: give a number above 0.")
        if self.blind is not None and self.psf is not None:
            raise UserError("--blind and --psf are both given. A PSF in a file isn't unknown.")
        for name in ("clip", "dark"):
            value = getattr(self, name)
            if value is not None and not math.isfinite(value):
                raise UserError(f"--{name} {value:g}: give a finite level.")

    def read_problem(self, progress: Progress) -> RestorationProblem:
        """Read photograph and PSF, and pose the restoration.

        Raises UserError, which names file, value and remedy.
        """
        if is_record(self.source) and not is_merged(self.source):
            return self._problem_from_record(progress)
        picture = self.read_picture(progress)
        if self.psf is not None:
            psf, notes = read_psf_file(self.psf, picture.band_count, self.choice)
            return picture.with_psf(psf, str(self.psf), notes)
        if self.blind is None:
            raise UserError(
                f"{self.source}: what has blurred it? Give its PSF: --psf FILE, or let it be "
                "looked for: --blind SIZE."
            )
        bands = picture.blurred_bands
        if picture.filters is not None and picture.variance is None:
            # The noise that a RAW file states doesn't count here: it is told, or estimated.
            bands = picture.filters.separate(picture.light[0], self.noise, picture.clipped[0])
        clipped = np.broadcast_to(picture.clipped, bands.shape)
        return picture.with_psf(*self._estimate_psf(bands, clipped, progress))

    def read_picture(self, progress: Progress) -> BlurredPicture:
        """Read a picture that isn't in a record, with what the request says of it.

        It is a merged bracket, a RAW photograph, or a picture of any other file. Raises UserError
        for options that such a file doesn't have, and if the truth has another shape.
        """
        if is_merged(self.source):
            self._refuse_levels("a merged bracket")
            for name in ("target", "frame"):
                if getattr(self.choice, name) is not None:
                    raise UserError(f"--{name}: {self.source} is one merged picture. Leave it out.")
            progress.report(0, f"reading {self.source.name}")
            return self._completed(read_merged(self.source, is_grey=self.choice.grey))
        data = find_raw(self.source)
        if data is not None:
            return self._read_raw(data, progress)
        if self.choice.target is not None:
            raise UserError(
                f"--target {self.choice.target}: {self.source} is no record. Leave it out."
            )
        progress.report(0, f"reading {self.source.name}")
        encoding = None if self.encoding is None else parse_encoding(self.encoding)
        read = read_photograph(
            self.source, encoding=encoding, page=self.choice.frame, page_option="--frame"
        )
        if self.dark is not None and read.is_coded:
            raise UserError(
                f"--dark {self.dark:g}: the levels of {read.path} aren't proportional to light "
                f"({read.encoding.name}: {read.encoding_source}). Add --encoding linear if they "
                "are."
            )
        light = read.light - (self.dark or 0.0)
        return self._completed(
            BlurredPicture(
                np.where(np.isfinite(light), light, np.nan).astype(np.float32),
                self._clipped_pixels(read),
                str(self.source),
                "of white" if read.is_coded else "levels",
                1.0 if read.is_coded else read.white,
                read.white is None or (read.is_coded and read.white <= 255),
                notes=tuple(read.remarks),
                encoding=f"{read.encoding.name}, {read.encoding_source}",
            )
        )

    def _read_raw(self, data: bytes, progress: Progress) -> BlurredPicture:
        for name in ("target", "frame"):
            if (value := getattr(self.choice, name)) is not None:
                raise UserError(
                    f"--{name} {value}: {self.source} is one RAW photograph. Leave it out."
                )
        if self.encoding not in (None, "linear"):
            raise UserError(
                f"--encoding {self.encoding}: {self.source} is RAW, which is proportional to "
                "light. Leave it out."
            )
        progress.report(0, f"reading {self.source.name}")
        found = prepare_raw(
            self.source, data, is_grey=self.choice.grey, clip=self.clip, dark=self.dark
        )
        return with_reference_in_bands(self._completed(found))

    def _completed(self, picture: BlurredPicture) -> BlurredPicture:
        """Return a picture with the noise, border and truth of the request."""
        self._require_reference_shape((picture.band_count, *picture.light.shape[1:]))
        return replace(picture, noise=self.noise, border=self.border, reference=self.reference)

    @cached_property
    def reference(self) -> ReferencePicture | None:
        """Return the truth that the restoration is scored against, if one is given.

        Its white is 1 for sRGB, and else its brightest value, whatever its unit is.
        """
        path = self.truth
        if path is None:
            return None
        if is_record(path):
            raise UserError(
                f"--truth {path}: is a record. Give a picture or .npy of the same light."
            )
        if find_raw(path) is not None:
            raise UserError(
                f"--truth {path}: is a RAW file. Give a picture or .npy of linear sRGB."
            )
        read = read_photograph(path)
        # What is told of the photograph's levels holds for a truth of levels, too.
        if self.encoding is not None and read.white is not None:
            read = replace(read, encoding=parse_encoding(self.encoding))
        light = read.light
        brightest = float(np.nanmax(light))
        if not brightest > 0:
            raise UserError(f"--truth {path}: is dark. Give the picture that was blurred.")
        return ReferencePicture(light, 1.0 if read.is_coded else brightest, 1.0, str(path))

    def _require_reference_shape(self, shape: tuple[int, ...]) -> None:
        """Raise UserError if the truth has another shape than the photograph.

        The shape is checked before an unknown PSF is estimated, which takes long.
        """
        if self.reference is None or self.reference.light.shape == shape:
            return
        is_, wanted = (" x ".join(map(str, one)) for one in (self.reference.light.shape, shape))
        raise UserError(
            f"--truth {self.truth}: is {is_} (bands, rows, columns); it must be {wanted}."
        )

    def read_record(self, progress: Progress, *, star: bool) -> RecordedPhotograph:
        """Read the photograph from its record; the PSF is read if `star` is true.

        Raises UserError for options that a record doesn't have.
        """
        self._refuse_levels("a record")
        found = read_recorded_photograph(self.source, self.choice, progress, star=star)
        self._require_reference_shape((found.band_count, *found.light.shape[1:]))
        return found

    def _refuse_levels(self, kind: str) -> None:
        """Raise UserError for options on levels where the source knows its own."""
        for name in ("clip", "dark", "encoding"):
            if getattr(self, name) is not None:
                raise UserError(
                    f"--{name}: {self.source} is {kind}, which knows its own. Leave it out."
                )

    def _problem_from_record(self, progress: Progress) -> RestorationProblem:
        unknown = self.psf is None and self.blind is None
        found = self.read_record(progress, star=unknown)
        psf, told, notes = None, "", list[str]()
        if self.blind is not None:
            if found.filters is not None:
                raise UserError(
                    f"--blind: {self.source} is of a sensor with colour filters. Record a star, or "
                    "give the PSF: --psf FILE."
                )
            psf, told, notes = self._estimate_psf(found.light, found.clipped_pixels, progress)
        elif self.psf is not None:
            told, seen = str(self.psf), found.photograph
            choice = RecordSelection(
                None, seen.pattern, seen.wavelength, None, self.choice.star, self.choice.grey
            )
            psf, notes = read_psf_file(self.psf, found.band_count, choice)
        posed = found.build_problem(psf, told, self.noise, self.border, tuple(notes))
        return posed if self.reference is None else replace(posed, reference=self.reference)

    def _estimate_psf(
        self, light: NDArray[np.floating], clipped: NDArray[np.bool_], progress: Progress
    ) -> tuple[Light, str, list[str]]:
        """Estimate the PSF from the blurred light alone, in the mean of its bands.

        Returns the PSF, its source in words, and a remark about its reliability.
        """
        from optics.inverse.blind import find_kernel

        assert self.blind is not None
        unseen = clipped | ~np.isfinite(light)
        grey = np.where(unseen, 0, light).mean(0)
        kernel = find_kernel(
            grey, self.blind, noise=self.noise, clipped=unseen.any(0), progress=progress
        )
        surely = f"score {kernel.score:.2f}, {kernel.verdict}"
        psf = np.asarray(kernel.psf, dtype=np.float32)[None]
        return psf, "looked for in the picture itself", [f"the blur that was found: {surely}"]

    def _clipped_pixels(self, photograph: Photograph) -> NDArray[np.bool_]:
        level = photograph.saturation_level() if self.clip is None else self.clip
        if level is None:
            return np.zeros(photograph.levels.shape, dtype=bool)
        clipped = np.asarray(photograph.levels >= level)
        if clipped.all():
            raise UserError(
                f"--clip {level:g}: every pixel of {photograph.path} is at least that. Give the "
                f"level of a full well; the picture's highest is {photograph.levels.max():g}."
            )
        return clipped
