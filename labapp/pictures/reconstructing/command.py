"""`labapp reconstruct`: restore a photograph, and write it with a figure of before and after."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from labapp.common.console import out, print_json, print_message, print_table, terminal_progress
from labapp.common.speed import machine_speed
from labapp.files.writing import encode_image, write_atomically
from labapp.pictures.analysis.colour_filters import ColourFilters
from labapp.pictures.analysis.score import ReferencePicture, Score
from labapp.pictures.reconstructing.before_after import draw_before_after
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
        drawn = draw_before_after(problem, outcome, _captions(outcome))
        data = problem.encode_file(files.data, outcome.light)
        progress.report(1, "writing")
    write_atomically(files.data, data)
    write_atomically(files.picture, drawn)
    if files.estimated_psf is not None:
        write_atomically(files.estimated_psf, encode_image(files.estimated_psf, problem.psf[0]))
    if as_json:
        print_json(_as_data(problem, outcome, files))
        return
    print_table(problem.source, ["", "value"], _rows(problem, outcome))
    for note in problem.notes:
        print_message(f"note: {note}")
    for file in (files.data, files.picture, files.estimated_psf):
        if file is not None:
            out.print(f"wrote {file}", soft_wrap=True)


def _captions(outcome: RestoredPicture) -> tuple[str, str]:
    after = f"After: residual {outcome.residual:.2f}"
    if outcome.scores is None:
        return "Before", after
    before, now = outcome.scores
    return f"Before: {before.psnr:.2f} dB", f"{after}, {now.psnr:.2f} dB"


def _rows(problem: RestorationProblem, outcome: RestoredPicture) -> list[list[str]]:
    """Return the printed rows: PSF, method, noise, residual and scores."""
    bands = outcome.bands
    masked = float((problem.clipped | ~np.isfinite(problem.light)).mean())
    told = outcome.noise_source(problem)
    weights = [band.weight for band in bands if band.weight is not None]
    colours = [] if problem.filters is None else [["colours", _describe_colours(problem.filters)]]
    rows = [
        *colours,
        *([["encoding", problem.encoding]] if problem.encoding else []),
        ["PSF", problem.psf_source + _refined_scale(outcome)],
        ["method", outcome.method],
        ["noise", f"{_join_values([b.noise for b in bands])} {problem.unit}, {told}"],
        *([["variance map", outcome.variance_words]] if outcome.variance_uses else []),
        ["weight", _join_values(weights) if weights else "none"],
        ["iterations", " / ".join(dict.fromkeys(str(b.iterations) for b in bands))],
        ["clipped or dead pixels", f"{masked:.2%}, left out".replace("%", " %")],
        ["residual over noise", f"{outcome.residual:.2f}"],
        ["verdict", _verdict_with_options(outcome)],
        ["processor time", f"{outcome.cpu_seconds:.2f} s"],
    ]
    return rows + score_rows(problem.reference, outcome.scores)


def score_rows(
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


def _verdict_with_options(outcome: RestoredPicture) -> str:
    """Return the verdict, with the options that help."""
    options = [_OPTIONS[cause] for cause in outcome.causes if cause in _OPTIONS]
    return outcome.verdict + (f" ({', '.join(options)})" if options else "")


def _refined_scale(outcome: RestoredPicture) -> str:
    """Say by how much the PSF was scaled, if it was."""
    if not outcome.refined:
        return ""
    scales = [one.scale if one.is_wrong else 1.0 for one in outcome.psf_scales]
    return f", scaled by {_join_values(scales)}"


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
        "psf_scale": [one.scale if one.is_wrong else 1.0 for one in outcome.psf_scales] or None,
        "psf_refined": outcome.refined,
        "clipped_share": float(problem.clipped.mean()),
        "dead_share": float((~np.isfinite(problem.light)).mean()),
        "colours": _colours_as_data(problem.filters),
        "cpu_s": outcome.cpu_seconds,
        "score": score_as_data(problem.reference, outcome.scores),
        "notes": list(problem.notes),
        "file": str(files.data),
        "picture": str(files.picture),
        "psf_file": files.estimated_psf and str(files.estimated_psf),
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


def score_as_data(
    known: ReferencePicture | None, scores: tuple[Score, Score] | None
) -> dict[str, Any] | None:
    """Return the scores before and after for JSON; None without any."""
    if known is None or scores is None:
        return None
    told: dict[str, Any] = {"against": known.source, "crop": known.crop, "peak": known.white}
    found = [one.as_data for one in scores]
    return told | {name: [one[name] for one in found] for name in found[0]}
