"""Snapshot multispectral imaging through the whole virtual bench, with measured and true PSFs.

The truth doesn't come from the bench: it is the scene's own cube, averaged over the squares of the
sensor's pixels.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from figures import Figure
from figures.spectral_scenes import SIX_BANDS, Array, cave_scene
from labapp.bench.opening import Bench, BenchFiles, open_bench
from labapp.files.cubes import SpectralCube
from labapp.files.plan_file import PlanFile
from labapp.files.reading import bundled_path, validate
from labapp.patterns.grey_levels import compute_patterns
from labapp.runs.acquisition.runner import run_plan
from labapp.spectral.lights import find_light
from labapp.spectral.problem import SpectralProblem
from labapp.spectral.request import SpectralRequest
from labapp.spectral.restoration import RestoredCube, restore_snapshot
from optics.progress import Progress
from optics.threads import single_threaded

_SCENE = "paints"
"""Scene on which nothing was tuned."""

_FRAME = 256
"""Side of the frame in pixels."""

_COVER = 16 / 15
"""Side of the scene over that of the frame, so that light comes in from around the frame."""

_LEVEL_GOAL, _LOSS_GOAL = 27.0, 1.5

_SATURATION_SHARE = 0.8
"""The brightest pixel's electrons over those that saturate it."""

_STAR_STEPS, _SCENE_STEPS = (1, 8, 64), (1 / 4, 1)
"""Exposures of the brackets over those whose brightest pixel isn't saturated. Stars are saturated
in the middle at the longer ones, as in the bundled plan."""

_BETWEEN = np.arange(400.0, 701.0, 10.0)
"""Wavelengths in nm at which the scene's reflectance is known to the bench."""

_STAR_UM, _POINT_UM = 140.0, 2.0
"""Diameters of the star that is photographed, a pixel wide, and of one that counts as a point."""

_TOL, _TRUE_TOL = 0.02, 0.002
"""Tolerances of the bench's pictures, and of the true PSFs."""

_SCENE_FILE = """
version = 2
title = "A star, a white sheet and a spectral cube under a halogen lamp"
tol = {tol}
effects = {{ "unmodulated light" = true, "panel dispersion" = true, "filter bandwidth" = true }}
[lights.halogen]
kind = "halogen"
[targets.dark]
kind = "dark"
[targets.star]
kind = "star"
diameter_um = {star}
distance_m = 2.0
radiance = 20.0
light = "halogen"
[targets.flat]
kind = "cube"
file = "sheet.npy"
wavelengths_nm = [400.0, 700.0]
white = 1.0
cover = {sheet_cover}
distance_m = 2.0
radiance = 0.2
light = "halogen"
[targets.photograph]
kind = "cube"
file = "scene.npy"
wavelengths_nm = [400.0, 700.0]
white = 1.0
cover = {cover}
distance_m = 2.0
radiance = 0.2
light = "halogen"
"""

_SHEET_PIXELS, _SHEET_RIM = 48, 4
"""Pixels of the white sheet, and those over which it fades beyond the frame: an edge that is sharp
takes the bench long. The sheet is about as large as the scene: one without end is 15 % brighter in
the frame, because light from far outside reaches it."""


@single_threaded
def chain_figures(folder: Path) -> list[Figure]:
    """What is restored from the bench's record alone, and with the bench's true PSFs."""
    names = (
        f"six bands of {_SCENE} through the whole virtual bench, {_FRAME} x {_FRAME} pixels",
        "the same, what it loses to the true PSFs",
    )
    goals = (f"≥ {_LEVEL_GOAL:g} dB", f"≤ {_LOSS_GOAL:g} dB")
    scene = cave_scene(_SCENE, _BETWEEN)
    if scene is None:
        why = f"not measured: {_SCENE} not beside the checkout"
        return [Figure(name, goal, why, None) for name, goal in zip(names, goals, strict=True)]
    true_psfs = _record(folder, np.moveaxis(scene, 0, -1))
    wanted = np.searchsorted(_BETWEEN, SIX_BANDS)
    problem = _with_truth(_read_problem(folder), _on_pixels(scene[wanted]))
    measured = _restore(problem)
    window = problem.psfs.shape[1]
    exact = _restore(replace(problem, psfs=_crop(true_psfs, window)))
    (level, words), (best, others) = _words(measured), _words(exact)
    loss = best - level
    return [
        Figure(names[0], goals[0], words, level >= _LEVEL_GOAL),
        Figure(names[1], goals[1], f"{loss:.2f} dB; {others}", loss <= _LOSS_GOAL),
    ]


