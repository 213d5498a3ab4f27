"""Write a trained pattern with its decoder, and print what was reached."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch

from labapp.common.console import out, print_table
from labapp.edof.design_problem import EdofProblem
from labapp.edof.trained_pattern import decoder_contents
from labapp.files.bench_file import BenchFile
from labapp.files.design_file import DesignContents, Grid, write_design
from labapp.files.writing import encode_image, write_atomically
from labapp.training.edof.config import EdofTrainingConfig
from labapp.training.edof.drawing import ShownScene, draw_training
from labapp.training.manifest import DataManifest
from optics.camera import Camera
from optics.edof.learned import DecoderNetwork
from optics.edof.picture_spectrum import SpectrumModel
from optics.psf import PSFOperator
from optics.slm import phase_to_grey

_SHOWN_DEPTHS, _SHOWN_PIXELS = 3, 129
"""Depths and pixels along a side of the PSFs in the file. Chosen, so that it stays small."""


@dataclass(frozen=True, eq=False)
class TrainedResult:
    """A pattern and its decoder at the end of their training.

    problem: the optics in training.
    spectrum: power spectrum of the pictures.
    phase: the pattern, (rows, columns), radians.
    manifest: the list of the photographs; None without.
    account: steps, scores and data of the training, as plain data.
    """

    config: EdofTrainingConfig
    bench: BenchFile
    problem: EdofProblem
    spectrum: SpectrumModel
    phase: torch.Tensor
    network: DecoderNetwork
    manifest: DataManifest | None
    account: Mapping[str, Any]

    @property
    def validation(self) -> float:
        """The validation score of pattern and decoder, dB."""
        if self.account.get("joint_accepted"):
            return float(self.account["joint_validation"][1])
        return float(self.account["decoder_validation"])


def write_result(result: TrainedResult, scenes: list[ShownScene], files: Sequence[Path]) -> None:
    """Write the design file, the pattern, its picture and the list of the data.

    Raises UserError if a file can't be written.
    scenes: those that the picture shows.
    files: in the order of the first line.
    """
    camera, wavelength = result.problem.camera, result.config.wavelength
    design, pattern, picture, listed = files
    grey = phase_to_grey(camera.panel, result.phase, wavelength, 1).numpy()
    contents = DesignContents(
        title="extended depth of field, with decoder",
        settings={"design": "edof", **result.problem.request.as_data()},
        bench=result.bench.model_dump(mode="json"),
        wavelength=wavelength,
        grey=grey[None],
        phase=None,
        orders=1,
        frame_time=0.0,
        pixel_pitch=camera.panel.pitch,
        psf=_compute_psfs(result, camera, wavelength),
        target=None,
        quality={"validation": result.validation},
        decoder=decoder_contents(
            result.network, result.spectrum, result.config.as_data(), result.account
        ),
    )
    write_design(design, contents)
    write_atomically(pattern, encode_image(pattern, grey))
    write_atomically(picture, draw_training(_title(result), grey, _histories(result), scenes))
    if result.manifest is not None:
        result.manifest.write(listed)


def print_result(result: TrainedResult, files: Sequence[Path]) -> None:
    """Print what pattern and decoder reached, and which files were written."""
    account, decoder = result.account, result.network.settings
    rows = [
        ["decoder", f"{decoder.knowledge}, {result.network.weight_count:,} weights"],
        ["decoder alone", f"{account['decoder_validation']:.2f} dB in validation"],
    ]
    if account["joint_steps"]:
        first, last = account["joint_validation"]
        kept = "kept" if account["joint_accepted"] else "not kept, as it is no better"
        rows.append(["trained jointly", f"{first:.2f} to {last:.2f} dB, {kept}"])
    rows.append(["processor time", f"{account['cpu_seconds'] / 60:.1f} min"])
    print_table("Pattern with decoder", ["", ""], rows)
    for note in [] if result.manifest is None else result.manifest.notes():
        out.print(f"note: {note}")
    for one in files if result.manifest is not None else files[:3]:
        out.print(f"wrote {one}", soft_wrap=True)


def _title(result: TrainedResult) -> str:
    """Return the picture's title."""
    far, near = result.problem.depth_range
    network = result.network
    return (
        f"Extended depth of field, {far:g} to {near:g} D, {result.config.wavelength_nm:g} nm: "
        f"{network.settings.knowledge}, {network.weight_count:,} weights, {result.validation:.2f} "
        "dB in validation"
    )


def _histories(result: TrainedResult) -> dict[str, list[tuple[int, float]]]:
    """Return step and validation score by stage."""
    kept = {"decoder": result.account["history"], "joint": result.account.get("joint_history", [])}
    return {name: [(int(a), float(b)) for a, b in one] for name, one in kept.items()}


def _compute_psfs(result: TrainedResult, camera: Camera, wavelength: float) -> Grid:
    """Compute PSFs of the pattern at some depths, for its file."""
    side = min(_SHOWN_PIXELS, *camera.sensor.shape)
    pixels = camera.sensor.window_plane((side, side))
    found = []
    for one in np.linspace(*result.problem.depth_range, _SHOWN_DEPTHS):
        distance = 1 / one if one > 0 else math.inf
        operator = PSFOperator(camera, distance, wavelength, pixels, calls=1, tol=1e-2)
        found.append(operator(result.phase).to(torch.float32))
    return Grid.from_tensor(torch.stack(found), pixels)
