"""What is asked of a simulated picture, and the virtual bench that is set up for it."""

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
from simulator.planning.effect import DecidedBy
from simulator.situation import Situation
from simulator.world import World


@dataclass(frozen=True)
class AutoExposureSettings:
    """Tune the exposure of a picture that is requested without one. All values are chosen.

    target_fill: electrons of the brightest pixel, over the full well.
    trial: exposure in seconds of the trial picture that measures the scene's brightness.
    trial_tol: relative error of the trial picture.
    dark: exposure in seconds if the trial picture has no light.
    """

    target_fill: float = 0.5
    trial: float = 1e-3
    trial_tol: float = 0.1
    dark: float = 1.0


_SETTINGS = AutoExposureSettings()


@dataclass(frozen=True)
class PictureRequest:
    """The options for a simulated picture, in SI units.

    scene, bench: files; the bundled ones by default.
    target: name; the scene's first that isn't dark by default.
    pattern: 8-bit picture on the panel; neutral by default.
    wavelength: of the filter in metres; the bench's own by default.
    exposure: seconds; by default, the brightest pixel is half full.
    tol: tolerance of the simulation; the scene's own by default.
    forced_effects: levels of effects, which are added to those that the scene forces.
    all_effects: whether every effect that isn't forced is at its finest level, whatever tol.
    decide_by: "estimate" or "bound", by which effects are decided about; the scene's by default.
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
    decide_by: DecidedBy | None = None


@dataclass(frozen=True)
class PreparedScene:
    """A virtual bench that is set up for a picture, and the picture's situation.

    files: bench and scene as JSON.
    """

    world: World
    situation: Situation
    files: dict[str, str]


def prepare_scene(
    request: PictureRequest, progress: Progress
) -> AbstractContextManager[PreparedScene]:
    """Open a virtual bench, and yield the scene as requested.

    Raises UserError with the file or the option that is wrong.
    """
    return prepare_bench_scene(
        BenchFiles.with_defaults(request.bench, request.scene).read(), request, progress
    )


@contextmanager
def prepare_bench_scene(
    setup: BenchSetup, request: PictureRequest, progress: Progress
) -> Iterator[PreparedScene]:
    """Do what prepare_scene() does on a bench that was read before.

    The files in the request are ignored.
    """
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
        world = _set_up_world(bench, scene, request)
        exposure = _exposure(world, request, progress)
        files = {"bench": setup.bench.model_dump_json(), "scene": scene.model_dump_json()}
        yield PreparedScene(world, world.situation(exposure), files)


def _requested_scene(scene: SceneFile, request: PictureRequest) -> SceneFile:
    """Return the scene with the requested tolerance and effects."""
    if request.tol is not None and not 0 < request.tol < 1:
        raise UserError(f"--tol {request.tol:g}: give a number between 0 and 1, as 0.01.")
    tol, forced = request.tol or scene.tol, {**scene.effects, **request.forced_effects}
    if request.all_effects:
        # Arithmetic and sampling get a tenth of this tolerance when all effects are on.
        tol, forced = min(tol, 1e-4), _all_effects_except(forced)
    decide_by = request.decide_by or scene.decide_by
    return scene.model_copy(update={"tol": tol, "effects": forced, "decide_by": decide_by})


def _all_effects_except(forced: Mapping[str, str | bool]) -> dict[str, str | bool]:
    """Switch on all effects but the forced ones, and off those that need one that is off."""
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


def _first_lit(scene: SceneFile) -> str:
    """Return the first target that isn't dark: without a name, nobody asks for a dark one."""
    names = list(scene.targets)
    return next((one for one in names if scene.targets[one].kind != "dark"), names[0])


def _set_up_world(bench: Bench, scene: SceneFile, request: PictureRequest) -> World:
    world = bench.world
    assert world is not None
    world.target = request.target or _first_lit(scene)
    if request.wavelength is not None:
        bench.filter.set_wavelength(request.wavelength)
    if request.pattern is not None:
        world.grey = read_grey_pattern(request.pattern, world.camera.panel)
    return world


def _exposure(world: World, request: PictureRequest, progress: Progress) -> float:
    """Return the exposure in seconds, as requested or from a trial picture."""
    if request.exposure is not None:
        return request.exposure
    progress.report(0.0, "finding an exposure")
    trial = world.situation(_SETTINGS.trial)
    imaging = world.imaging.with_tolerance(_SETTINGS.trial_tol)
    electrons = imaging.electrons(trial, imaging.plan(trial).recipe, progress.raise_if_cancelled)
    brightest = float(electrons.max()) / _SETTINGS.trial
    wanted = _SETTINGS.target_fill * world.camera.sensor.full_well
    return wanted / brightest if brightest > 0 else _SETTINGS.dark


def parse_forced_effects(settings: list[str]) -> dict[str, str | bool]:
    """Parse effects to force, each "NAME=LEVEL".

    LEVEL is on, off, or the name of a level. Raises UserError for anything else.
    """
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
