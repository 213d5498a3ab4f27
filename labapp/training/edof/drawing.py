"""Draw what a pattern with its decoder reached: pattern, validation scores and decoded scenes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from labapp.common.figure_png import figure_to_png
from labapp.training.edof.captures import SceneSampler
from labapp.training.edof.decoder_task import DecoderTask
from labapp.training.task import VALIDATION_STEP

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
    histories: dict[str, list[tuple[int, float]]],
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
    _draw_histories(figure.add_subplot(grid[0, 2:]), histories)
    for row, scene in enumerate(scenes, 1):
        for column, (name, picture) in enumerate(zip(_TITLES, scene.pictures, strict=True)):
            axes = figure.add_subplot(grid[row, column])
            axes.imshow(picture, cmap="gray", vmin=0, vmax=1)
            _label(axes, scene.caption if name == "decoded" else name)
    return figure_to_png(figure)


def _draw_histories(axes: Axes, histories: dict[str, list[tuple[int, float]]]) -> None:
    """Draw the validation scores of each stage over its steps."""
    for name, history in histories.items():
        if history:
            steps, scores = zip(*history, strict=True)
            axes.plot(steps, scores, marker="o", label=name)
    axes.set(xlabel="step of the stage", ylabel="validation, dB")
    axes.grid(alpha=0.3)
    axes.legend()


def _label(axes: Axes, title: str) -> None:
    axes.set_title(title, fontsize=10)
    axes.set(xticks=[], yticks=[])
