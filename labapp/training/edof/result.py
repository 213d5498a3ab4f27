"""Write a trained pattern with its decoder, and print what was reached."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from labapp.common.console import out, print_table
from labapp.common.figure_png import figure_to_png
from labapp.edof.design_problem import EdofProblem
from labapp.edof.trained_pattern import decoder_contents
from labapp.files.bench_file import BenchFile
from labapp.files.design_file import DesignContents, Grid, write_design
from labapp.files.writing import encode_image, write_atomically
from labapp.training.edof.captures import SceneSampler
from labapp.training.edof.config import EdofTrainingConfig
from labapp.training.edof.decoder_task import DecoderTask
from labapp.training.manifest import DataManifest
from labapp.training.task import VALIDATION_STEP
from optics.edof.learned import DecoderNetwork
from optics.edof.picture_spectrum import SpectrumModel
from optics.psf import PSFOperator
from optics.slm import phase_to_grey

_SCENES, _DRAWN = 3, 24
"""Scenes that are shown, and validation scenes from which they are taken. Chosen."""

_TITLES = ("captured", "filtered", "decoded", "scene")


@dataclass(frozen=True, eq=False)
class ShownScene:
    """A validation scene in the picture of the result.

    caption: number of layers, noise and PSNR.
    pictures: as captured, as filtered, as decoded, and as it is, each (side, side); in the scale of
    the comparison.
    """

    caption: str
    pictures: tuple[NDArray[np.float32], ...]


@torch.no_grad()
def choose_scenes(task: DecoderTask, sampler: SceneSampler) -> list[ShownScene]:
    """Decode a few validation scenes, planes and layered ones."""
    drawn = sampler.draw(VALIDATION_STEP, range(_DRAWN), "validation")
    planes = [one for one in drawn if len(one.depths) == 1]
    layered = [one for one in drawn if len(one.depths) > 1]
    chosen = [*layered[:1], *planes[: _SCENES - len(layered[:1])], *layered[1:]][:_SCENES]
    found = []
    for one in chosen:
        pictures = task.decode_scene(one)
        error = float((pictures[2] - pictures[3]).square().mean())
        layers = len(one.depths)
        kind = "one depth" if layers == 1 else f"{layers} layers"
        caption = f"{kind}, noise {one.noise:.3f}: {-10 * np.log10(error + 1e-10):.1f} dB"
        found.append(ShownScene(caption, tuple(each.cpu().numpy() for each in pictures)))
    return found


def draw_training(
    title: str,
    grey: NDArray[np.uint8],
    histories: Mapping[str, Sequence[Sequence[float]]],
    scenes: list[ShownScene],
) -> bytes:
    """Draw a pattern, its validation scores and decoded scenes as PNG.

    histories: step and score in dB of each validation, by the stage of the training.
    """
    figure = Figure(figsize=(13.5, 3.1 + 3.3 * len(scenes)), dpi=100, layout="constrained")
    figure.suptitle(title, fontsize=12)
    grid = figure.add_gridspec(1 + len(scenes), 4)
    pattern = figure.add_subplot(grid[0, :2])
    pattern.imshow(grey, cmap="gray", vmin=0, vmax=255)
    _label(pattern, "pattern, grey levels")
    axes = figure.add_subplot(grid[0, 2:])
    for name, history in histories.items():
        if history:
            steps, scores = zip(*history, strict=True)
            axes.plot(steps, scores, marker="o", label=name)
    axes.set(xlabel="step of the stage", ylabel="validation, dB")
    axes.grid(alpha=0.3)
    axes.legend()
    for row, scene in enumerate(scenes, 1):
        for column, (name, picture) in enumerate(zip(_TITLES, scene.pictures, strict=True)):
            axes = figure.add_subplot(grid[row, column])
            axes.imshow(picture, cmap="gray", vmin=0, vmax=1)
            _label(axes, scene.caption if name == "decoded" else name)
    return figure_to_png(figure)


def _label(axes: Axes, title: str) -> None:
    axes.set_title(title, fontsize=10)
    axes.set(xticks=[], yticks=[])


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
        psf=_compute_psfs(result),
        target=None,
        quality={"validation": result.validation},
        decoder=decoder_contents(
            result.network, result.spectrum, result.config.as_data(), result.account
        ),
    )
    write_design(design, contents)
    write_atomically(pattern, encode_image(pattern, grey))
    far, near = result.problem.depth_range
    network, account = result.network, result.account
    title = (
        f"Extended depth of field, {far:g} to {near:g} D, {result.config.wavelength_nm:g} nm: "
        f"{network.settings.knowledge}, {network.weight_count:,} weights, {result.validation:.2f} "
        "dB in validation"
    )
    histories = {"decoder": account["history"], "joint": account.get("joint_history", [])}
    write_atomically(picture, draw_training(title, grey, histories, scenes))
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


def _compute_psfs(result: TrainedResult) -> Grid:
    """Compute PSFs of the pattern at some depths, for its file."""
    camera, wavelength = result.problem.camera, result.config.wavelength
    side = min(_SHOWN_PIXELS, *camera.sensor.shape)
    pixels = camera.sensor.window_plane((side, side))
    found = []
    for one in np.linspace(*result.problem.depth_range, _SHOWN_DEPTHS):
        distance = 1 / one if one > 0 else math.inf
        operator = PSFOperator(camera, distance, wavelength, pixels, calls=1, tol=1e-2)
        found.append(operator(result.phase).to(torch.float32))
    return Grid.from_tensor(torch.stack(found), pixels)
