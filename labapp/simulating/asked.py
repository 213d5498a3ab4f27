"""A picture of a scene that somebody asks for at the command line."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path

from labapp.bench import Bench, BenchFiles, open_bench
from labapp.errors import UserError
from labapp.files.reading import read_grey
from optics.progress import Progress
from simulator.situation import Situation
from simulator.world import World

_FILLED = 0.8
"""Of the full well, what the brightest pixel gets where nobody says an exposure."""

_TRIAL = 1e-3
"""Seconds of the exposure by which the brightness of a scene is found out."""

_DARK = 1.0
"""Seconds of an exposure for which there is no light."""


@dataclass(frozen=True)
class AskedPicture:
    """What the command line asks for; SI units.

    scene, bench: files; the bundled ones if None. target: by name; the scene's first if None.
    pattern: 8-bit picture on the panel; neutral if None. wavelength: of the filter; the bench's
    own if None. exposure: seconds; so that the brightest pixel is four fifths full if None. tol,
    forced: the scene's own if None, and beyond the scene's own.
    """

    scene: Path | None = None
    bench: Path | None = None
    target: str | None = None
    pattern: Path | None = None
    wavelength: float | None = None
    exposure: float | None = None
    tol: float | None = None
    forced: Mapping[str, str | bool] = field(default_factory=dict)


@contextmanager
def stage(asked: AskedPicture, progress: Progress) -> Iterator[tuple[World, Situation]]:
    """The virtual world of a bench, set as asked, and the situation of the picture.

    UserError names the file, or the option, that is wrong.
    """
    setup = BenchFiles.default(asked.bench, asked.scene).read()
    if setup.scene is None:
        raise UserError(
            f"{setup.source} has real devices only; give a --bench whose camera is simulated."
        )
    scene = setup.scene
    if asked.tol is not None:
        scene = scene.model_copy(update={"tol": asked.tol})
    if asked.forced:
        scene = scene.model_copy(update={"effects": {**scene.effects, **asked.forced}})
    with open_bench(replace(setup, scene=scene)) as bench:
        world = _set(bench, asked)
        yield world, world.situation(_exposure(world, asked, progress))


def _set(bench: Bench, asked: AskedPicture) -> World:
    world = bench.world
    assert world is not None
    if asked.target is not None:
        if asked.target not in world.scene.targets:
            names = ", ".join(world.scene.targets)
            raise UserError(f"--target {asked.target}: the scene has {names}.")
        world.target = asked.target
    if asked.wavelength is not None:
        bench.filter.set_wavelength(asked.wavelength)
    if asked.pattern is not None:
        grey, shape = read_grey(asked.pattern), world.camera.panel.shape
        if grey.shape != shape:
            raise UserError(
                f"{asked.pattern} has {grey.shape[1]} x {grey.shape[0]} pixels and the panel "
                f"{shape[1]} x {shape[0]}; give a pattern made for it."
            )
        world.grey = grey
    return world


def _exposure(world: World, asked: AskedPicture, progress: Progress) -> float:
    if asked.exposure is not None:
        if not 0 < asked.exposure < math.inf:
            raise UserError(f"--exposure-ms {asked.exposure * 1e3:g}: give a positive time.")
        return asked.exposure
    progress.report(0.0, "finding an exposure")
    rate, _ = world.light(_TRIAL, progress.check)
    brightest = float(rate.max())
    return _FILLED * world.camera.sensor.full_well / brightest if brightest > 0 else _DARK


def read_forced(settings: list[str]) -> dict[str, str | bool]:
    """Effects as "NAME=LEVEL": on, off, or a level by its name. UserError for what isn't so."""
    found: dict[str, str | bool] = {}
    for setting in settings:
        name, equals, level = (part.strip() for part in setting.partition("="))
        if not (name and equals and level):
            raise UserError(f'--set {setting}: give an effect and its level, "read noise=off".')
        found[name] = {"on": True, "off": False}.get(level, level)
    return found
