"""A request for a spectral cube, as options of a command or a window state it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

from labapp.common.errors import UserError
from labapp.files.spectra_file import read_spectra_file
from labapp.pictures.reconstructing.recorded_photograph import is_record
from labapp.runs.record.reader import Record
from labapp.spectral.other_files import is_cube
from labapp.spectral.problem import SpectralProblem
from labapp.spectral.problem_reader import ProblemReader
from labapp.spectral.roles import choose_roles, white_target
from optics.inverse.blur import BORDERS, Border
from optics.progress import Progress


@dataclass(frozen=True)
class SpectralRequest:
    """A request for the spectral cube of a record's coded snapshot.

    Attributes
    ----------
    source : Path
        Record with a coded snapshot.
    bands : tuple of float or None
        Wavelengths in metres, rising; None for all that the record has.
    psf : Path or None
        File of the PSFs, or another record with a star; None for the star of `source`.
    target, pattern, star : str or None
        Photograph, coded pattern and star; None for those of the plan.
    white : str or None
        Target that is white: the star, or a white sheet; None for a target "flat" if there is one,
        and else the star.
    noise : float or None
        Standard deviation of a pixel in electrons per second; None to estimate it.
    border : Border
        What the scene does beyond the frame.
    truth : Path or None
        True cube, or a record with its neutral photographs; None for those of `source`.
    calibration : Path or None
        Spectral calibration that stands in for star and white of `source`.
    refines : bool
        Whether the photograph shall refine the model of the camera.
    """

    source: Path
    bands: tuple[float, ...] | None = None
    psf: Path | None = None
    target: str | None = None
    pattern: str | None = None
    star: str | None = None
    white: str | None = None
    noise: float | None = None
    border: Border = "unknown"
    truth: Path | None = None
    calibration: Path | None = None
    refines: bool = False

    def __post_init__(self) -> None:
        if self.border not in BORDERS:
            raise UserError(f"--border {self.border}: take one of {', '.join(BORDERS)}.")
        if self.noise is not None and not (self.noise > 0 and math.isfinite(self.noise)):
            raise UserError(f"--noise {self.noise:g}: give a number above 0.")
        replaced = {"--psf": self.psf, "--star": self.star, "--white": self.white}
        for option, value in replaced.items():
            if self.calibration is not None and value is not None:
                raise UserError(
                    f"{option} {value}: means nothing with --calibration, which stands in for star "
                    "and white. Leave one of the two out."
                )

    def read_problem(self, progress: Progress) -> SpectralProblem:
        """Read snapshot, PSFs and truth, and build the problem of restoring the cube.

        Raises UserError, which names file, value and remedy.
        """
        if not is_record(self.source) or is_cube(self.source):
            raise UserError(
                f"{self.source}: --bands needs the record of a run, run.h5: a picture doesn't say "
                "what its sensor sees of each band."
            )
        if self.truth is not None and not (is_cube(self.truth) or is_record(self.truth)):
            raise UserError(
                f"--truth {self.truth}: give a cube (.h5 or .hdr), or the record of a spectral "
                "stack."
            )
        known = None if self.calibration is None else read_spectra_file(self.calibration)
        with Record(self.source) as record:
            roles = choose_roles(record, self.target, self.pattern, self.star)
            white = white_target(record, roles, self.white)
            reader = ProblemReader(
                record, roles, white, self.bands, progress, self.psf, known, self.refines
            )
            problem = reader.read_problem(self.noise, self.border)
            return reader.add_truth(problem, self.truth)