def _record(folder: Path, scene: Array) -> Array:
    """Run the plan on the bench, and return the bench's true PSFs as shares of a point's light."""
    _write_files(folder, scene)
    plan = tomllib.loads((bundled_path("plans") / "coded-snapshot.toml").read_text())
    with open_bench(BenchFiles(folder / "bench.toml", folder / "scene.toml")) as bench:
        meant = validate(plan, PlanFile, "coded-snapshot")
        camera = bench.description
        greys = compute_patterns(meant.patterns, camera, meant.seed, Progress(), Path())
        plan = _with_exposures(plan, bench, greys)
        run_plan(bench, validate(plan, PlanFile, "coded-snapshot"), folder / "run.h5")
    with open_bench(BenchFiles(folder / "mono.toml", folder / "point.toml")) as bench:
        coded, neutral = (_rates(bench, "star", greys[name]) for name in ("ring", "neutral"))
    return coded / neutral.sum((1, 2), keepdims=True)


def _write_files(folder: Path, scene: Array) -> None:
    bench = (bundled_path("studies") / "spectral-bench.toml").read_text()
    bench = bench.replace("width = 288\nheight = 192", f"width = {_FRAME}\nheight = {_FRAME}")
    assert f"height = {_FRAME}" in bench
    (folder / "bench.toml").write_text(bench)
    # An efficiency of its own takes the place of the colour filters.
    mono = bench.replace("[sensor]", "[sensor]\nquantum_efficiency = 0.6")
    (folder / "mono.toml").write_text(mono)
    # The bench interpolates: the pixel inside the rim still has a part of the fade.
    inside = _SHEET_PIXELS - 2 * (_SHEET_RIM + 1)
    sizes = {"cover": _COVER, "sheet_cover": _SHEET_PIXELS / inside}
    for name, tol, star in (("scene", _TOL, _STAR_UM), ("point", _TRUE_TOL, _POINT_UM)):
        text = _SCENE_FILE.format(tol=tol, star=star, **sizes)
        (folder / f"{name}.toml").write_text(text)
    np.save(folder / "scene.npy", scene.astype(np.float32))
    rise = np.minimum(np.arange(_SHEET_PIXELS) / _SHEET_RIM, 1)
    across = rise * rise[::-1]
    np.save(folder / "sheet.npy", np.repeat(np.outer(across, across)[..., None], 2, axis=2))


def _with_exposures(plan: dict[str, Any], bench: Bench, greys: Mapping[str, Any]) -> dict[str, Any]:
    """The plan with exposures for this bench, and with a white sheet."""
    stars, scenes = plan["acquire"]
    for block, target, pattern, steps in (
        (stars, "star", "neutral", _STAR_STEPS),
        (scenes, "photograph", "ring", _SCENE_STEPS),
    ):
        brightest = float(_rates(bench, target, greys[pattern]).max())
        longest = 1e3 * _SATURATION_SHARE * bench.description.sensor.full_well / brightest
        block["exposures_ms"] = [round(longest * step, 3) for step in steps]
    scenes["interleave"].append({"role": "flat", "frames": 1})
    return plan


def _rates(bench: Bench, target: str, grey: Any) -> Array:
    """Electrons per second on each pixel without noise, (bands, rows, columns)."""
    world = bench.world
    assert world is not None
    world.target, world.grey = target, grey
    found = []
    for wavelength in SIX_BANDS:
        world.wavelength = float(wavelength) / 1e9
        found.append(world.electron_rates()[0].numpy().astype(float))
    return np.stack(found)


def _on_pixels(scene: Array) -> Array:
    """The means of a scene's bands over the sensor's pixels, (bands, rows, columns).

    The axis goes through the middle of the pixel n // 2.
    """
    count = scene.shape[1]
    edges = (np.arange(count + 1) / count - 0.5) * _COVER * _FRAME + _FRAME // 2 + 0.5
    pixel = np.arange(_FRAME)[:, None]
    shares = np.minimum(edges[1:], pixel + 1) - np.maximum(edges[:-1], pixel)
    shares = np.clip(shares, 0, None)
    means: Array = shares @ scene @ shares.T
    return means


def _read_problem(folder: Path) -> SpectralProblem:
    return SpectralRequest(folder / "run.h5").read_problem(Progress())


def _with_truth(problem: SpectralProblem, truth: Array) -> SpectralProblem:
    cube = SpectralCube(truth.astype(np.float32), problem.wavelengths)
    return replace(problem, given_truth=cube)


def _crop(psfs: Array, window: int) -> Array:
    """The middle of PSFs whose origin is the pixel n // 2, which it is then again."""
    start = _FRAME // 2 - window // 2
    part = slice(start, start + window)
    return psfs[:, part, part]


def _restore(problem: SpectralProblem) -> RestoredCube:
    return restore_snapshot(problem, find_light("D65"))


def _words(restored: RestoredCube) -> tuple[float, str]:
    """Mean PSNR in dB, and all scores in words."""
    scores = restored.scores
    assert scores is not None
    bands = " / ".join(f"{one.psnr:.1f}" for one in scores.bands)
    return scores.psnr, (
        f"{scores.psnr:.2f} dB, mean of {bands}; spectral angle {scores.angle:.1f}°; "
        f"{restored.cpu_seconds:.0f} s of processor time"
    )


MEASUREMENTS = {"spectral-chain": chain_figures}
