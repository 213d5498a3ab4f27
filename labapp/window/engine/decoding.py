"""Decoded photographs: find the decoder of a record's photograph, and decode it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from labapp.common.errors import UserError
from labapp.edof.shown_pattern import match_shown_pattern
from labapp.edof.trained_pattern import BUNDLED, BUNDLED_PATTERN, find_trained_pattern, name_decoder
from labapp.files.grey_table import ImagePattern
from labapp.files.output_paths import is_design, require_photograph_ending
from labapp.files.picture.photograph_writing import encode_srgb
from labapp.files.plan_file import Reconstruction
from labapp.files.writing import write_atomically
from labapp.pictures.reconstructing.before_after import middle_of_psf
from labapp.pictures.reconstructing.decoding import (
    DecodedPhotograph,
    DecodingProblem,
    decode_photograph,
)
from labapp.pictures.reconstructing.decoding_request import DecodingRequest
from labapp.pictures.reconstructing.recorded_photograph import RecordSelection
from labapp.pictures.reconstructing.restoration_request import RestorationRequest
from labapp.runs.record.reader import Record
from labapp.spectral.roles import choose_roles
from labapp.window.commands import ReconstructRun
from labapp.window.messages import ReconstructionResult
from optics.progress import Progress


@dataclass(frozen=True, eq=False)
class Decoding:
    """A decoded photograph, kept until another restoration replaces it."""

    path: Path
    posed: DecodingProblem
    decoded: DecodedPhotograph

    @property
    def result_message(self) -> ReconstructionResult:
        """Return the decoded photograph as a message to the window."""
        posed, decoded, problem = self.posed, self.decoded, self.posed.problem
        known = problem.reference
        return ReconstructionResult(
            path=self.path,
            source=problem.source.removeprefix(f"{self.path}, "),
            before=encode_srgb(problem.screen_picture(problem.light)),
            after=encode_srgb(problem.screen_picture(decoded.light)),
            neutral=None if known is None else encode_srgb(problem.screen_picture(known.light)),
            psf=middle_of_psf(problem.psf)[0],
            # Beside pictures, a score against the neutral photograph's blur would mislead.
            scores=None,
            method=name_decoder(posed.pattern),
            noise=posed.noise,
            noise_source=problem.noise_source(posed.noise),
            unit=problem.unit,
            weight=None,
            iterations=None,
            residual=None,
            verdict=" ".join(decoded.notes),
            cpu_seconds=decoded.cpu_seconds,
        )

    def save(self, path: Path) -> None:
        """Save the picture in the format of the file's ending; UserError if that isn't known."""
        require_photograph_ending(path)
        if not path.parent.is_dir():
            raise UserError(f"{path.parent}: is not a folder. Choose another place.")
        write_atomically(path, self.posed.problem.encode_file(path, self.decoded.light))


def decode_record(command: ReconstructRun, progress: Progress) -> Decoding:
    """Decode the photograph of a record.

    Raises UserError if it wasn't taken through a trained pattern whose decoder is at hand.
    """
    decoder = find_decoder(command.path)
    if decoder is None:
        raise UserError(
            f"{command.path}: its photograph wasn't taken through the bundled pattern (Extended "
            "depth of field) or a design file with a decoder (Image file). Choose another method."
        )
    photograph = RestorationRequest(command.path, choice=RecordSelection(grey=command.grey))
    posed = DecodingRequest(photograph, decoder).read_problem(progress.part(0, 0.8))
    return Decoding(command.path, posed, decode_photograph(posed, progress.part(0.8, 1)))


def find_decoder(path: Path) -> str | None:
    """Return the decoder of a record's coded photograph: a design file, or the bundled one's word.

    Returns None if there is none at hand, or the record can't be read; its restoration says why.
    """
    try:
        with Record(path) as record:
            roles = choose_roles(record, None, None, None)
            fitting = (one for one in _candidates(record, roles) if _fits(one, record, roles))
            return next(fitting, None)
    except (UserError, OSError):
        return None


def _candidates(record: Record, roles: Reconstruction) -> Iterator[str]:
    """Yield the decoders that may be those of a record's coded pattern: its own file, the bundled.

    A file's path may be relative to the record's folder.
    """
    table = record.plan.patterns.get(roles.coded)
    if isinstance(table, ImagePattern) and is_design(Path(table.file)):
        yield str(record.path.parent / table.file)
    if BUNDLED_PATTERN.is_file():
        yield BUNDLED


def _fits(decoder: str, record: Record, roles: Reconstruction) -> bool:
    """Return whether the coded pattern of a record is that of a decoder."""
    frames = record.select(target=roles.photograph, pattern=roles.coded)
    if not frames:
        return False
    camera, grey = record.camera, record.pattern(roles.coded)
    wavelength = float(record.column("wavelength")[frames[0]])
    try:
        match_shown_pattern(find_trained_pattern(decoder), camera, grey, wavelength, roles.coded)
    except UserError:
        return False
    return True
