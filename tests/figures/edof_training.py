"""Trainings of patterns with decoders by the packaged command, beside each other."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import skimage

from figures import TOLD, Figure
from figures.edof_decoder import evaluate_trained
from figures.edof_protocol import DATA, JUDGED, read_photograph, unsplash
from labapp.edof.trained_pattern import TrainedPattern, read_trained_pattern
from labapp.files.output_paths import trained_output_paths
from labapp.training.edof.command import TrainingRequest, train_edof
from labapp.training.edof.config import EdofTrainingConfig
from optics.edof.protocol import AUTHORS, STRICT, EdofProtocol
from optics.edof.scoring import CaptureScores
from optics.threads import single_threaded

_SKIMAGE = ("astronaut.png", "chelsea.png", "coffee.png", "motorcycle_left.png", "rocket.jpg")
"""Photographs that come with scikit-image, beside the first three of Unsplash."""

_NOT_MEASURED = Figure(
    "training for an extended depth of field",
    "see the goals",
    "not measured: the photographs aren't beside the checkout",
    None,
)

_AUTHORS: Mapping[str, Any] = {
    "scenes": {"light": "linear", "binning": 5, "shortest_edges": [1400.0, 2300.0]},
    "pattern": {"design_steps": 600},
    "decoder": {"levels": 3},
    "capture": {"unmodulated": [0.0, 0.0]},
    "training": {"samples": 4},
    "joint": {"share": 0.0},
}
"""Pixels five times larger, photographs of about 2048 pixels in linear light."""

_STRICT: Mapping[str, Any] = {
    "scenes": {"spectrum": "natural", "shortest_edges": [400.0, 1500.0]},
    "capture": {"unmodulated": [0.0, 0.0]},
}
"""The strict protocol's scenes and panel."""

_AUTHORS_STEPS = 3500
"""Steps of the decoder that fit, with the pattern's design, into five minutes of one core."""

_STRICT_STEPS = 2400
"""Steps of each of the trainings that are compared."""

_JOINT: Mapping[str, Any] = {"share": 0.1, "samples": 8, "pattern_rate": 0.005}
"""The bundled pattern's joint stage. Longer and faster ones do better in validation, on parts of
the training's few photographs, and worse on other photographs."""

_AUTHORS_GOAL, _AUTHORS_SSIM, _MINUTES = 26.5, 0.62, 5.0
_WORST_GOAL = 2.0
_GAIN_GOAL = 0.7


@single_threaded
def edof_five_minutes_figures(folder: Path) -> list[Figure]:
    """The published simulation's protocol after five minutes of training."""
    return [_authors_figure(folder)] if (DATA / "unsplash").is_dir() else [_NOT_MEASURED]


@single_threaded
def edof_joint_figures(folder: Path) -> list[Figure]:
    """Pattern and decoder trained jointly against the decoder alone, and hand-made patterns."""
    return _compared_figures(folder) if (DATA / "unsplash").is_dir() else [_NOT_MEASURED]


def _authors_figure(folder: Path) -> Figure:
    """The published simulation's protocol, blind, all ten distances, scored in sRGB."""
    started = time.process_time()
    trained = train_pattern(folder, "authors", _AUTHORS, _AUTHORS_STEPS)
    minutes = (time.process_time() - started) / 60
    few = replace(AUTHORS, off_grid_count=10)
    table = evaluate_trained(trained, unsplash(slice(3, 6)), few)
    rows = {
        (one.decoder, one.scored_in): one.scores
        for one in table.rows
        if one.pattern == "trained" and one.part == "frame"
    }
    scores = rows["learned", "srgb"]
    grid = scores.psnr_by_depth[: scores.on_grid_count]
    similar = float(scores.ssim[:, : scores.on_grid_count].mean())
    return Figure(
        "published simulation's protocol, blind, all ten distances, pattern and decoder trained "
        "in five minutes",
        f"≥ {_AUTHORS_GOAL:g} dB, SSIM ≥ {_AUTHORS_SSIM:g} in sRGB; worst distance at most "
        f"{_WORST_GOAL:g} dB below; ≤ {_MINUTES:g} CPU-minutes",
        f"{scores.on_grid:.2f} dB, SSIM {similar:.3f}, worst {min(grid):.2f} dB, off the grid "
        f"{scores.off_grid:.2f} dB; linear light {rows['learned', 'linear'].on_grid:.2f} dB; "
        f"filter alone {rows['blind Wiener', 'srgb'].on_grid:.2f} dB; {minutes:.1f} CPU-minutes",
        scores.on_grid >= _AUTHORS_GOAL
        and similar >= _AUTHORS_SSIM
        and scores.on_grid - min(grid) <= _WORST_GOAL
        and minutes <= _MINUTES,
    )


