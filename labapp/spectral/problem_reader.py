"""Reading a record into the problem of restoring its coded snapshot."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from labapp.common.errors import UserError
from labapp.files.cubes import SpectralCube, read_cube
from labapp.files.plan_file import Reconstruction
from labapp.files.spectra_file import SpectraSource
from labapp.pictures.analysis.brackets import Bracket, merge_all
from labapp.pictures.analysis.dead_pixels import find_dead_pixels
from labapp.pictures.reconstructing.recorded_photograph import is_record
from labapp.runs.record.reader import Record
from labapp.spectral.band_psfs import BandPSFs, measure_band_psfs, require_star
from labapp.spectral.band_response import (
    BandResponse,
    band_gains,
    broad_gains,
    mosaic_of,
    response_from_sheet,
    response_from_star,
)
from labapp.spectral.calibrated_bands import CalibratedBands, choose_calibrated_bands
from labapp.spectral.neutral_stack import coded_light_share, find_stack, separate_neutral_bands
from labapp.spectral.other_files import (
    is_cube,
    measure_psfs_of_record,
    neutral_stack_of_record,
    read_psf_stack,
    read_true_cube,
)
from labapp.spectral.problem import SpectralProblem
from labapp.spectral.snapshot import (
    CodedSnapshot,
    SnapshotBands,
    add_photographs,
    choose_bands,
    recorded_wavelengths,
)
from labapp.spectral.snapshot_prior import prior_of_run, require_filters
from optics.inverse.blur import Border
from optics.progress import Progress

_MERGING_SHARE = 0.8  # of the progress; PSFs and true bands take the rest

_MONO_NOTE = (
    "the sensor has no colour filters: bands are told apart by their PSFs alone, which is poor. A "
    "sensor with colour filters shows more"
)

_SHARE_NOTE = (
    "the share of the light that the coded pattern passes isn't known: bands may be some percent "
    "darker than they are. Neutral photographs at all bands show it"
)

_BROAD_NOTE = (
    "the snapshot is in broad light: the levels of its bands are those that the star has through "
    "the narrow filter, whose transmission they include"
)


@dataclass(frozen=True, eq=False)
class ProblemReader:
    """Reads the snapshot of an open record, its PSFs, response and truth.

    white: target that counts as white: the star, or a white sheet.
    wanted: bands in metres, rising; None for all.
    psf: file with the PSFs; None for the record's star.
    calibration: stands in for the record's star and white; None without one.
    refines: whether the photograph shall refine the model of the camera.
    """

    record: Record
    roles: Reconstruction
    white: str
    wanted: tuple[float, ...] | None
    progress: Progress
    psf: Path | None = None
    calibration: SpectraSource | None = None
    refines: bool = False

    def read_problem(self, noise: float | None, border: Border) -> SpectralProblem:
        """Build the problem without its truth.

        `noise` is in electrons per second and pixel; None to estimate it.
        """
        # What can be refused without a picture is refused before the pictures are merged.
        if self.refines:
            require_filters("--refine", mosaic_of(self.record))
        if self.calibration is None and self.psf is None:
            require_star(self.record, self.roles, self.bands.wavelengths)
        _ = self._calibrated_bands, self._psf_stack
        snapshot = self.snapshot
        self.progress.report(_MERGING_SHARE, "PSFs of the bands")
        psfs, psf_source = self._band_psfs()
        response = self._response(psfs)
        prior, calibrated = None, self._calibrated_bands
        if self.refines:
            prior = calibrated.prior if calibrated else prior_of_run(psfs, response)
        return SpectralProblem(
            np.where(self._dead, np.nan, snapshot.rate),
            snapshot.clipped & ~self._dead,
            self.bands.wavelengths,
            psfs.psfs,
            response,
            snapshot.noise,
            f"{self.record.path}, {snapshot.source}",
            psf_source,
            noise,
            border,
            pitch=self.record.camera.sensor.pitch,
            prior=prior,
            notes=(*psfs.notes, *self._remarks(psfs.knows_share)),
        )

    def add_truth(self, problem: SpectralProblem, path: Path | None) -> SpectralProblem:
        """Add the true bands of a cube, another record, or the record itself (`path` None)."""
        self.progress.report(0.5 * (1 + _MERGING_SHARE), "true bands")
        if path is not None and is_cube(path):
            truth = read_true_cube(path, problem.wavelengths)
            return replace(problem, given_truth=truth, notes=(*problem.notes, *truth.notes))
        if path is not None:
            with Record(path) as other:
                stack = neutral_stack_of_record(
                    other, self.roles, problem.wavelengths, problem.rate.shape
                )
                bands, own = separate_neutral_bands(other, stack, self._dead), str(other.path)
        elif self._neutral:
            bands = separate_neutral_bands(self.record, self._neutral, self._dead)
            own = "the same run"
        else:
            return problem
        words = f"the neutral photographs of {own}, {self.roles.photograph}, {self.roles.neutral}"
        return replace(problem, truth=bands, truth_source=words)

    def _remarks(self, psfs_know_share: bool) -> list[str]:
        """Say what limits the bands; a calibration has remarks of its own on the last two."""
        said = [] if mosaic_of(self.record) is not None else [_MONO_NOTE]
        pictures = self.snapshot.pictures
        if lacking := sum(one.dark_frames == 0 for one in pictures):
            said.append(
                f"{lacking} of {len(pictures)} photographs have no dark frames of their exposures: "
                'the sensor\'s black level is subtracted. Add { role = "dark", frames = 4 } to the '
                "plan"
            )
        if self.calibration is not None:
            return said
        if not psfs_know_share and self._light_share is None:
            said.append(_SHARE_NOTE)
        return [*said, _BROAD_NOTE] if self.bands.is_broad else said

    @cached_property
    def bands(self) -> SnapshotBands:
        """Choose the bands, and the photographs that show them."""
        return choose_bands(self.record, self.roles, self.wanted, self._bands_with_psfs())

    @cached_property
    def snapshot(self) -> CodedSnapshot:
        """Add the coded photographs of all bands."""
        return add_photographs(self._brackets, self.roles, self.bands, self.record.path)

    @cached_property
    def _brackets(self) -> list[Bracket]:
        """Merge the pictures of photograph, star and white sheet."""
        names = {self.roles.photograph}
        if self.calibration is None:
            names |= {self.roles.star, self.white}
        return merge_all(self.record, self.progress.part(0, _MERGING_SHARE), names)

    @cached_property
    def _neutral(self) -> list[Bracket]:
        """Find the neutral photographs of all bands; none if one is missing."""
        roles = self.roles
        return [] if roles.neutral == roles.coded else self._stack(roles.photograph, roles.neutral)

    @cached_property
    def _dead(self) -> NDArray[np.bool_]:
        """Find the sensor's dead pixels, (rows, columns)."""
        mosaic = mosaic_of(self.record)
        period = (1, 1) if mosaic is None else (len(mosaic.pattern), len(mosaic.pattern[0]))
        return find_dead_pixels([*self.snapshot.pictures, *self._neutral], period)

    def _bands_with_psfs(self) -> tuple[float, ...]:
        """Return the wavelengths in metres at which the record or a file has PSFs."""
        roles = self.roles
        if self.calibration is not None:
            return self.calibration.file.wavelengths
        if self.psf is None:
            return recorded_wavelengths(self.record, roles.star, roles.coded)
        if is_cube(self.psf):
            return read_cube(self.psf).wavelengths
        if is_record(self.psf):
            with Record(self.psf) as other:
                return recorded_wavelengths(other, roles.star, roles.coded)
        return self.wanted or ()

    def _band_psfs(self) -> tuple[BandPSFs, str]:
        """Return the PSFs of the bands, and in words where they are from.

        The star's light is only known from the record's own.
        """
        bands, star = self.bands.wavelengths, self.roles.star
        if self._calibrated_bands is not None:
            return self._calibrated_bands.psfs, self._calibrated_bands.source
        if self.psf is None:
            found = measure_band_psfs(self.record, self._brackets, self.roles, bands)
            source = f"star {star!r} of the same run, in each band"
        elif self._psf_stack is not None:
            values = self._psf_stack.values.astype(np.float64)
            found, source = BandPSFs(values, None, notes=self._psf_stack.notes), str(self.psf)
        else:
            found = measure_psfs_of_record(self.psf, self.roles, bands, self.record)
            source = f"star {star!r} of {self.psf}, in each band"
        return found.with_light_share(self._light_share), source

    @cached_property
    def _calibrated_bands(self) -> CalibratedBands | None:
        """Choose the bands from the calibration; None without one."""
        if self.calibration is None:
            return None
        bands, coded = self.bands, self.roles.coded
        return choose_calibrated_bands(
            self.calibration, self.record, coded, bands.wavelengths, is_broad=bands.is_broad
        )

    @cached_property
    def _psf_stack(self) -> SpectralCube | None:
        """Read the PSFs of the bands from a file, with remarks; None if from a star."""
        if self.psf is None or (is_record(self.psf) and not is_cube(self.psf)):
            return None
        known = self.wanted is not None or is_cube(self.psf)
        wavelengths = self.bands.wavelengths if known else None
        return read_psf_stack(self.psf, wavelengths, self.record.camera.sensor.pitch)

    @cached_property
    def _light_share(self) -> NDArray[np.float64] | None:
        """Measure the share of the light that the coded pattern passes, (bands,).

        The white sheet shows it, or the photographs; None where neither was recorded with both
        patterns.
        """
        roles = self.roles
        for target in (self.white, roles.photograph):
            if target == roles.star or roles.neutral == roles.coded:
                continue
            coded, neutral = (self._stack(target, one) for one in (roles.coded, roles.neutral))
            if coded and neutral:
                return coded_light_share(coded, neutral)
        return None

    def _stack(self, target: str, pattern: str) -> list[Bracket]:
        """Find the pictures of a target with a pattern in all bands; none if one is missing."""
        return find_stack(self._brackets, target, pattern, self.bands.wavelengths)

    def _response(self, psfs: BandPSFs) -> BandResponse:
        """Return what white gives in each band behind each filter."""
        if self._calibrated_bands is not None:
            return self._calibrated_bands.response
        mosaic, star = mosaic_of(self.record), self.roles.star
        bands, is_broad = self.bands.wavelengths, self.bands.is_broad
        if self.white != star and is_broad:
            raise UserError(
                f"--white {self.white}: the snapshot is one photograph in broad light, in which a "
                f"white sheet doesn't show its bands. Take the star: --white {star}."
            )
        if self.white != star:
            neutral = self.roles.neutral
            return response_from_sheet(self.record, self._brackets, self.white, neutral, bands)
        if is_broad:
            gains = broad_gains(mosaic, bands)
        else:
            pictures = self.snapshot.pictures
            gains = np.stack([band_gains(self.record, one) for one in pictures], axis=1)
        return response_from_star(mosaic, gains, psfs.light, star)
