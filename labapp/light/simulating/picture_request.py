"""A picture of a scene that somebody asks for at the command line."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path

from labapp.bench.opening import Bench, BenchFiles, BenchSetup, open_bench
from labapp.common.errors import UserError
from labapp.files.grey_table import read_grey_pattern
from labapp.files.scene_file import SceneFile
from optics.progress import Progress
from simulator.effects.registry import EFFECTS
from simulator.situation import Situation
from simulator.world import World

_TARGET_FILL = 0.5
"""Of the full well, what the brightest pixel gets where nobody says an exposure."""

_TRIAL, _TRIAL_TOL = 1e-3, 0.1
"""Seconds of the exposure by which the brightness of a scene is found out, and how well."""

_FINEST_TOL = 1e-4
"""Tolerance of arithmetic and sampling, ten times over, where every effect is asked for."""

_DARK = 1.0
"""Seconds of an exposure for which there is no light."""


@dataclass(frozen=True)
class PictureRequest:
    """What the command line asks for; SI units.

    scene, bench: files; the bundled ones if None. target: by name; the scene's first if None.
    pattern: 8-bit picture on the panel; neutral if None. wavelength: of the filter; the bench's
    own if None. exposure: seconds; so that the brightest pixel is half full if None. tol,
    forced_effects: the scene's own if None, and beyond the scene's own. all_effects: whether every
    effect that isn't forced is at its finest, whatever tol.
    """

    scene: Path | None = None
    bench: Path | None = None
    target: str | None = None
    pattern: Path | None = None
    wavelength: float | None = None
    exposure: float | None = None
    tol: float | None = None
    forced_effects: Mapping[str, str | bool] = field(default_factory=dict)
    all_effects: bool = False


@dataclass(frozen=True)
class PreparedScene:
    """A world that is set as asked, and the situation of the picture.

    files: the bench and the scene that they were made from, as JSON.
    """

    world: World
    situation: Situation
    files: dict[str, str]


def prepare_scene(
    request: PictureRequest, progress: Progress
) -> AbstractContextManager[PreparedScene]:
    """The virtual world of a bench, set as asked, and the situation of the picture.

    UserError names the file, or the option, that is wrong.
    """
    return prepare_bench_scene(
        BenchFiles.with_defaults(request.bench, request.scene).read(), request, progress
    )


@contextmanager
def prepare_bench_scene(
    setup: BenchSetup, request: PictureRequest, progress: Progress
) -> Iterator[PreparedScene]:
    """The same of a bench that is read already; asked's own files don't count."""
    if request.exposure is not None and not 0 < request.exposure < math.inf:
        raise UserError(f"--exposure-ms {request.exposure * 1e3:g}: give a positive time.")
    if setup.scene is None or setup.bench.is_real:
        raise UserError(
            f"{setup.source} has real devices, of which nothing is simulated. Give a --bench whose "
            "devices are all simulated."
        )
    if request.target is not None and request.target not in setup.scene.targets:
        names = ", ".join(setup.scene.targets)
        raise UserError(f"--target {request.target}: the scene has {names}.")
    scene = _requested_scene(setup.scene, request)
    with open_bench(replace(setup, scene=scene)) as bench:
        world = _set_up_world(bench, request)
        exposure = _exposure(world, request, progress)
        files = {"bench": setup.bench.model_dump_json(), "scene": scene.model_dump_json()}
        yield PreparedScene(world, world.situation(exposure), files)


def _requested_scene(scene: SceneFile, request: PictureRequest) -> SceneFile:
    """The scene with the tolerance and the effects that are asked for."""
    if request.tol is not None and not 0 < request.tol < 1:
        raise UserError(f"--tol {request.tol:g}: give a number between 0 and 1, as 0.01.")
    tol, forced = request.tol or scene.tol, {**scene.effects, **request.forced_effects}
    if request.all_effects:
        tol, forced = min(tol, _FINEST_TOL), _all_effects_except(forced)
    return scene.model_copy(update={"tol": tol, "effects": forced})


def _all_effects_except(forced: Mapping[str, str | bool]) -> dict[str, str | bool]:
    """All effects at their finest but those that are forced, and what can't be without them."""
    found: dict[str, str | bool] = {**dict.fromkeys((one.name for one in EFFECTS), True), **forced}
    while falling := [
        one.name
        for one in EFFECTS
        if found[one.name] and any(_is_off(found[need]) for need in one.requires)
    ]:
        found.update(dict.fromkeys(falling, False))
    return {**found, **forced}


def _is_off(level: str | bool) -> bool:
    return level in (False, "off")


def _set_up_world(bench: Bench, request: PictureRequest) -> World:
    world = bench.world
    assert world is not None
    if request.target is not None:
        world.target = request.target
    if request.wavelength is not None:
        bench.filter.set_wavelength(request.wavelength)
    if request.pattern is not None:
        world.grey = read_grey_pattern(request.pattern, world.camera.panel)
    return world


def _exposure(world: World, request: PictureRequest, progress: Progress) -> float:
    if request.exposure is not None:
        return request.exposure
    progress.report(0.0, "finding an exposure")
    trial, imaging = world.situation(_TRIAL), world.imaging.with_tolerance(_TRIAL_TOL)
    electrons = imaging.electrons(trial, imaging.plan(trial).recipe, progress.raise_if_cancelled)
    brightest = float(electrons.max()) / _TRIAL
    return _TARGET_FILL * world.camera.sensor.full_well / brightest if brightest > 0 else _DARK


def parse_forced_effects(settings: list[str]) -> dict[str, str | bool]:
    """Effects as "NAME=LEVEL": on, off, or a level by its name. UserError for what isn't so."""
    found: dict[str, str | bool] = {}
    for setting in settings:
        name, equals, level = (part.strip() for part in setting.partition("="))
        if not (name and equals and level):
            raise UserError(f'--set {setting}: give an effect and its level, "read noise=off".')
        _require_known_level(setting, name, level)
        found[name] = {"on": True, "off": False}.get(level, level)
    return found


def _require_known_level(setting: str, name: str, level: str) -> None:
    named = {one.name: one for one in EFFECTS}
    if name not in named:
        raise UserError(f"--set {setting}: no such effect. Choose {', '.join(named)}.")
    if level not in ("on", "off", *named[name].levels):
        levels = ", ".join(dict.fromkeys(("off", *named[name].levels, "on")))
        raise UserError(f"--set {setting}: {name} has no such level. Choose {levels}.")
