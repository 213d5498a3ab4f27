"""Read what a decoder needs: a photograph, prepared, and the decoder for the camera behind it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from labapp.common.errors import UserError
from labapp.edof.decoding import PhotographDecoder, build_decoder
from labapp.edof.shown_pattern import ShownPattern, match_shown_pattern
from labapp.edof.trained_pattern import TrainedPattern, find_trained_pattern
from labapp.files.picture.photograph import Light
from labapp.pictures.analysis.score import ReferencePicture
from labapp.pictures.reconstructing.decoding_levels import estimate_white, noise_level
from labapp.pictures.reconstructing.pixel_preparation import (
    average_squares,
    fill_gaps,
    merge_bands,
)
from labapp.pictures.reconstructing.problem import RestorationProblem
from labapp.pictures.reconstructing.raw_to_restore import RawToRestore
from labapp.pictures.reconstructing.recorded_photograph import is_record
from labapp.pictures.reconstructing.restoration_request import RestorationRequest
from labapp.runs.record.reader import Record
from optics.fourier import irfft2
from optics.plane import origin_to_centre
from optics.progress import Progress
from optics.threads import single_threaded

_PSF_SOURCE = "mean of the pattern's PSFs over depth"


@dataclass(frozen=True, eq=False)
class DecodingProblem:
    """A photograph behind a trained pattern, with its decoder.

    problem: the photograph in one band, without gaps, and the mean PSF over depths.
    decoder: for the camera that has taken it.
    noise: standard deviation of a pixel's noise that the decoder is told, in the photograph's unit.
    white: light that the decoder takes as white, in that unit.
    clipped, dead: pixels of the photograph that were clipped or dead, and were filled.
    strehl: likeness of the pattern that the record's panel has shown with the decoder's, from 0 to
        1; None for a file.
    truth_is_blurred: whether the reference is a neutral photograph, which is sharp at the lens'
        focus alone.
    """

    problem: RestorationProblem
    decoder: PhotographDecoder
    noise: float
    white: float
    clipped: int
    dead: int
    strehl: float | None = None
    truth_is_blurred: bool = False

    @property
    def pattern(self) -> TrainedPattern:
        """The trained pattern that the photograph was taken through."""
        return self.decoder.pattern


@dataclass(frozen=True)
class DecodingRequest:
    """What to decode, and by which decoder.

    photograph: its file, and what is known of it.
    decoder: design file of the decoder, or "edof" for the bundled one.
    """

    photograph: RestorationRequest
    decoder: str

    def read_problem(self, progress: Progress) -> DecodingProblem:
        """Read photograph and decoder, and check that they belong together.

        Raises UserError, which names what doesn't, and the remedy.
        """
        pattern = find_trained_pattern(self.decoder)
        if is_record(self.photograph.source):
            return self._read_record(pattern, progress)
        if (raw := self.photograph.read_raw(progress)) is not None:
            return self._prepare_raw(raw, pattern, progress)
        return self._read_picture(pattern, progress)

    def _prepare_raw(
        self, raw: RawToRestore, pattern: TrainedPattern, progress: Progress
    ) -> DecodingProblem:
        """Prepare a RAW photograph for its decoder, which takes one band."""
        request = self.photograph
        if raw.band_count > 1:
            raise _colours_refused(request.source)
        progress.report(0.1, "the decoder's filter")
        decoder = build_decoder(pattern, None, progress.part(0.1, 0.8))
        whole = raw.build_problem(
            _mean_psf(decoder), _PSF_SOURCE, request.noise, reference=request.reference
        )
        return _prepare(whole, decoder, grey=False)

    def _read_picture(self, pattern: TrainedPattern, progress: Progress) -> DecodingProblem:
        request = self.photograph
        picture = request.read_picture(progress)
        progress.report(0.1, "the decoder's filter")
        decoder = build_decoder(pattern, None, progress.part(0.1, 0.8))
        whole = request.build_picture_problem(picture, _mean_psf(decoder), _PSF_SOURCE)
        return _prepare(whole, decoder, grey=request.choice.grey)

    def _read_record(self, pattern: TrainedPattern, progress: Progress) -> DecodingProblem:
        request = self.photograph
        found = request.read_record(progress.part(0, 0.3), star=False)
        if found.filters is not None and not found.filters.is_grey:
            raise _colours_refused(request.source)
        with Record(request.source, readout=request.choice.readout) as record:
            grey = record.pattern(found.photograph.pattern)
            camera = record.camera
        source = f"{request.source}: its pattern {found.photograph.pattern!r}"
        shown = match_shown_pattern(pattern, camera, grey, found.photograph.wavelength, source)
        progress.report(0.3, "the decoder's filter")
        decoder = build_decoder(shown.pattern, shown.camera, progress.part(0.3, 0.8))
        whole = found.build_problem(_mean_psf(decoder), _PSF_SOURCE, request.noise)
        notes = [] if shown.same_levels else [_note_on_levels(shown)]
        is_blurred = request.reference is None and whole.reference is not None
        if request.reference is not None:
            whole = replace(whole, reference=request.reference)
        bound = np.where(whole.clipped, found.photograph.rate[None], whole.light)
        whole = replace(whole, light=bound.astype(np.float32), notes=tuple(notes))
        posed = _prepare(whole, decoder, grey=False)
        return replace(posed, strehl=shown.strehl, truth_is_blurred=is_blurred)


def _colours_refused(source: Path) -> UserError:
    """Return the error for a photograph in colours, which a decoder doesn't take."""
    return UserError(
        f"{source}: its sensor has colour filters, and a decoder is for light of one wavelength, "
        "at which its PSFs are known. Add --grey."
    )


