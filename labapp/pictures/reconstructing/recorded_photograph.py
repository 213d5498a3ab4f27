"""Select a photograph of a record, and the star of the same run as its PSF, for restoration."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from labapp.common.errors import UserError
from labapp.files.plan_file import Reconstruction
from labapp.pictures.analysis.brackets import (
    WAVELENGTH_TOLERANCE,
    Bracket,
    Picture,
    dark_target,
    find_bracket,
    merge_all,
    merge_frames,
)
from labapp.pictures.analysis.colour_filters import ColourFilters, described_filters
from labapp.pictures.analysis.dead_pixels import find_dead_pixels
from labapp.pictures.analysis.score import CENTRAL_SHARE, ReferencePicture
from labapp.pictures.analysis.star_psf import StarImage, crop_star
from labapp.pictures.reconstructing.problem import WHITE_PERCENTILE, RestorationProblem
from labapp.runs.record.reader import Record
from optics.inverse.blur import Border
from optics.progress import Progress


@dataclass(frozen=True)
class RecordSelection:
    """Selection of a photograph in a record; None where its plan or its frames decide.

    `wavelength` is in metres. `frame` selects one frame instead of the merged exposures. `star` is
    the target that gives the PSF. `grey` asks for one band of a sensor with colour filters.
    `readout` is the number of a way of reading the sensor.
    """

    target: str | None = None
    pattern: str | None = None
    wavelength: float | None = None
    frame: int | None = None
    star: str | None = None
    grey: bool = False
    readout: int | None = None


@dataclass(frozen=True, eq=False)
class RecordedPhotograph:
    """A photograph in a record, with the PSF of its star.

    path: the record.
    photograph: merged exposures with the coded pattern.
    psf: of the star in each band, (bands, rows, columns); None without a star.
    filters: colour filters of the sensor; None if it has none.
    dead_pixels: (rows, columns), pixels of the sensor that give no light of their own.
    neutral: the same target with the neutral pattern, against which restorations are scored.
    roles: names of targets and patterns.
    frame: the selected frame; None for the merged exposures.
    """

    path: Path
    photograph: Bracket
    psf: Picture | None
    neutral: Bracket | None
    roles: Reconstruction
    filters: ColourFilters | None
    dead_pixels: NDArray[np.bool_]
    frame: int | None = None

    @property
    def band_count(self) -> int:
        """Return the number of bands that are restored."""
        return 1 if self.filters is None else self.filters.response.shape[1]

    @cached_property
    def clipped_pixels(self) -> NDArray[np.bool_]:
        """Return the clipped pixels, (1, rows, columns), whose light is only a lower bound."""
        return ~np.isfinite(self.photograph.variance)[None] & ~self.dead_pixels

    @property
    def light(self) -> Picture:
        """Return the light on each pixel, (1, rows, columns); NaN in dead pixels.

        It is the light behind the pixel's colour filter if there is one. In clipped pixels it is
        the least that it can be with colour filters, and otherwise 0.
        """
        rate = self.photograph.rate[None]
        if self.filters is None:
            rate = np.where(self.clipped_pixels, 0, rate)
        return np.where(self.dead_pixels, np.nan, rate)

    def build_problem(
        self,
        psf: NDArray[np.floating] | None = None,
        psf_source: str = "",
        noise: float | None = None,
        border: Border = "unknown",
        notes: tuple[str, ...] = (),
    ) -> RestorationProblem:
        """Pose the restoration, with the star's PSF if none is given.

        Reports, commands and the window all call this function.
        """
        if psf is None:
            if self.psf is None:
                raise UserError(
                    f"{self.path}: has no star {self.roles.star!r} with pattern "
                    f"{self.photograph.pattern!r}. Give the PSF: --psf FILE, or name the target "
                    "that is a star: --star NAME."
                )
            psf, psf_source = self.psf, f"star {self.roles.star!r} of the same run"
            if self.filters is not None and not self.filters.is_grey:
                psf_source += ", in each colour"
        frame = "" if self.frame is None else f", frame {self.frame}"
        return RestorationProblem(
            self.light.astype(np.float32),
            self.clipped_pixels,
            f"{self.path}, {self.photograph.name}{frame}",
            "electrons per second",
            noise=noise,
            border=border,
            notes=notes,
            noise_floor=self._least_noise,
            reference=self._reference,
            planned_iterations={"richardson-lucy": self.roles.iterations},
            filters=self.filters,
            variance=np.where(self.dead_pixels, np.inf, self.photograph.variance)[None],
            psf=psf.astype(np.float32),
            psf_source=psf_source,
        )

    @property
    def _least_noise(self) -> float:
        """Return the rms noise of photons and readout alone; 0 if all pixels are clipped."""
        known = self.photograph.variance[~(self.clipped_pixels[0] | self.dead_pixels)]
        return float(np.sqrt(known.mean())) if known.size else 0.0

    @property
    def _reference(self) -> ReferencePicture | None:
        if self.neutral is None:
            return None
        light = self.neutral.rate[None]
        if self.filters is not None:
            rate = np.where(self.dead_pixels, np.nan, self.neutral.rate)
            clipped = ~np.isfinite(self.neutral.variance)
            light = self.filters.separate(rate, self._least_noise, clipped).astype(np.float64)
        white = float(np.percentile(light, WHITE_PERCENTILE))
        source = f"the neutral photograph of the same run, {self.neutral.name}"
        return ReferencePicture(light, white, CENTRAL_SHARE, source) if white > 0 else None


def is_record(path: Path) -> bool:
    """Return whether a file is the record of a run, by its ending."""
    return path.suffix.lower() in (".h5", ".hdf5")


def read_recorded_photograph(
    path: Path, choice: RecordSelection, progress: Progress, *, star: bool
) -> RecordedPhotograph:
    """Read the photograph to restore from a record, and the PSF from its star.

    By default this is the photograph that the plan's [reconstruct] table names, or else the last
    target that is neither dark nor star, with its exposures merged. The PSF is read only if `star`
    is true. Raises UserError if the record lacks what was selected.
    """
    with Record(path, readout=choice.readout) as record:
        roles = _choose_roles(record, choice)
        if not star:
            # The neutral photograph, unlike the PSF, needs no star.
            plan = record.plan.reconstruct or Reconstruction(coded=roles.coded)
            roles = roles.model_copy(update={"neutral": plan.neutral})
        names = {roles.photograph, roles.star} if star else {roles.photograph}
        merged = merge_all(record, progress.part(0, 0.9), names)
        found = find_photograph(record, merged, roles, star=star, frame=choice.frame)
    progress.report(1, "merged")
    return found


def find_photograph(
    record: Record,
    brackets: list[Bracket],
    roles: Reconstruction,
    *,
    star: bool = True,
    frame: int | None = None,
) -> RecordedPhotograph:
    """Find a photograph, its neutral counterpart and the star among merged exposures.

    `roles` names targets and patterns. Raises UserError if the photograph is missing.
    """
    path = record.path
    photograph = find_bracket(brackets, roles.photograph, roles.coded, roles.wavelength, path)
    sharp = [
        one
        for one in brackets
        if (one.target, one.pattern) == (roles.photograph, roles.neutral)
        and one.pattern != roles.coded
        and abs(one.wavelength - photograph.wavelength) < WAVELENGTH_TOLERANCE
    ]
    if frame is not None:
        photograph = merge_frames(record, [frame], dark_target(record.plan), record.camera.sensor)
    shown = _crop_recorded_star(record, brackets, roles) if star else None
    if shown is None:
        filters, psf = described_filters(record, photograph, roles.grey), None
    else:
        filters, psf = shown.filters, shown.bands
    dead = find_dead_pixels([photograph, *sharp], (1, 1) if filters is None else filters.period)
    if photograph.defects is not None:
        dead |= photograph.defects
    neutral = sharp[0] if sharp else None
    return RecordedPhotograph(path, photograph, psf, neutral, roles, filters, dead, frame)


def read_star_psf(path: Path, choice: RecordSelection) -> Picture:
    """Read the PSF from the star of a record, (bands, rows, columns).

    Raises UserError if the record has no such star.
    """
    with Record(path, readout=choice.readout) as record:
        plan = record.plan.reconstruct
        star = choice.star or (plan.star if plan else "star")
        pattern = choice.pattern or (plan.coded if plan else _last_stored_frame(record, (star,))[1])
        wavelength = choice.wavelength or (plan.wavelength if plan else None)
        roles = _build_roles(record, star, pattern, star, wavelength, choice.grey)
        shown = _crop_recorded_star(record, merge_all(record, Progress(), {star}), roles)
        if shown is None:
            raise UserError(
                f"{path}: has no star named {star!r} with pattern {pattern!r}; its targets are "
                f"{', '.join(record.target_names)}. Name the one that is a star: --star."
            )
    return shown.bands


def _choose_roles(record: Record, choice: RecordSelection) -> Reconstruction:
    """Choose photograph, pattern, star and wavelength: as selected, or else as the plan says."""
    plan, path = record.plan.reconstruct, record.path
    star = choice.star or (plan.star if plan else "star")
    wavelength: float | None
    if choice.frame is not None:
        target, pattern, wavelength = _frame_settings(record, choice.frame)
    else:
        told = choice.target or (plan.photograph if plan else None)
        others = [n for n in record.target_names if n not in (dark_target(record.plan), star)]
        names = (told,) if told else tuple(others)
        target, last = _last_stored_frame(record, names)
        coded = plan.coded if plan and record.select(target=target, pattern=plan.coded) else last
        pattern, wavelength = choice.pattern or coded, choice.wavelength
    frames = record.select(target=target, pattern=pattern)
    seen: list[float] = np.unique(record.column("wavelength")[frames]).tolist()
    if not seen:
        raise UserError(
            f"{path}: has no frames of {target!r} with pattern {pattern!r}. Its patterns are "
            f"{', '.join(record.pattern_names)}."
        )
    wavelength = wavelength or (plan.wavelength if plan else None)
    wrong = wavelength is not None and all(
        abs(one - wavelength) >= WAVELENGTH_TOLERANCE for one in seen
    )
    if wrong or (wavelength is None and len(seen) > 1):
        listed = ", ".join(f"{one * 1e9:g}" for one in seen)
        but = f", and not at {wavelength * 1e9:g}" if wavelength is not None else ""
        raise UserError(f"{path}: has {target!r} at {listed} nm{but}. Choose one: --wavelength-nm.")
    return _build_roles(record, target, pattern, star, wavelength, choice.grey)


def _build_roles(
    record: Record, target: str, pattern: str, star: str, wavelength: float | None, grey: bool
) -> Reconstruction:
    plan = record.plan.reconstruct or Reconstruction(coded=pattern)
    # Without frames of the star with the neutral pattern, the star with the coded pattern gives
    # position and scale of the PSF.
    seen = bool(record.select(target=star, pattern=plan.neutral))
    return plan.model_copy(
        update={
            "photograph": target,
            "coded": pattern,
            "star": star,
            "neutral": plan.neutral if seen else pattern,
            "wavelength_nm": None if wavelength is None else wavelength * 1e9,
            "grey": grey or plan.grey,
        }
    )


def _crop_recorded_star(
    record: Record, brackets: list[Bracket], roles: Reconstruction
) -> StarImage | None:
    """Cut the star out; None if the record has none."""
    if not record.select(target=roles.star, pattern=roles.coded):
        return None
    return crop_star(record, brackets, roles)


def _last_stored_frame(record: Record, names: tuple[str, ...]) -> tuple[str, str]:
    """Return target and pattern of the last frame that was recorded of the given targets."""
    frames = [index for name in names for index in record.select(target=name)]
    if not frames:
        has = ", ".join(record.target_names)
        raise UserError(
            f"{record.path}: has no frames of {' or '.join(map(repr, names)) or 'a photograph'}; "
            f"its targets are {has}. Choose one: --target."
        )
    target, pattern, _ = _frame_settings(record, max(frames))
    return target, pattern


def _frame_settings(record: Record, frame: int) -> tuple[str, str, float]:
    if not 0 <= frame < record.frame_count or not record.column("stored")[frame]:
        raise UserError(
            f"--frame {frame}: {record.path} has no such frame; it has 0 to "
            f"{record.frame_count - 1}, of which {len(record.frames_not_stored())} are missing."
        )
    target, pattern = (int(record.column(name)[frame]) for name in ("target", "pattern"))
    wavelength = float(record.column("wavelength")[frame])
    return record.target_names[target], record.pattern_names[pattern], wavelength