def _compared_figures(folder: Path) -> list[Figure]:
    """Joint training against the decoder alone, and against the best hand-made patterns."""
    pictures = [read_photograph(DATA / f"kodak/kodim{name}.png") for name in JUDGED]
    few = replace(STRICT, off_grid_count=10)
    cases = {
        "jointly": {"joint": _JOINT},
        "alone": {"joint": {**_JOINT, "pattern_rate": 0.0}},
        "in one stage": {"joint": {"share": 0.0}},
        **{
            name: {"pattern": {"start": name, "design_steps": 0}, "joint": {"share": 0.0}}
            for name in ("rings", "sweep")
        },
    }
    found = {
        name: _learned_scores(
            train_pattern(folder, name, {**_STRICT, **changes}, _STRICT_STEPS), pictures, few
        )
        for name, changes in cases.items()
    }
    gain, beyond = (
        found["jointly"].on_grid - found[name].on_grid for name in ("alone", "in one stage")
    )
    best = max(("rings", "sweep"), key=lambda name: found[name].on_grid)
    over = found["jointly"].on_grid - found[best].on_grid
    beside = found["jointly"].off_grid - found[best].off_grid
    return [
        Figure(
            f"joint training over the decoder alone, {_STRICT_STEPS} steps each in the same stages",
            "≥ 0 dB",
            f"{gain:+.2f} dB, {found['jointly'].on_grid:.2f} over {found['alone'].on_grid:.2f} dB; "
            f"off the grid {found['jointly'].off_grid - found['alone'].off_grid:+.2f} dB",
            gain >= 0,
        ),
        Figure(
            "the same over a decoder that is trained in one stage",
            TOLD,
            f"{beyond:+.2f} dB, {found['jointly'].on_grid:.2f} over "
            f"{found['in one stage'].on_grid:.2f} dB",
            None,
        ),
        Figure(
            "the same over the best hand-made pattern with a decoder of its own, as many steps",
            f"≥ +{_GAIN_GOAL:g} dB",
            f"{over:+.2f} dB over {best}, {found[best].on_grid:.2f} dB; off the grid {beside:+.2f} "
            f"dB; rings {found['rings'].on_grid:.2f}, sweep {found['sweep'].on_grid:.2f} dB",
            over >= _GAIN_GOAL,
        ),
    ]


def _learned_scores(
    trained: TrainedPattern, pictures: list[Any], protocol: EdofProtocol
) -> CaptureScores:
    """The scores of a trained pattern with its decoder in sRGB, the whole frame."""
    table = evaluate_trained(trained, pictures, protocol)
    return table.find("trained", "learned").scores


def training_photographs() -> list[Path]:
    """Photographs that nothing is judged on: three large ones, and five of about 500 pixels."""
    own = [Path(skimage.__file__).parent / "data" / one for one in _SKIMAGE]
    return [*sorted((DATA / "unsplash").glob("*.jpg"))[:3], *own]


def train_pattern(
    folder: Path,
    name: str,
    config: Mapping[str, Any],
    steps: int,
    device: str = "cpu",
    photographs: Sequence[Path] | None = None,
) -> TrainedPattern:
    """Train by the packaged command's own function.

    photographs: those of `training_photographs` by default.
    """
    pictures = folder / "photographs"
    if not pictures.is_dir():
        pictures.mkdir()
        for one in training_photographs() if photographs is None else photographs:
            (pictures / one.name).symlink_to(one)
    out = folder / f"{name}.h5"
    request = TrainingRequest(
        EdofTrainingConfig.model_validate(dict(config)),
        folder,
        [pictures],
        [],
        steps,
        None,
        device,
    )
    train_edof(request, trained_output_paths(out, force=True))
    return read_trained_pattern(out)


MEASUREMENTS = {
    "edof-five-minutes": edof_five_minutes_figures,
    "edof-joint": edof_joint_figures,
}
