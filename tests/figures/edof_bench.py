"""The bundled pattern for depth of field on the virtual bench: its PSFs, and what faults cost.

The PSFs are the mean pictures of points on the virtual bench, without the camera's noise. Captures
are then computed by the strict protocol, with its noise, from the PSFs of a changed bench, and
decoded by the bundled decoder, which knows the bench as it should be. All benches see the same
photographs and the same noise, so that a loss is known better than a score.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from figures import TOLD, Figure
from figures.edof_apart import separation_figures
from figures.edof_judge import PSFJudge
from figures.edof_protocol import CAMERA, DATA, JUDGED, design, read_photograph
from labapp.edof.trained_pattern import TrainedPattern, bundled_trained_pattern
from labapp.files.true_bench_table import TrueBenchTable
from labapp.pictures.analysis.star_psf import predict_star
from labapp.studies.edof_psfs import fit_shift, move_picture
from optics.camera import Camera
from optics.edof.evaluation import prepare_scenes
from optics.edof.learned import learned_decoder
from optics.edof.protocol import STRICT, EdofProtocol
from optics.edof.protocol_psfs import (
    CameraPSFs,
    DepthPSFs,
    PupilPattern,
    compute_depth_psfs,
    measured_depth_psfs,
)
from optics.slm import grey_to_phase, phase_to_grey
from optics.threads import single_threaded
from simulator.scene import Scene, Star
from simulator.world import World

_WAVELENGTH = 520e-9

_UNMODULATED = 0.05
"""Share of the bench's light that no pattern modulates: section 5.6 of the thesis has 5 to 10 %."""

_COUPLING = 4.8e-6
"""Standard deviation by which fringing blurs the phase, metres: .6 of the panel's pixel."""

_PSF_GOAL, _PSF_SIDE = 0.03, 901
_LOSS_GOAL, _COUPLING_GOAL = 0.05, 0.25

_STAR = 3.4e-6
"""Metres across the image of a star, for the comparison of PSFs; of a point for all else."""

_POINT = 0.1e-6

_TOL = 2e-3
"""Relative error up to which the virtual bench leaves out effects. Chosen: a PSF that is wrong by
so much changes a score by less than a hundredth of a dB."""

_PROTOCOL = replace(STRICT, name="bench", pixel_response="area", off_grid_count=1)
"""The strict protocol on pixels that gather light on their area, with the ten distances, and one
more that it must have, which isn't told."""

_FORCED: Mapping[str, bool] = {
    "filter bandwidth": False,
    "vignetting": False,
    "panel orders": False,
}
"""Effects of the virtual bench that the computed PSFs don't have either."""

_FAULTS: Mapping[str, tuple[dict[str, Any], dict[str, bool]]] = {
    "flicker": (
        {"panel": {"flicker": 0.015, "jitter_rad": 2 * math.pi * 0.015 / math.sqrt(3)}},
        {"flicker": True, "jitter": True},
    ),
    "response": ({"panel": {"response": {"range": 0.95}}}, {"panel response": True}),
    "coupling": ({"panel": {"coupling_um": 1e6 * _COUPLING}}, {"neighbour coupling": True}),
    "shift of 2 pixels": ({"mount": {"shift_mm": [0.0, 0.016]}}, {}),
    "shift of 20 pixels": ({"mount": {"shift_mm": [0.0, 0.16]}}, {}),
}
"""Tables of [truth], and effects that are switched on. The flicker is that of thesis section 5.6,
as a ripple of the whole panel and for each pixel alone; the coupling is .6 of a pixel."""


@single_threaded
def edof_bench_figures(folder: Path) -> list[Figure]:
    """PSFs on the virtual bench, and the loss by the bench's faults and by a lens that is apart."""
    if not (DATA / "kodak").is_dir():
        why = "not measured: the photographs aren't beside the checkout"
        return [
            Figure("pattern for depth of field on the virtual bench", "see the goals", why, None)
        ]
    pictures = [read_photograph(DATA / f"kodak/kodim{name}.png") for name in JUDGED]
    trained = bundled_trained_pattern()
    return [
        psf_figure(trained.phase, _PROTOCOL.on_grid),
        *fault_figures(trained, pictures, _PROTOCOL),
        *separation_figures(design(STRICT), pictures),
    ]


