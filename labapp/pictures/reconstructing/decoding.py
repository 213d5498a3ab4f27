"""Decode a photograph that was taken through a trained pattern, at all depths at once."""

from __future__ import annotations

import time
from dataclasses import dataclass

import torch

from labapp.edof.trained_pattern import training_noise
from labapp.files.picture.photograph import Light
from labapp.pictures.analysis.score import Score
from labapp.pictures.reconstructing.decoding_request import DecodingProblem
from optics.edof.spectral_criterion import LEAST_NOISE
from optics.progress import Progress
from optics.threads import single_threaded


@dataclass(frozen=True, eq=False)
class DecodedPhotograph:
    """A decoded photograph.

    light: (1, rows, columns), in the unit of the photograph.
    cpu_seconds: processor time of the decoding.
    scores: before and after; None without a reference picture.
    notes: remarks for the user.
    """

    light: Light
    cpu_seconds: float
    scores: tuple[Score, Score] | None
    notes: tuple[str, ...]


@single_threaded
def decode_photograph(posed: DecodingProblem, progress: Progress) -> DecodedPhotograph:
    """Decode a photograph; the same one always gives the same bits."""
    started = time.process_time()
    problem, white = posed.problem, posed.white
    share = max(posed.noise / white, LEAST_NOISE)
    progress.report(0, "decoding")
    picture = torch.from_numpy(problem.light[0] / white)
    light: Light = (posed.decoder.decode(picture, share) * white).numpy()[None]
    progress.report(1, "decoded")
    known = problem.reference
    scores = None if known is None else (known.score(problem.light), known.score(light))
    notes = (*problem.notes, *_notes_on_pixels(posed), *_notes_on_noise(posed, share))
    return DecodedPhotograph(light, time.process_time() - started, scores, notes)


def _notes_on_pixels(posed: DecodingProblem) -> list[str]:
    """Say which pixels were filled before the decoding."""
    notes = []
    if posed.clipped:
        notes.append(
            f"{posed.clipped} clipped pixels were taken as full wells: highlights come out too "
            "dark. Expose shorter."
        )
    if posed.dead:
        notes.append(f"{posed.dead} dead pixels were filled from their neighbours.")
    return notes


def _notes_on_noise(posed: DecodingProblem, share: float) -> list[str]:
    """Say so if the noise is beyond that of the decoder's training."""
    low, high = training_noise(posed.pattern)
    if low <= share <= high:
        return []
    return [
        f"The noise is {share:.2g} of white, beyond the {low:g} to {high:g} of the decoder's "
        "training."
    ]
