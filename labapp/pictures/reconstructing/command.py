"""`labapp reconstruct`: a photograph with its blur undone, and the picture of before and after."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from labapp.common.console import out, print_json, say, table, watched
from labapp.common.speed import machine_speed
from labapp.files.photograph_file import written
from labapp.files.writing import encoded, write_whole
from labapp.pictures.reconstructing.asked import AskedProblem
from labapp.pictures.reconstructing.drawing import draw
from labapp.pictures.reconstructing.methods import Wish
from labapp.pictures.reconstructing.problem import Problem
from labapp.pictures.reconstructing.restoring import Outcome, restore_picture


@dataclass(frozen=True)
class Files:
    """Where the answer goes, the picture of before and after, and a PSF that nobody knew."""

    data: Path
    picture: Path
    found: Path | None = None


def reconstruct(asked: AskedProblem, wish: Wish, files: Files, *, as_json: bool) -> None:
    """Restore, judge, write the files, and say how far to trust it; UserError if it can't be."""
    with watched() as progress:
        problem = asked.problem(progress.part(0, 0.3))
        if wish.budget is not None:
            wish = replace(wish, speed=machine_speed(progress))
        outcome = restore_picture(problem, wish, progress.part(0.3, 0.9))
        progress.report(0.9, "drawing")
        drawn = draw(problem, outcome, _captions(outcome))
        full = problem.full if problem.full is not None else problem.white
        data = written(files.data, outcome.light, problem.coded, full)
        progress.report(1, "writing")
    write_whole(files.data, data)
    write_whole(files.picture, drawn)
    if files.found is not None:
        write_whole(files.found, encoded(files.found, problem.psf[0]))
    if as_json:
        print_json(_as_data(problem, outcome, files))
        return
    table(problem.source, ["", "value"], _rows(problem, outcome))
    for note in problem.notes:
        say(f"note: {note}")
    for file in (files.data, files.picture, files.found):
        if file is not None:
            out.print(f"wrote {file}", markup=False, soft_wrap=True)


def _captions(outcome: Outcome) -> tuple[str, str]:
    after = f"After: residual {outcome.residual:.2f}"
    if outcome.scores is None:
        return "Before", after
    before, now = outcome.scores
    return f"Before: {before.psnr:.2f} dB", f"{after}, {now.psnr:.2f} dB"


def _rows(problem: Problem, outcome: Outcome) -> list[list[str]]:
    bands = outcome.bands
    masked = float((problem.clipped | ~np.isfinite(problem.light)).mean())
    told = problem.noise_source(bands[0].noise)
    weights = [band.weight for band in bands if band.weight is not None]
    rows = [
        ["PSF", problem.psf_source],
        ["method", outcome.method],
        ["noise", f"{_each([b.noise for b in bands])} {problem.unit}, {told}"],
        ["weight", _each(weights) if weights else "none"],
        ["iterations", " / ".join(dict.fromkeys(str(b.iterations) for b in bands))],
        ["clipped or dead pixels", f"{masked:.2%}, left out".replace("%", " %")],
        ["residual over noise", f"{outcome.residual:.2f}; {outcome.verdict}"],
        ["processor time", f"{outcome.cpu_seconds:.2f} s"],
    ]
    if (known := problem.reference) is not None and outcome.scores is not None:
        before, after = outcome.scores
        gain = f"{before.psnr:.2f} to {after.psnr:.2f} dB, {after.psnr - before.psnr:+.2f}"
        rows.append(["PSNR", f"{gain} ({known.crop}, peak {known.white:g})"])
        if np.isfinite(after.ssim):
            rows.append(["SSIM", f"{before.ssim:.3f} to {after.ssim:.3f}"])
        rows.append(["against", known.source])
    return rows


def _each(values: list[float]) -> str:
    return " / ".join(f"{value:.3g}" for value in values)


def _as_data(problem: Problem, outcome: Outcome, files: Files) -> dict[str, Any]:
    bands = outcome.bands
    return {
        "source": problem.source,
        "psf": problem.psf_source,
        "method": outcome.method,
        "unit": problem.unit,
        "noise": [band.noise for band in bands],
        "noise_told": problem.noise is not None,
        "weight": [band.weight for band in bands],
        "iterations": [band.iterations for band in bands],
        "converged": [band.converged for band in bands],
        "residual": outcome.residual,
        "verdict": outcome.verdict,
        "clipped_share": float(problem.clipped.mean()),
        "dead_share": float((~np.isfinite(problem.light)).mean()),
        "cpu_s": outcome.cpu_seconds,
        "score": _score(problem, outcome),
        "notes": list(problem.notes),
        "file": str(files.data),
        "picture": str(files.picture),
        "psf_file": files.found and str(files.found),
    }


def _score(problem: Problem, outcome: Outcome) -> dict[str, Any] | None:
    """Before and after, against the picture as it should be; None where nobody knows that."""
    known = problem.reference
    if known is None or outcome.scores is None:
        return None
    told: dict[str, Any] = {"against": known.source, "crop": known.crop, "peak": known.white}
    scores = [one.as_data for one in outcome.scores]
    return told | {name: [one[name] for one in scores] for name in scores[0]}