def bench_camera(side: int) -> Camera:
    """The thesis' camera with unmodulated light, and a sensor of so many pixels a side."""
    panel = replace(CAMERA.panel, unmodulated=_UNMODULATED)
    return replace(CAMERA, panel=panel, sensor=replace(CAMERA.sensor, shape=(side, side)))


def bench_psfs(
    camera: Camera,
    grey: np.ndarray,
    dioptres: Sequence[float],
    star: float,
    truth: Mapping[str, Any],
    effects: Mapping[str, bool],
) -> np.ndarray:
    """Mean pictures of stars on the virtual bench, as shares of the first one's light: (n, y, x).

    star: metres across its image.
    """
    table = TrueBenchTable.model_validate(dict(truth))
    found = []
    for depth in dioptres:
        distance = 1 / depth
        size = star * distance / camera.lens.image_distance
        # The image is equally bright at all distances.
        world = World(
            table.true_camera(camera),
            Scene({"star": Star(size, distance, 1e12)}),
            mount=table.mount.build(),
            tol=_TOL,
            forced={**_FORCED, **effects},
        )
        world.wavelength, world.grey = _WAVELENGTH, grey
        found.append(world.electron_rates(10.0)[0].double().numpy())
    return np.stack(found)


def psf_figure(phase: torch.Tensor, dioptres: Sequence[float]) -> Figure:
    """PSFs of the virtual bench against those of the engine, at each depth."""
    camera = bench_camera(_PSF_SIDE)
    grey = phase_to_grey(camera.panel, phase, _WAVELENGTH)
    seen = bench_psfs(camera, grey.numpy(), dioptres, _STAR, {}, {})
    apart, moved = [], []
    for one, depth in zip(seen, dioptres, strict=True):
        distance = 1 / depth
        size = _STAR * distance / camera.lens.image_distance
        (known,) = predict_star(camera, [grey], _WAVELENGTH, size, distance, _PSF_SIDE)
        expected = known.double().numpy()
        shift = fit_shift(one, expected)
        expected = move_picture(expected, shift)
        # The light of the star is known from neither.
        scaled = expected * (one.sum() / expected.sum())
        apart.append(float(np.linalg.norm(one - scaled) / np.linalg.norm(scaled)))
        moved.append(max(map(abs, shift)))
    worst = int(np.argmax(apart))
    return Figure(
        "PSFs of the bundled pattern on the virtual bench and simulated ones, "
        f"± {_PSF_SIDE // 2} pixels, worst of {len(dioptres)} distances, without noise",
        f"≤ {_PSF_GOAL:.0%}",
        f"{apart[worst]:.2%} at {1 / dioptres[worst]:g} m, moved by {max(moved):.3f} pixels",
        max(apart) <= _PSF_GOAL,
    )


def fault_figures(
    trained: TrainedPattern, pictures: Sequence[torch.Tensor], protocol: EdofProtocol
) -> list[Figure]:
    """Loss of decoded captures by the faults of [truth], and by 8 bits of grey."""
    phase = trained.phase
    camera = bench_camera(protocol.psf_window)
    grey = phase_to_grey(camera.panel, phase, _WAVELENGTH)
    shown = PupilPattern("shown", grey_to_phase(camera.panel, grey, _WAVELENGTH))
    source = CameraPSFs(camera, protocol)
    wanted = compute_depth_psfs(shown, protocol.design_dioptres, camera, protocol, source)
    known = compute_depth_psfs(shown, protocol.test_dioptres, camera, protocol, source)
    decoder = learned_decoder(trained.network, trained.spectrum_on_grid)
    judge = PSFJudge(wanted, prepare_scenes(pictures, protocol), protocol, decoder)
    plain = bench_psfs(camera, grey.numpy(), protocol.test_dioptres, _POINT, {}, {})
    # The light of the star: what the engine says arrives in the window.
    light = plain.sum((1, 2)).mean() / float(known.kernels.sum((1, 2)).mean())

    def as_shares(psfs: np.ndarray) -> DepthPSFs:
        shares = torch.from_numpy(psfs / light)
        return measured_depth_psfs(shares, protocol.test_dioptres, 1.0, protocol)

    def levels(psfs: np.ndarray) -> np.ndarray:
        return judge.levels(as_shares(psfs))

    expected = levels(plain)
    found = [_grey_figure(phase, camera, judge, judge.levels(known))]
    for name, (truth, effects) in _FAULTS.items():
        psfs = bench_psfs(camera, grey.numpy(), protocol.test_dioptres, _POINT, truth, effects)
        matched = psfs * (plain.sum() / psfs.sum())
        if "mount" in truth:
            matched = _move_back(matched, truth, camera, protocol.test_dioptres)
        losses = expected - levels(psfs), expected - levels(matched)
        found.append(_loss_figure(name, *losses, expected))
        if name == "coupling":
            found.append(_retuned_figure(judge, as_shares(plain), as_shares(psfs)))
    return found


