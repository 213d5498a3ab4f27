"""What a person asks to be restored, read from files."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from labapp.common.errors import UserError
from labapp.files.photograph_file import Light, Photograph, read_photograph
from labapp.pictures.analysis.score import Reference
from labapp.pictures.reconstructing.problem import Problem
from labapp.pictures.reconstructing.psfs import psf_of_file
from labapp.pictures.reconstructing.records import Choice, is_record, photograph_of
from optics.operators.blur import BORDERS, Border
from optics.progress import Progress


@dataclass(frozen=True)
class AskedProblem:
    """What the command line asks for.

    psf: its file; None for the star of the record that `source` is. blind: pixels at most of a PSF
    that nobody knows, and that is looked for in the picture. linear: whether levels are
    proportional to light; None: all but those of 8-bit pictures. noise: standard deviation of a
    pixel's light. clip: level of a full well, None for what the picture shows. dark: level that is
    subtracted. truth: a picture of what the light was before it was blurred.
    """

    source: Path
    psf: Path | None = None
    choice: Choice = field(default_factory=Choice)
    linear: bool | None = None
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

    def problem(self, progress: Progress) -> Problem:
        """Read everything; UserError that names file, value and remedy."""
        if is_record(self.source):
            return self._of_record(progress)
        return self._of_picture(progress)

    @cached_property
    def known(self) -> Reference | None:
        """The true picture; its white is 1 where it has that, else its brightest."""
        path = self.truth
        if path is None:
            return None
        if is_record(path):
            raise UserError(
                f"--truth {path}: is a record. Give a picture or .npy of the same light."
            )
        light = read_photograph(path, linear=self.linear).light
        brightest = float(np.nanmax(light))
        if not brightest > 0:
            raise UserError(f"--truth {path}: is dark. Give the picture that was blurred.")
        return Reference(light, 1.0 if brightest <= 1 else brightest, 1.0, str(path))

    def _require_truth_like(self, light: NDArray[np.floating]) -> None:
        """UserError, before a blur is looked for, where the true picture has another shape."""
        if self.known is None or self.known.light.shape == light.shape:
            return
        is_, wanted = (" x ".join(map(str, one.shape)) for one in (self.known.light, light))
        raise UserError(
            f"--truth {self.truth}: is {is_} (bands, rows, columns); it must be {wanted}."
        )

    def _of_picture(self, progress: Progress) -> Problem:
        choice = self.choice
        if choice.target is not None:
            raise UserError(f"--target {choice.target}: {self.source} is no record. Leave it out.")
        if self.psf is None and self.blind is None:
            raise UserError(
                f"{self.source}: what has blurred it? Give its PSF: --psf FILE, or let it be "
                "looked for: --blind SIZE."
            )
        progress.report(0, f"reading {self.source.name}")
        read = read_photograph(self.source, linear=self.linear, frame=choice.frame)
        light, clipped = read.light - self._dark(read), self._clipped(read)
        self._require_truth_like(light)
        if self.psf is None:
            psf, told, notes = self._sought(light, clipped, progress)
        else:
            (psf, notes), told = psf_of_file(self.psf, len(read.levels), choice), str(self.psf)
        unit = "of white" if read.coded else "levels"
        return Problem(
            np.where(np.isfinite(light), light, np.nan).astype(np.float32),
            psf,
            clipped,
            str(self.source),
            told,
            unit,
            _full(read),
            read.coded or read.levels.dtype.kind == "f",
            self.noise,
            self.border,
            tuple(notes),
            reference=self.known,
        )

    def _of_record(self, progress: Progress) -> Problem:
        for name in ("clip", "dark", "linear"):
            if getattr(self, name) is not None:
                raise UserError(
                    f"--{name}: {self.source} is a record, which knows its own. Leave it out."
                )
        unknown = self.psf is None and self.blind is None
        found = photograph_of(self.source, self.choice, progress, star=unknown)
        self._require_truth_like(found.light)
        psf, told, notes = None, "", list[str]()
        if self.blind is not None:
            psf, told, notes = self._sought(found.light, found.clipped, progress)
        elif self.psf is not None:
            told, seen = str(self.psf), found.photograph
            choice = Choice(None, seen.pattern, seen.wavelength, None, self.choice.star)
            psf, notes = psf_of_file(self.psf, 1, choice)
        posed = found.problem(psf, told, self.noise, self.border, tuple(notes))
        return posed if self.known is None else replace(posed, reference=self.known)

    def _sought(
        self, light: NDArray[np.floating], clipped: NDArray[np.bool_], progress: Progress
    ) -> tuple[Light, str, list[str]]:
        """The PSF that the picture itself tells, of all bands; where it is from, and how surely."""
        from optics.deconvolution.blind import find_kernel

        assert self.blind is not None
        unseen = clipped | ~np.isfinite(light)
        grey = np.where(unseen, 0, light).mean(0)
        kernel = find_kernel(
            grey, self.blind, noise=self.noise, clipped=unseen.any(0), progress=progress
        )
        surely = f"score {kernel.score:.2f}, {kernel.trust}"
        psf = np.asarray(kernel.psf, dtype=np.float32)[None]
        return psf, "looked for in the picture itself", [f"the blur that was found: {surely}"]

    def _dark(self, read: Photograph) -> float:
        if self.dark is not None and read.coded:
            raise UserError(
                f"--dark {self.dark:g}: {read.path} holds sRGB's 8 bits, whose levels aren't "
                "proportional to light. Add --linear if they are."
            )
        return self.dark or 0.0

    def _clipped(self, read: Photograph) -> NDArray[np.bool_]:
        level = read.full_level() if self.clip is None else self.clip
        if level is None:
            return np.zeros(read.levels.shape, dtype=bool)
        clipped = np.asarray(read.levels >= level)
        if clipped.all():
            raise UserError(
                f"--clip {level:g}: every pixel of {read.path} is at least that. Give the level "
                f"of a full well; the picture's highest is {read.levels.max():g}."
            )
        return clipped


def _full(read: Photograph) -> float | None:
    """The light of a file's highest level; None where it has none."""
    if read.coded:
        return 1.0
    kind = read.levels.dtype
    return float(np.iinfo(kind).max) if kind.kind in "iu" else None
