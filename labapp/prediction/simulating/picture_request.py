"""What is asked of a simulated picture, and the virtual bench that is set up for it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path

from labapp.bench.opening import Bench, BenchFiles, BenchSetup, open_bench, read_scene
from labapp.common.errors import UserError
from labapp.files.bench_file import BenchFile
from labapp.files.grey_table import read_grey_pattern
from labapp.files.reading import read_file
from labapp.files.scene_file import SceneFile
from optics.progress import Progress
from simulator.effects.registry import EFFECTS
from simulator.planning.effect import DecidedBy
from simulator.situation import Situation
from simulator.world import World

# The exposure of a picture that is requested without one. All values are chosen.
_FILL = 0.5  # electrons of the brightest pixel, over the full well
_TRIAL_S = 1e-3  # exposure of the trial picture that measures the scene's brightness
_TRIAL_TOL = 0.1  # relative error of the trial picture
_DARK_S = 1.0  # exposure if the trial picture has no light

_SMALL_BENCH = {
    "panel": {"width": 48, "height": 36, "pitch_um": 40.0},
    "lens": {"f_number": 50.0},
    # Fewer and larger pixels keep the field of view.
    "sensor": {"width": 64, "height": 43, "pitch_um": 41.4},
}


@dataclass(frozen=True)
class PictureRequest:
    """The options for a simulated picture, in SI units.

    scene, bench: files; the bundled ones by default. target: by default the scene's first that
    isn't dark. pattern: 8-bit picture on the panel, which is neutral without. wavelength: of the
    filter; the bench's own by default. exposure: by default, the brightest pixel is half full.
    tol, decide_by: tolerance of the simulation, and whether estimates or bounds decide about
    effects; the scene's by default. forced_effects: levels of effects, added to those that the
    scene forces. all_effects: whether every other effect is at its finest level, whatever tol.
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
        if found[one.name] and any(found[need] in (False, "off") for need in one.requires)
    ]:
        found.update(dict.fromkeys(falling, False))
    return {**found, **forced}


def _set_up_world(bench: Bench, scene: SceneFile, request: PictureRequest) -> World:
    world = bench.world
    assert world is not None
    # Without a name, nobody asks for a dark target.
    lit = (name for name, one in scene.targets.items() if one.kind != "dark")
    world.target = request.target or next(lit, next(iter(scene.targets)))
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
    trial = world.situation(_TRIAL_S)
    imaging = world.imaging.with_tolerance(_TRIAL_TOL)
    electrons = imaging.electrons(trial, imaging.plan(trial).recipe, progress.raise_if_cancelled)
    brightest = float(electrons.max()) / _TRIAL_S
    wanted = _FILL * world.camera.sensor.full_well
    return wanted / brightest if brightest > 0 else _DARK_S


def small_bench_setup(scene: Path | None) -> BenchSetup:
    """Return the bundled bench with fewer, larger pixels, for comparisons with slow references.

    `scene` is the bundled one if it is None. Raises UserError if it can't be read.
    """
    return modified_bench_setup(scene, _SMALL_BENCH)


def modified_bench_setup(
    scene: Path | None, changes: Mapping[str, Mapping[str, float]]
) -> BenchSetup:
    """Do what small_bench_setup() does with other keys of the bench's tables."""
    files = BenchFiles.with_defaults(None, scene)
    data = read_file(files.bench, BenchFile).model_dump(mode="json")
    for table, entries in changes.items():
        data[table] |= entries
    small = BenchFile.model_validate(data)
    return BenchSetup(small, read_scene(files), "the small bench", str(files.scene))


def parse_forced_effects(settings: list[str]) -> dict[str, str | bool]:
    """Parse effects to force, each "NAME=LEVEL".

    LEVEL is on, off, or the name of a level. Raises UserError for anything else.
    """
    known = {one.name: one for one in EFFECTS}
    found: dict[str, str | bool] = {}
    for setting in settings:
        name, equals, level = (part.strip() for part in setting.partition("="))
        if not (name and equals and level):
            raise UserError(f'--set {setting}: give an effect and its level, "read noise=off".')
        if name not in known:
            raise UserError(f"--set {setting}: no such effect. Choose {', '.join(known)}.")
        levels = dict.fromkeys(("off", *known[name].levels, "on"))
        if level not in levels:
            raise UserError(
                f"--set {setting}: {name} has no such level. Choose {', '.join(levels)}."
            )
        found[name] = {"on": True, "off": False}.get(level, level)
    return found