def _retuned_figure(judge: PSFJudge, plain: DepthPSFs, changed: DepthPSFs) -> Figure:
    """The loss that is left with a filter for the PSFs of the changed bench, as stars show them."""
    levels, others = (replace(judge, design=psfs).levels(psfs) for psfs in (plain, changed))
    losses = levels - others
    return Figure(
        "the same, with filters that are made for the PSFs of each bench at these depths",
        TOLD,
        f"{losses.mean():.3f} dB of {levels.mean():.2f}, worst distance {losses.max():.3f} dB",
        None,
    )


def _move_back(
    psfs: np.ndarray, truth: Mapping[str, Any], camera: Camera, dioptres: Sequence[float]
) -> np.ndarray:
    """PSFs of a shifted panel, each moved back by what a ray through its middle is moved by."""
    scale = 1e-3 * camera.lens.image_distance / camera.sensor.pitch
    away = [scale * one for one in truth["mount"]["shift_mm"]]
    moved = [
        move_picture(one, (-away[0] * depth, -away[1] * depth))
        for one, depth in zip(psfs, dioptres, strict=True)
    ]
    return np.stack(moved)


def _grey_figure(phase: torch.Tensor, camera: Camera, judge: PSFJudge, shown: np.ndarray) -> Figure:
    """The loss by the panel's grey levels, from the engine's PSFs without and with them."""
    protocol = judge.protocol
    exact = PupilPattern("exact", phase)
    levels = judge.levels(compute_depth_psfs(exact, protocol.test_dioptres, camera, protocol))
    losses = levels - shown
    return _loss_figure("8 bits", losses, losses, levels)


_GOALS = {
    "coupling": _COUPLING_GOAL,
    "shift of 20 pixels": None,
}
"""Losses in dB that are allowed, where they aren't _LOSS_GOAL; None: the loss is told."""

_WORDS = {
    "8 bits": "8 bits over the panel's whole range, of which a wave is a third",
    "flicker": "flicker of .015 of the phase, and of .015 of a wave for each pixel",
    "response": "a response that is 5 % too low",
    "coupling": "fringing that blurs the phase by .6 of a pixel",
    "shift of 2 pixels": "a panel that is shifted by 2 pixels",
    "shift of 20 pixels": "a panel that is shifted by 20 pixels",
}


def _loss_figure(name: str, losses: np.ndarray, still: np.ndarray, levels: np.ndarray) -> Figure:
    """The mean loss over the ten distances, and the worst one.

    still: losses of pictures that are as bright as they should be, and moved back. The goal is for
    these: neither costs detail.
    """
    goal = _GOALS.get(name, _LOSS_GOAL)
    moved = "" if still is losses else f"; of pictures as they are {losses.mean():.3f} dB"
    return Figure(
        f"loss by {_WORDS[name]}, bundled decoder, blind, ten distances",
        TOLD if goal is None else f"≤ {goal:g} dB",
        f"{still.mean():.3f} dB of {levels[: len(still)].mean():.2f}, worst distance "
        f"{still.max():.3f} dB{moved}",
        None if goal is None else bool(still.mean() <= goal),
    )


MEASUREMENTS = {"edof-bench": edof_bench_figures}
