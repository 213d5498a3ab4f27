"""`labapp reconstruct --bands`: restore a spectral cube, and write it with its colours."""

from __future__ import annotations

import math
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
from labapp.spectral.refinement import parameter_rows, parameters_as_data
from labapp.spectral.request import SpectralRequest
from labapp.spectral.restoration import RestoredCube, restore_snapshot
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
        drawn = draw_snapshot(restored, viewing)
        colours = encode_colours(files.colours, restored.cube, viewing)
        progress.report(1, "writing")
    notes = [*problem.notes, *([restored.doubts] if restored.doubts else [])]
    cubes = write_cube(files.cube, restored.cube)
    write_atomically(files.colours, colours)
    write_atomically(files.picture, drawn)
    if as_json:
        print_json(_as_data(restored, prior, notes, files))
        return
    print_table(problem.source, ["", "value"], _rows(restored))
    if restored.scores is not None:
        scored = zip(problem.wavelengths, restored.scores.bands, strict=True)
        bands = [(format_nanometres(at), f"{one.psnr:.2f}", f"{one.ssim:.3f}")
                 for at, one in scored]  # fmt: skip
        print_table("Bands", ["band ", "PSNR dB ", "SSIM "], bands)
    if restored.calibration is not None and prior is not None:
        parameters = parameter_rows(restored.calibration, prior, problem.wavelengths)
        heads = ["what", "found ", "", "before "]
        print_table("Camera, refined from the photograph", heads, parameters)
        print_message(f"before: {prior.source}")
        for line in restored.calibration.indeterminate:
            print_message(f"indeterminate: {line}")
    for note in notes:
        print_message(f"note: {note}")
    for file in (*cubes, files.colours, files.picture):
        out.print(f"wrote {file}", soft_wrap=True)


def _rows(restored: RestoredCube) -> list[list[str]]:
    """Return the printed rows on bands, PSFs, white, noise and scores."""
    problem, image = restored.problem, restored.image
    masked = float((problem.clipped | problem.dead_pixels).mean())
    stated = "as given" if problem.noise is not None else "estimated"
    rows = [
        ["bands", list_nanometres(problem.wavelengths)],
        ["PSFs", problem.psf_source],
        ["white", problem.response.source],
        ["method", image.method],
        ["noise", f"{image.noise:.3g} electrons per second, {stated}"],
        ["weight", "none" if image.weight is None else f"{image.weight:.3g}"],
        ["iterations", str(image.iterations)],
        ["clipped or dead pixels", f"{masked:.2%}, left out".replace("%", " %")],
        ["residual over noise", f"{image.residual:.2f}"],
        ["verdict", str(restored.verdict)],
        ["processor time", f"{restored.cpu_seconds:.2f} s"],
    ]
    if (scores := restored.scores) is not None:
        angle = "no pixel of the true cube is bright enough"
        if math.isfinite(scores.angle):
            angle = f"{scores.angle:.1f}°, mean of the pixels that aren't dark"
        difference = (
            f"{scores.difference:.1f} mean, {scores.largest_difference:.1f} at 95 % of the pixels, "
            f"in {scores.light}, by {scores.interpolation}"
        )
        rows += [
            ["PSNR", f"{scores.psnr:.2f} dB, mean of the bands ({scores.crop}, peak 1)"],
            ["SSIM", f"{scores.ssim:.3f}, mean of the bands (range 1)"],
            ["spectral angle", angle],
            ["CIEDE2000", difference],
            ["against", problem.truth_source or "the cube of --truth"],
        ]
    return rows


def _as_data(
    restored: RestoredCube,
    prior: SnapshotCalibration | None,
    notes: list[str],
    files: SpectralFiles,
) -> dict[str, Any]:
    """Return the results for JSON, with the camera that was refined from `prior`."""
    problem, image, found = restored.problem, restored.image, restored.calibration
    refined = None
    if found is not None and prior is not None:
        refined = parameters_as_data(found, prior, problem.wavelengths)
    against = problem.truth_source or "--truth"
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
        "score": restored.scores and restored.scores.as_data | {"against": against},
        "notes": notes,
        "file": str(files.cube),
        "colours": str(files.colours),
        "picture": str(files.picture),
        "refined": refined,
    }
