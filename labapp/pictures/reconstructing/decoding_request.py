"""Read a photograph behind a trained pattern, and the decoder for the camera that has taken it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from labapp.common.errors import UserError
from labapp.edof.decoding import PhotographDecoder, build_decoder
from labapp.edof.shown_pattern import match_shown_pattern
from labapp.edof.trained_pattern import TrainedPattern, find_trained_pattern
from labapp.files.picture.photograph import Light
from labapp.pictures.reconstructing.decoding import DecodingProblem, prepare_problem
from labapp.pictures.reconstructing.recorded_photograph import is_record
from labapp.pictures.reconstructing.restoration_request import RestorationRequest
from labapp.runs.record.reader import Record
from optics.fourier import irfft2
from optics.plane import origin_to_centre
from optics.progress import Progress

_PSF_SOURCE = "mean of the pattern's PSFs over depth"


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
        request = self.photograph
        picture = request.read_picture(progress)
        if picture.filters is not None and picture.band_count > 1:
            raise _colours_refused(request.source)
        progress.report(0.1, "the decoder's filter")
        decoder = build_decoder(pattern, None, progress.part(0.1, 0.8))
        whole = picture.with_psf(_mean_psf(decoder), _PSF_SOURCE)
        return prepare_problem(whole, decoder, grey=request.choice.grey)

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
        notes: tuple[str, ...] = ()
        if not shown.same_levels:
            notes = (
                "The panel was sent other grey levels than in the training, as a calibrated one "
                f"is; the phases agree to a Strehl ratio of {shown.strehl:.4f}.",
            )
        is_blurred = request.reference is None and whole.reference is not None
        if request.reference is not None:
            whole = replace(whole, reference=request.reference)
        bound = np.where(whole.clipped, found.photograph.rate[None], whole.light)
        whole = replace(whole, light=bound.astype(np.float32), notes=notes)
        posed = prepare_problem(whole, decoder, grey=False)
        return replace(posed, strehl=shown.strehl, truth_is_blurred=is_blurred)


def _colours_refused(source: Path) -> UserError:
    """Return the error for a photograph in colours, which a decoder doesn't take."""
    return UserError(
        f"{source}: its sensor has colour filters, and a decoder is for light of one wavelength, "
        "at which its PSFs are known. Add --grey."
    )


def _mean_psf(decoder: PhotographDecoder) -> Light:
    """Return the mean PSF over depths of a decoder's pattern, (1, rows, columns).

    Its sides are odd, with the origin in the middle.
    """
    side = int(decoder.front.mean.shape[-2])
    psf = origin_to_centre(irfft2(decoder.front.mean, (side, side)))[1:, 1:]
    return psf.clamp(min=0).numpy().astype(np.float32)[None]
