"""The published training of a pattern with its decoder, as far as a GPU gets in some minutes."""

from __future__ import annotations

import re
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import torch

from figures import TOLD, Figure
from figures.edof_decoder import evaluate_trained
from figures.edof_protocol import DATA, unsplash
from figures.edof_training import train_pattern, training_photographs
from optics.edof.protocol import AUTHORS

_GUIDE = Path(__file__).parents[2] / "labapp/docs/depth-of-field.md"

_STEPS = 2000
"""Steps in all: some minutes of a fast GPU. The published program made 80,000 at least."""


def edof_published_figures(folder: Path) -> list[Figure]:
    """The configuration that the guide shows, trained, and scored by the published protocol."""
    if not (DATA / "unsplash").is_dir():
        return [_explain_absence("the photographs aren't beside the checkout")]
    if not torch.cuda.is_available():
        return [_explain_absence("there is no GPU")]
    # Its scenes are larger than the other photographs.
    large = training_photographs()[:3]
    trained = train_pattern(folder, "published", read_published_config(), _STEPS, "cuda", large)
    few = replace(AUTHORS, off_grid_count=1)
    table = evaluate_trained(trained, unsplash(slice(3, 6)), few)
    scores = table.find("trained", "learned", "srgb").scores
    levels = scores.psnr_by_depth[: scores.on_grid_count]
    # The nearest distance is the first one.
    farther = sum(levels[1:]) / len(levels[1:])
    account = trained.account
    return [
        Figure(
            _TITLE,
            TOLD,
            f"{scores.on_grid:.2f} dB in sRGB, {farther:.2f} dB without the nearest, after "
            f"{account['decoder_steps']} steps of the decoder and {account['joint_steps']} joint "
            f"ones; {trained.network.weight_count} weights",
            None,
        )
    ]


_TITLE = (
    "published procedure, decoder told the PSF, flat start, joint; published simulation's "
    "protocol, ten distances"
)


def _explain_absence(why: str) -> Figure:
    return Figure(_TITLE, TOLD, f"not measured: {why}", None)


def read_published_config() -> dict[str, Any]:
    """The configuration of the published procedure, from the guide's page."""
    (block,) = re.findall(r"```toml\n(# published\.toml\n.*?)```", _GUIDE.read_text(), re.DOTALL)
    return tomllib.loads(block)


MEASUREMENTS = {"edof-published": edof_published_figures}