def _note_on_levels(shown: ShownPattern) -> str:
    """Say that a panel was sent other grey levels than those of the training, and how it shows."""
    return (
        "The panel was sent other grey levels than in the training, as a calibrated one is; the "
        f"phases agree to a Strehl ratio of {shown.strehl:.4f}."
    )


def _mean_psf(decoder: PhotographDecoder) -> Light:
    """Return the mean PSF over depths of a decoder's pattern, (1, rows, columns).

    Its sides are odd, with the origin in the middle.
    """
    side = int(decoder.front.mean.shape[-2])
    psf = origin_to_centre(irfft2(decoder.front.mean, (side, side)))[1:, 1:]
    return psf.clamp(min=0).numpy().astype(np.float32)[None]


@single_threaded
def _prepare(
    whole: RestorationProblem, decoder: PhotographDecoder, *, grey: bool
) -> DecodingProblem:
    """Turn a photograph into one band of averaged squares, and fill its gaps."""
    side, source = decoder.pattern.binning, whole.source
    if not (np.isfinite(whole.light) & ~whole.clipped).any():
        raise UserError(f"{source}: every pixel is clipped or dead. Expose shorter.")
    dead = ~np.isfinite(whole.light)
    one = merge_bands(whole.blurred_bands, grey=grey, source=source)
    light = average_squares(one, side)
    full = whole.clipped.max(0, keepdims=True).astype(np.float32)
    clipped = average_squares(full, side) > 0
    problem = replace(
        whole,
        light=fill_gaps(light[0])[None],
        clipped=clipped,
        noise=None if whole.noise is None else whole.noise / side,
        noise_floor=whole.noise_floor / side,
        reference=_prepare_reference(whole.reference, side),
        filters=None,
    )
    noise = noise_level(problem)
    white = estimate_white(problem, decoder.front, noise)
    if problem.full_scale is None:
        problem = replace(problem, full_scale=white)
    counts = int(whole.clipped.any(0).sum()), int(dead.any(0).sum())
    return DecodingProblem(problem, decoder, noise, white, *counts)


def _prepare_reference(reference: ReferencePicture | None, side: int) -> ReferencePicture | None:
    """Bring the truth to the band and the pixels of the decoded photograph."""
    if reference is None:
        return None
    one = merge_bands(reference.light, grey=True, source=reference.source)
    return replace(reference, light=average_squares(one, side))
