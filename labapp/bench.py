"""A bench: the devices of a bench file, opened together and left safe together."""

from __future__ import annotations

import inspect
import logging
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any

from drivers.clock import RealClock
from drivers.errors import DeviceError
from drivers.interfaces import (
    SLM,
    Camera,
    Clock,
    Device,
    SpectralFilter,
    Surroundings,
    TargetChanger,
)
from labapp.errors import UserError
from labapp.files.bench_file import BenchFile, DevicesTable, DeviceTable
from labapp.files.reading import bundled, read_toml
from labapp.files.scene_file import SceneFile
from optics.camera import Camera as CameraDescription
from simulator.world import World

log = logging.getLogger(__name__)

GROUP = "labapp.devices"


@dataclass
class Bench:
    """Open devices and the description of the camera that they make up.

    world is the virtual world behind simulated devices, None without one.
    """

    file: BenchFile
    scene_file: SceneFile | None
    description: CameraDescription
    clock: Clock
    world: World | None
    slm: SLM
    filter: SpectralFilter
    camera: Camera
    targets: TargetChanger

    @property
    def devices(self) -> dict[str, Device]:
        return {
            "slm": self.slm,
            "filter": self.filter,
            "camera": self.camera,
            "targets": self.targets,
        }

    @property
    def simulated(self) -> list[str]:
        """The names of the devices that are simulated."""
        return [name for name, device in self.devices.items() if device.identity.simulated]

    def make_safe(self) -> list[DeviceError]:
        """SLM neutral, filter parked, camera stopped; every device is tried, whatever fails."""
        failures = []
        for device in self.devices.values():
            try:
                device.make_safe()
            except DeviceError as error:
                log.error("%s", error)
                failures.append(error)
        return failures


@dataclass(frozen=True)
class BenchFiles:
    """What a bench is opened from. The scene is for benches with simulated devices."""

    bench: Path
    scene: Path
    image: Path | None = None

    @staticmethod
    def default(
        bench: Path | None = None, scene: Path | None = None, image: Path | None = None
    ) -> BenchFiles:
        return BenchFiles(bench or bundled("bench.toml"), scene or bundled("scene.toml"), image)


def drivers() -> dict[str, EntryPoint]:
    """The device drivers that are installed, by name."""
    return {entry.name: entry for entry in entry_points(group=GROUP)}


@contextmanager
def open_bench(files: BenchFiles) -> Iterator[Bench]:
    """The devices of a bench file, opened; left safe and closed however the block ends.

    UserError names the file and key of what is wrong with it; DeviceError says which
    device didn't open. A device that doesn't open is never replaced by a simulated one.
    """
    bench_file = read_toml(files.bench, BenchFile)
    tables = {name: getattr(bench_file.devices, name) for name in DevicesTable.model_fields}
    virtual = any(table.driver.startswith("simulated-") for table in tables.values())
    scene_file = read_scene(files) if virtual else None
    camera = bench_file.build_camera()
    world = build_world(camera, scene_file, files) if scene_file else None
    surroundings = Surroundings(world.clock if world else RealClock(), world)
    with ExitStack() as stack:
        opened: dict[str, Any] = {}
        for name, table in tables.items():
            device = _create(name, table, surroundings, files.bench)
            opened[name] = stack.enter_context(device)
        bench = Bench(bench_file, scene_file, camera, surroundings.clock, world=world, **opened)
        try:
            yield bench
        finally:
            bench.make_safe()


def read_scene(files: BenchFiles) -> SceneFile:
    """The scene file, with the user's own picture in its photographs if one is given."""
    scene = read_toml(files.scene, SceneFile)
    if files.image is None:
        return scene
    own = {"file": str(files.image.resolve()), "credit": ""}
    targets = {
        name: table.model_copy(update=own) if table.kind == "photograph" else table
        for name, table in scene.targets.items()
    }
    return scene.model_copy(update={"targets": targets})


def build_world(camera: CameraDescription, scene: SceneFile, files: BenchFiles) -> World:
    """The virtual world of a scene; UserError names the scene file if it can't be."""
    targets = scene.build(files.scene.parent)
    try:
        return World(camera, targets, tol=scene.tol, forced=scene.effects)
    except ValueError as error:
        raise UserError(f"{files.scene}: {error}.") from error


def _create(name: str, table: DeviceTable, surroundings: Surroundings, path: Path) -> Any:
    entry = drivers().get(table.driver)
    if entry is None:
        raise UserError(
            f"{path}: key 'devices.{name}.driver' is {table.driver!r}, which is unknown. "
            f"Choose one of {', '.join(sorted(drivers()))}."
        )
    try:
        factory = entry.load()
    except Exception as error:
        raise UserError(
            f"{path}: key 'devices.{name}.driver' is {table.driver!r}, which doesn't load: "
            f"{error}. Reinstall the package that provides it."
        ) from error
    try:
        inspect.signature(factory).bind(surroundings, **table.options)
    except TypeError as error:
        known = [p for p in inspect.signature(factory).parameters if p != "surroundings"]
        raise UserError(
            f"{path}: key 'devices.{name}.options': {error}. "
            f"{table.driver} takes {', '.join(known) or 'no options'}."
        ) from error
    try:
        return factory(surroundings, **table.options)
    except (TypeError, ValueError, IndexError) as error:
        raise UserError(
            f"{path}: key 'devices.{name}.options' is {table.options}: {error}. Correct the value."
        ) from error
