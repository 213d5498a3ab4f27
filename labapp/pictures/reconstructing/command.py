"""`labapp reconstruct`: restore or decode a photograph, and write it with before and after."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from labapp.common.console import out, print_json, print_message, print_table, terminal_progress
from labapp.common.speed import machine_speed
from labapp.edof.trained_pattern import decoder_data, describe_decoder
from labapp.files.writing import encode_image, write_atomically
from labapp.pictures.analysis.colour_filters import ColourFilters
from labapp.pictures.analysis.score import ReferencePicture, Score
from labapp.pictures.reconstructing.before_after import draw_before_after, draw_before_decoded
from labapp.pictures.reconstructing.decoding import (
    DecodedPhotograph,
    DecodingProblem,
    decode_photograph,
)
from labapp.pictures.reconstructing.decoding_request import DecodingRequest
from labapp.pictures.reconstructing.method_choice import MethodChoice
from labapp.pictures.reconstructing.problem import RestorationProblem
from labapp.pictures.reconstructing.restoration import RestoredPicture, restore_picture
from labapp.pictures.reconstructing.restoration_request import RestorationRequest


@dataclass(frozen=True)
class OutputFiles:
    """The restored picture, the figure of before and after, and the PSF of a blind restoration."""

    data: Path
    picture: Path
    estimated_psf: Path | None = None


_OPTIONS = {
    "psf-scale": "--refine-psf",
    "clipping": "--clip LEVEL",
    "noise": "--noise",
    "dark": "--dark LEVEL",
    "negative": "--method l-bfgs-b",
    "iterations": "--budget S",
}
"""Options of the command that remedy a cause of a bad restoration."""

_NEUTRAL_IS_BLURRED = (
    "The neutral photograph is sharp at the lens' focus alone: where the scene is at other depths, "
    "scores against it take its blur for the truth."
)


def reconstruct_photograph(
    request: RestorationRequest, choice: MethodChoice, files: OutputFiles, *, as_json: bool
) -> None:
    """Restore a photograph, score it, write the files, and print the results.

    Raises UserError for a photograph or PSF that can't be used.
    """
    with terminal_progress() as progress:
        problem = request.read_problem(progress.part(0, 0.3))
        if choice.budget is not None:
            choice = replace(choice, speed=machine_speed(progress))
        outcome = restore_picture(problem, choice, progress.part(0.3, 0.9))
        progress.report(0.9, "drawing")
        captions = "Before", f"After: residual {outcome.residual:.2f}"
        if outcome.scores is not None:
            before, after = (f"{one.psnr:.2f} dB" for one in outcome.scores)
            captions = f"Before: {before}", f"{captions[1]}, {after}"
        drawn = draw_before_after(problem, outcome, captions)
        data = problem.encode_file(files.data, outcome.light)
        progress.report(1, "writing")
    write_atomically(files.data, data)
    write_atomically(files.picture, drawn)
    if files.estimated_psf is not None:
        write_atomically(files.estimated_psf, encode_image(files.estimated_psf, problem.psf[0]))
    if as_json:
        print_json(_as_data(problem, outcome, files))
        return
    _print_results(problem, _rows(problem, outcome), problem.notes, files)


def decode_for_command(request: DecodingRequest, files: OutputFiles, *, as_json: bool) -> None:
    """Decode a photograph, score it, write the files, and print the results.

    Raises UserError for a photograph or decoder that can't be used, or that don't belong together.
    """
    with terminal_progress() as progress:
        posed = request.read_problem(progress.part(0, 0.7))
        decoded = decode_photograph(posed, progress.part(0.7, 0.9))
        progress.report(0.9, "drawing")
        # Scores against a neutral photograph, which is blurred itself, aren't put on a picture.
        captions = "Before", "Decoded, blind"
        if decoded.scores is not None and not posed.truth_is_blurred:
            before, after = decoded.scores
            captions = f"Before: {before.psnr:.2f} dB", f"Decoded, blind: {after.psnr:.2f} dB"
        drawn = draw_before_decoded(posed, decoded, captions)
        data = posed.problem.encode_file(files.data, decoded.light)
        progress.report(1, "writing")
    write_atomically(files.data, data)
    write_atomically(files.picture, drawn)
    notes = (*decoded.notes, *([_NEUTRAL_IS_BLURRED] if posed.truth_is_blurred else []))
    if as_json:
        print_json(_decoded_as_data(posed, decoded, notes, files))
        return
    _print_results(posed.problem, _decoded_rows(posed, decoded), notes, files)


def _print_results(
    problem: RestorationProblem, rows: list[list[str]], notes: Sequence[str], files: OutputFiles
) -> None:
    print_table(problem.source, ["", "value"], rows)
    for note in notes:
        print_message(f"note: {note}")
    for file in (files.data, files.picture, files.estimated_psf):
        if file is not None:
            out.print(f"wrote {file}", soft_wrap=True)


def _rows(problem: RestorationProblem, outcome: RestoredPicture) -> list[list[str]]:
    """Return the printed rows: PSF, method, noise, residual and scores."""
    bands = outcome.bands
    masked = float((problem.clipped | ~np.isfinite(problem.light)).mean())
    told = outcome.noise_source(problem)
    scales = ""
    if outcome.refined:
        scales = f", scaled by {_join_values(_psf_scales(outcome))}"
    options = [_OPTIONS[cause] for cause in outcome.causes if cause in _OPTIONS]
    verdict = outcome.verdict + (f" ({', '.join(options)})" if options else "")
    weights = [band.weight for band in bands if band.weight is not None]
    colours = [] if problem.filters is None else [["colours", _describe_colours(problem.filters)]]
    rows = [
        *colours,
        *([["encoding", problem.encoding]] if problem.encoding else []),
        ["PSF", problem.psf_source + scales],
        ["method", outcome.method],
        ["noise", f"{_join_values([b.noise for b in bands])} {problem.unit}, {told}"],
        *([["variance map", outcome.variance_words]] if outcome.variance_uses else []),
        ["weight", _join_values(weights) if weights else "none"],
        ["iterations", " / ".join(dict.fromkeys(str(b.iterations) for b in bands))],
        ["clipped or dead pixels", f"{masked:.2%}, left out".replace("%", " %")],
        ["residual over noise", f"{outcome.residual:.2f}"],
        ["verdict", verdict],
        ["processor time", f"{outcome.cpu_seconds:.2f} s"],
    ]
    return rows + _score_rows(problem.reference, outcome.scores)


def _decoded_rows(posed: DecodingProblem, decoded: DecodedPhotograph) -> list[list[str]]:
    """Return the printed rows: decoder, pattern, levels, time and scores."""
    problem = posed.problem
    share = f"{posed.noise / posed.white:.2g} of white"
    rows = [["method", describe_decoder(posed.pattern)]]
    if posed.strehl is not None:
        rows.append(["pattern", f"as in training, Strehl ratio {posed.strehl:.4f}"])
    if posed.pattern.binning > 1:
        rows.append(["pixels", f"means of {posed.pattern.binning} x {posed.pattern.binning}"])
    rows += [
        ["white", f"{posed.white:.4g} {problem.unit}"],
        [
            "noise",
            f"{posed.noise:.3g} {problem.unit}, {share}, {problem.noise_source(posed.noise)}",
        ],
        ["clipped pixels", f"{posed.clipped}, taken as full wells"],
        ["dead pixels", f"{posed.dead}, filled"],
        ["processor time", f"{decoded.cpu_seconds:.2f} s"],
    ]
    return rows + _score_rows(problem.reference, decoded.scores)


def _score_rows(
    known: ReferencePicture | None, scores: tuple[Score, Score] | None
) -> list[list[str]]:
    """Return the printed rows on scores before and after; none without a truth."""
    if known is None or scores is None:
        return []
    before, after = scores
    gain = f"{before.psnr:.2f} to {after.psnr:.2f} dB, {after.psnr - before.psnr:+.2f}"
    rows = [["PSNR", f"{gain} ({known.crop}, peak {known.white:g})"]]
    if np.isfinite(after.ssim):
        rows.append(["SSIM", f"{before.ssim:.3f} to {after.ssim:.3f}"])
    return [*rows, ["against", known.source]]


def _describe_colours(filters: ColourFilters) -> str:
    """Say how colours are restored, and what the files hold."""
    gains = zip(filters.channels, filters.gains, strict=True)
    told = ", ".join(f"{name} {gain:.2f}" for name, gain in gains)
    if filters.is_grey:
        return f"one grey band; white gives {told}"
    return (
        f"bands {', '.join(filters.channels)} restored together; white gives {told}, and is equal "
        "in the bands written; sRGB in .png"
    )


def _psf_scales(outcome: RestoredPicture) -> list[float]:
    """Return the scale of each band's PSF that counts: 1 for one that isn't surely wrong."""
    return [one.scale if one.is_wrong else 1.0 for one in outcome.psf_scales]


def _join_values(values: list[float]) -> str:
    return " / ".join(f"{value:.3g}" for value in values)


def _as_data(
    problem: RestorationProblem, outcome: RestoredPicture, files: OutputFiles
) -> dict[str, Any]:
    bands = outcome.bands
    return {
        "source": problem.source,
        "psf": problem.psf_source,
        "method": outcome.method,
        "unit": problem.unit,
        "encoding": problem.encoding or None,
        "noise": [band.noise for band in bands],
        "noise_told": problem.noise is not None,
        "variance_map": [asdict(one) for one in outcome.variance_uses] or None,
        "weight": [band.weight for band in bands],
        "iterations": [band.iterations for band in bands],
        "converged": [band.converged for band in bands],
        "residual": outcome.residual,
        "verdict": outcome.verdict,
        "causes": outcome.causes,
        "psf_scale": _psf_scales(outcome) or None,
        "psf_refined": outcome.refined,
        "clipped_share": float(problem.clipped.mean()),
        "dead_share": float((~np.isfinite(problem.light)).mean()),
        "colours": _colours_as_data(problem.filters),
        "cpu_s": outcome.cpu_seconds,
        "score": _score_as_data(problem.reference, outcome.scores),
        "notes": list(problem.notes),
        "file": str(files.data),
        "picture": str(files.picture),
        "psf_file": files.estimated_psf and str(files.estimated_psf),
    }


def _decoded_as_data(
    posed: DecodingProblem, decoded: DecodedPhotograph, notes: Sequence[str], files: OutputFiles
) -> dict[str, Any]:
    """Return what the decoding gave, for JSON."""
    problem = posed.problem
    return {
        "source": problem.source,
        "method": "decoder",
        "blind": posed.pattern.network.settings.is_blind,
        "decoder": decoder_data(posed.pattern),
        "strehl": posed.strehl,
        "unit": problem.unit,
        "white": posed.white,
        "noise": posed.noise,
        "noise_told": problem.noise is not None,
        "clipped_pixels": posed.clipped,
        "dead_pixels": posed.dead,
        "cpu_s": decoded.cpu_seconds,
        "score": _score_as_data(problem.reference, decoded.scores),
        "notes": list(notes),
        "file": str(files.data),
        "picture": str(files.picture),
    }


def _colours_as_data(filters: ColourFilters | None) -> dict[str, Any] | None:
    """Return how colours were restored for JSON; None without colour filters."""
    if filters is None:
        return None
    return {
        "channels": list(filters.channels),
        "gains": filters.gains.tolist(),
        "grey": filters.is_grey,
        "passband_nm": filters.passband and [1e9 * one for one in filters.passband],
        "matrix_to_linear_srgb": None if filters.matrix is None else filters.matrix.tolist(),
    }


def _score_as_data(
    known: ReferencePicture | None, scores: tuple[Score, Score] | None
) -> dict[str, Any] | None:
    """Return the scores before and after for JSON; None without any."""
    if known is None or scores is None:
        return None
    told: dict[str, Any] = {"against": known.source, "crop": known.crop, "peak": known.white}
    found = [one.as_data for one in scores]
    return told | {name: [one[name] for one in found] for name in found[0]}
