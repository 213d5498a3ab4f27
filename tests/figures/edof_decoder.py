"""The bundled pattern with its decoder, judged on photographs that nothing was trained on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch

from figures import Figure
from figures.edof_protocol import CAMERA, DATA, JUDGED, SCENE_SIDE, read_photograph, unsplash
from labapp.edof.trained_pattern import TrainedPattern, bundled_trained_pattern
from labapp.training.scenes import draw_matte
from optics.edof.decoders import blind_wiener, decoding_transfers
from optics.edof.evaluation import add_noise, evaluate_patterns
from optics.edof.layered_capture import composite_layers, flatten_layers
from optics.edof.learned import learned_decoder
from optics.edof.protocol import HIGH_NOISE, STRICT, EdofProtocol, prepare_scene
from optics.edof.protocol_psfs import PupilPattern, compute_depth_psfs
from optics.edof.scoring import EvaluationTable, ScoreRow
from optics.metrics import psnr
from optics.threads import single_threaded

_GOAL, _SSIM_GOAL = 23.0, 0.61
_LAYERS_GOAL = 2.0
"""Goals: dB and SSIM of the strict protocol, and dB that layers may lose against planes."""

_PAIRS = ((1.33, 0.5), (2.0, 0.02), (1.0, 0.2), (1.6, 1.25))
"""Dioptres of the nearer and the farther of two layers. The first two are those of an independent
study; none is a depth of the published grid alone."""

_NOISE = 0.008
"""Standard deviation of the noise of layered scenes, where white is 1."""

_BYTES = 4e6
"""Most bytes of the bundled file."""


@single_threaded
def edof_decoder_figures(folder: Path) -> list[Figure]:
    """The strict protocol, a true border, and scenes of two layers, with the bundled decoder."""
    if not (DATA / "kodak").is_dir():
        why = "not measured: the photographs aren't beside the checkout"
        return [Figure("bundled decoder of an extended depth of field", "see the goals", why, None)]
    return [
        _size_figure(),
        *strict_figures(JUDGED),
        _all_kodak_figure(),
        *_border_figures(),
        *layer_figures(JUDGED),
    ]


def _size_figure() -> Figure:
    """The file that comes with the application."""
    trained = bundled_trained_pattern()
    size = trained.path.stat().st_size
    weights = trained.network.weight_count
    account = trained.account
    return Figure(
        "bundled pattern with decoder",
        f"≤ {_BYTES / 1e6:g} MB",
        f"{size / 1e6:.2f} MB, {weights} weights, {account['decoder_steps']} steps of the decoder "
        f"and {account['joint_steps']} joint ones, {account['cpu_seconds'] / 60:.0f} CPU-minutes",
        size <= _BYTES,
    )


def strict_figures(names: Sequence[str]) -> list[Figure]:
    """The strict protocol with periodic scenes, blind, low and high noise."""
    pictures = [read_photograph(DATA / f"kodak/kodim{name}.png") for name in names]
    low = _rows(evaluate_trained(bundled_trained_pattern(), pictures, STRICT))
    high = _rows(
        evaluate_trained(bundled_trained_pattern(), pictures, STRICT.with_noise(HIGH_NOISE))
    )
    scores, filtered = low["learned"].scores, low["blind Wiener"].scores
    similar = float(scores.ssim[:, : scores.on_grid_count].mean())
    alarms = [alarm.message for alarm in low["learned"].alarms]
    return [
        Figure(
            "bundled decoder, blind, strict protocol, ten distances, low noise",
            f"≥ {_GOAL:g} dB, SSIM ≥ {_SSIM_GOAL:g}, no alarm",
            f"{scores.on_grid:.2f} dB, SSIM {similar:.3f}, worst distance "
            f"{min(scores.psnr_by_depth[: scores.on_grid_count]):.2f} dB, {len(names)} photographs"
            + "".join(f"; {one}" for one in alarms),
            scores.on_grid >= _GOAL and similar >= _SSIM_GOAL and not alarms,
        ),
        Figure(
            "the same, over its filter alone; at forty random depths",
            "better; ≤ 0.2 dB below",
            f"+{scores.on_grid - filtered.on_grid:.2f} dB over {filtered.on_grid:.2f} dB; "
            f"{scores.off_grid:.2f} dB",
            scores.on_grid > filtered.on_grid and scores.on_grid - scores.off_grid <= 0.2,
        ),
        Figure(
            "the same, high noise, for which it wasn't trained",
            "better than its filter alone",
            f"{high['learned'].scores.on_grid:.2f} dB over "
            f"{high['blind Wiener'].scores.on_grid:.2f} dB",
            high["learned"].scores.on_grid > high["blind Wiener"].scores.on_grid,
        ),
    ]


def _all_kodak_figure() -> Figure:
    """Every photograph of the set, as the choice of eight decides the SSIM."""
    every = [read_photograph(one) for one in sorted((DATA / "kodak").glob("*.png"))]
    pictures = [one for one in every if min(one.shape[:2]) >= STRICT.crop]
    few = replace(STRICT, off_grid_count=1)
    scores = _rows(evaluate_trained(bundled_trained_pattern(), pictures, few))["learned"].scores
    similar = float(scores.ssim[:, : scores.on_grid_count].mean())
    return Figure(
        "the same on all photographs of the set that are large enough",
        f"≥ {_GOAL:g} dB, SSIM ≥ {_SSIM_GOAL:g}",
        f"{scores.on_grid:.2f} dB, SSIM {similar:.3f}, {len(pictures)} photographs",
        scores.on_grid >= _GOAL and similar >= _SSIM_GOAL,
    )


def _border_figures() -> list[Figure]:
    """The same scenes with what lies beyond the frame, and as if they were periodic."""
    pictures, resized = unsplash(slice(3, 6)), replace(STRICT, shortest_edge=SCENE_SIDE)
    true, periodic = (
        evaluate_trained(bundled_trained_pattern(), pictures, resized.with_border(border))
        for border in ("true", "periodic")
    )
    figures = []
    for part, goal in (("frame", 1.3), ("centre", 0.3)):
        found = [_rows(one, part)["learned"].scores.mean for one in (periodic, true)]
        figures.append(
            Figure(
                f"bundled decoder, loss by an unknown border over a periodic one, {part}",
                f"≤ {goal:g} dB",
                f"{found[0] - found[1]:.2f} dB, {found[1]:.2f} of {found[0]:.2f} dB, "
                f"{len(pictures)} photographs",
                found[0] - found[1] <= goal,
            )
        )
    return figures


def layer_figures(names: Sequence[str]) -> list[Figure]:
    """Two layers, of which the nearer hides part of the farther, against the same depths apart."""
    trained = bundled_trained_pattern()
    pictures = [
        prepare_scene(read_photograph(DATA / f"kodak/kodim{name}.png"), STRICT.crop, "srgb", None)
        for name in names
    ]
    dioptres = [one for pair in _PAIRS for one in pair]
    psfs = compute_depth_psfs(PupilPattern("bundled", trained.phase), dioptres, CAMERA, STRICT)
    transfers = decoding_transfers(psfs, STRICT)
    design = compute_depth_psfs(
        PupilPattern("bundled", trained.phase), STRICT.design_dioptres, CAMERA, STRICT
    )
    restore = learned_decoder(trained.network, trained.spectrum_on_grid).build(
        decoding_transfers(design, STRICT), _NOISE
    )
    losses = []
    for number, pair in enumerate(_PAIRS):
        chosen = transfers[2 * number : 2 * number + 2]
        layered, plane = [], []
        for place in range(len(pictures)):
            two = torch.stack([pictures[place], pictures[(place + 1) % len(pictures)]])
            seed = number * 1000 + place
            layered.append(_score_layers(restore, two, chosen, seed))
            planes = [
                _score_layers(restore, two[k : k + 1], chosen[k : k + 1], seed) for k in (0, 1)
            ]
            plane.append(float(np.mean(planes)))
        losses.append((pair, float(np.mean(plane)), float(np.mean(layered))))
    mean = float(np.mean([one - two for _, one, two in losses]))
    each = ", ".join(
        f"{near:g} and {far:g} D {two:.2f} of {one:.2f} dB" for (near, far), one, two in losses
    )
    return [
        Figure(
            "bundled decoder, two layers against planes at the same depths, four pairs",
            f"≤ {_LAYERS_GOAL:g} dB lost",
            f"{mean:.2f} dB: {each}",
            mean <= _LAYERS_GOAL,
        )
    ]


def _score_layers(
    restore: object, pictures: torch.Tensor, transfers: torch.Tensor, seed: int
) -> float:
    """The PSNR of a decoded scene; of one picture, that of a plane."""
    generator = np.random.default_rng(seed)
    mattes = torch.ones_like(pictures)
    for matte in mattes[:-1]:
        matte.copy_(torch.from_numpy(draw_matte(generator, pictures.shape[-1])))
    image = composite_layers(pictures, mattes, transfers)
    capture = add_noise(image, _NOISE, 1.0, torch.Generator().manual_seed(seed))
    assert callable(restore)
    return psnr(restore(capture), flatten_layers(pictures, mattes), 1.0)


def evaluate_trained(
    trained: TrainedPattern, pictures: Sequence[torch.Tensor], protocol: EdofProtocol
) -> EvaluationTable:
    """A trained pattern with its decoder, and with its filter alone."""
    decoders = [
        blind_wiener(trained.spectrum_on_grid),
        learned_decoder(trained.network, trained.spectrum_on_grid),
    ]
    shown = PupilPattern("trained", trained.phase)
    return evaluate_patterns([shown], pictures, CAMERA, protocol, decoders)


def _rows(table: EvaluationTable, part: str = "frame", scale: str = "srgb") -> dict[str, ScoreRow]:
    """The trained pattern's rows by the decoder's name."""
    return {
        one.decoder: one
        for one in table.rows
        if one.pattern == "trained" and one.part == part and one.scored_in == scale
    }


MEASUREMENTS = {"edof-decoder": edof_decoder_figures}
