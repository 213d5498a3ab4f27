"""`labapp reconstruct --bands`: restore a spectral cube, and write it with its colours."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from labapp.common.console import out, print_json, print_message, print_table, terminal_progress
from labapp.common.errors import UserError
from labapp.files.cubes import write_cube
from labapp.files.wavelengths import format_nanometres, list_nanometres
from labapp.files.writing import write_atomically
from labapp.spectral.drawing import draw_snapshot, encode_colours
from labapp.spectral.lights import find_light
from labapp.spectral.problem import SpectralProblem
from labapp.spectral.refinement import parameter_rows, parameters_as_data
from labapp.spectral.request import SpectralRequest
from labapp.spectral.restoration import RestoredCube, restore_snapshot
from labapp.spectral.scores import CubeScores
from optics.multispectral import SnapshotCalibration


@dataclass(frozen=True)
class SpectralFiles:
    """Files that are written: the cube, its colours, and the drawing of all."""

    cube: Path
    colours: Path
    picture: Path


def reconstruct_spectra(
    request: SpectralRequest,
    files: SpectralFiles,
    light: str,
    weight: float | None,
    *,
    as_json: bool,
) -> None:
    """Restore and score the cube of a coded snapshot, write its files, and print the results.

    `light` names the light of the colours. Raises UserError for a record, file or light that can't
    be used.
    """
    if weight is not None and not 0 < weight < math.inf:
        raise UserError(f"--weight {weight:g}: give a number above 0.")
    if weight is not None and request.refines:
        raise UserError("--weight: means nothing with --refine. Leave one of the two out.")
    viewing = find_light(light)
    with terminal_progress() as progress:
        problem = request.read_problem(progress.part(0, 0.4))
        restored = restore_snapshot(
            problem, viewing, weight=weight, progress=progress.part(0.4, 0.9)
        )
        prior, problem = problem.prior, restored.problem
        progress.report(0.9, "drawing")
        drawn = draw_snapshot(problem, restored, viewing)
        colours = encode_colours(files.colours, restored.cube, viewing)
        progress.report(1, "writing")
    cubes = write_cube(files.cube, restored.cube)
    write_atomically(files.colours, colours)
    write_atomically(files.picture, drawn)
    if as_json:
        print_json(_as_data(problem, restored, files) | _refined_data(restored, prior))
        return
    print_table(problem.source, ["", "value"], _rows(problem, restored))
    if restored.scores is not None:
        _print_band_scores(problem, restored.scores)
    if restored.calibration is not None and prior is not None:
        _print_refinement(restored.calibration, prior, problem.wavelengths)
    for note in _notes(problem, restored):
        print_message(f"note: {note}")
    for file in (*cubes, files.colours, files.picture):
        out.print(f"wrote {file}", soft_wrap=True)


def _notes(problem: SpectralProblem, restored: RestoredCube) -> list[str]:
    """Return the remarks for the user, doubtful bands included."""
    return [*problem.notes, *([restored.doubts] if restored.doubts else [])]


def _rows(problem: SpectralProblem, restored: RestoredCube) -> list[list[str]]:
    """Return the printed rows on bands, PSFs, white, noise and scores."""
    image = restored.image
    masked = float((problem.clipped | problem.dead_pixels).mean())
    weight = "none" if image.weight is None else f"{image.weight:.3g}"
    stated = "as given" if problem.noise is not None else "estimated"
    rows = [
        ["bands", list_nanometres(problem.wavelengths)],
        ["PSFs", problem.psf_source],
        ["white", problem.response.source],
        ["method", image.method],
        ["noise", f"{image.noise:.3g} electrons per second, {stated}"],
        ["weight", weight],
        ["iterations", str(image.iterations)],
        ["clipped or dead pixels", f"{masked:.2%}, left out".replace("%", " %")],
        ["residual over noise", f"{image.residual:.2f}"],
        ["verdict", str(restored.verdict)],
        ["processor time", f"{restored.cpu_seconds:.2f} s"],
    ]
    if (scores := restored.scores) is not None:
        source = problem.truth_source or "the cube of --truth"
        rows += [
            ["PSNR", f"{scores.psnr:.2f} dB, mean of the bands ({scores.crop}, peak 1)"],
            ["SSIM", f"{scores.ssim:.3f}, mean of the bands (range 1)"],
            ["spectral angle", _angle_in_words(scores)],
            ["CIEDE2000", _difference_in_words(scores)],
            ["against", source],
        ]
    return rows


def _angle_in_words(scores: CubeScores) -> str:
    """Say the mean spectral angle in words."""
    if not math.isfinite(scores.angle):
        return "no pixel of the true cube is bright enough"
    return f"{scores.angle:.1f}°, mean of the pixels that aren't dark"


def _difference_in_words(scores: CubeScores) -> str:
    """Say the mean colour difference in words, with its light and interpolation."""
    return (
        f"{scores.difference:.1f} mean, {scores.largest_difference:.1f} at 95 % of the pixels, in "
        f"{scores.light}, by {scores.interpolation}"
    )


def _print_band_scores(problem: SpectralProblem, scores: CubeScores) -> None:
    rows = [
        (format_nanometres(wavelength), f"{one.psnr:.2f}", f"{one.ssim:.3f}")
        for wavelength, one in zip(problem.wavelengths, scores.bands, strict=True)
    ]
    print_table("Bands", ["band ", "PSNR dB ", "SSIM "], rows)


def _print_refinement(
    found: SnapshotCalibration, prior: SnapshotCalibration, wavelengths: Sequence[float]
) -> None:
    """Print what the photograph says of the camera's model, and what it can't tell."""
    rows = parameter_rows(found, prior, wavelengths)
    print_table("Camera, refined from the photograph", ["what", "found ", "", "before "], rows)
    print_message(f"before: {prior.source}")
    for line in found.indeterminate:
        print_message(f"indeterminate: {line}")


def _refined_data(restored: RestoredCube, prior: SnapshotCalibration | None) -> dict[str, Any]:
    """Return what is known of the refined camera for JSON; None without a refinement."""
    found = restored.calibration
    if found is None or prior is None:
        return {"refined": None}
    return {"refined": parameters_as_data(found, prior, restored.problem.wavelengths)}


def _as_data(
    problem: SpectralProblem, restored: RestoredCube, files: SpectralFiles
) -> dict[str, Any]:
    """Return the results for JSON."""
    image, truth = restored.image, problem.truth_source
    return {
        "source": problem.source,
        "bands_nm": [round(one * 1e9, 6) for one in problem.wavelengths],
        "psf": problem.psf_source,
        "white": problem.response.source,
        "channels": problem.response.channels,
        "response": problem.response.shares.tolist(),
        "unit": restored.cube.unit,
        "white_electrons_per_s": restored.white,
        "method": image.method,
        "noise": image.noise,
        "noise_given": problem.noise is not None,
        "weight": image.weight,
        "iterations": image.iterations,
        "converged": image.converged,
        "residual": image.residual,
        "verdict": str(restored.verdict),
        "causes": [one.cause for one in restored.verdict.findings],
        "clipped_share": float(problem.clipped.mean()),
        "dead_share": float(problem.dead_pixels.mean()),
        "cpu_s": restored.cpu_seconds,
        "score": restored.scores and restored.scores.as_data | {"against": truth or "--truth"},
        "notes": _notes(problem, restored),
        "file": str(files.cube),
        "colours": str(files.colours),
        "picture": str(files.picture),
    }
