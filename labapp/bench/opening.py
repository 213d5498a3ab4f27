"""The devices of a bench file, opened together and made safe together."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, cast

from drivers.clock import RealClock
from drivers.errors import DeviceError
from drivers.hosted.guard import guard_devices
from drivers.interfaces import (
    SLM,
    Camera,
    Clock,
    Device,
    FilterWheel,
    SpectralFilter,
    Surroundings,
    TargetChanger,
)
from drivers.supervised import SupervisedCamera, SupervisedDevice
from labapp.bench import driver_loading
from labapp.bench.calibration_validity import (
    calibration_summary,
    camera_calibration_summary,
    camera_validity_warnings,
    validity_warnings,
    wavelength_warnings,
)
from labapp.bench.camera_match import require_described_camera
from labapp.bench.locking import lock_devices, lock_serial_number
from labapp.common.command_end import delay_interrupts, note_unsafe, raise_on_interrupt
from labapp.common.errors import UserError
from labapp.common.frame_delays import FrameDelays
from labapp.common.memory import give_back_freed_memory
from labapp.files.bench_file import BenchFile, DeviceTable, read_bench
from labapp.files.fault_file import read_faults
from labapp.files.file_lookup import find_scene
from labapp.files.reading import bundled_path, read_file
from labapp.files.scene_file import SceneFile
from optics.camera import Camera as CameraDescription
from simulator.clock import VirtualClock
from simulator.faults import Fault
from simulator.world import World

__all__ = [
    "Bench",
    "BenchFiles",
    "BenchSetup",
    "OpenDevice",
    "open_bench",
    "open_device",
    "open_devices",
]

log = logging.getLogger(__name__)


@dataclass
class Bench:
    """Open devices, and the calibrated description of the camera that they form.

    A run accepts any object with these attributes, so that a script may pass its own.

    Parameters
    ----------
    file : BenchFile
        Bench file as read.
    scene_file : SceneFile or None
        Scene of simulated devices.
    description : optics.camera.Camera
        Panel, lens and sensor, with the calibration applied.
    clock : Clock
        Time of the devices, real or virtual.
    world : World or None
        Virtual world behind simulated devices; None without one.
    slm : SLM
        The open SLM.
    filter : SpectralFilter
        The open filter.
    camera : Camera
        The open camera.
    targets : TargetChanger
        The open target changer.
    supervised_devices : mapping
        The same devices by name, with the methods that reopen them.
    calibration_warnings : tuple of str
        Reasons why the calibration in force may no longer hold.
    frame_delays : FrameDelays or None
        What frames take beyond what the devices document, once a run has measured it.
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
    supervised_devices: Mapping[str, SupervisedDevice] = field(default_factory=dict)
    calibration_warnings: tuple[str, ...] = ()
    frame_delays: FrameDelays | None = None

    @property
    def devices(self) -> dict[str, Device]:
        """Return the open devices by name."""
        return {name: getattr(self, name) for name in ("slm", "filter", "camera", "targets")}

    @property
    def wheel(self) -> FilterWheel | None:
        """Return the filter if it is a filter wheel, else None."""
        return cast(FilterWheel, self.filter) if hasattr(self.filter, "set_slot") else None

    @property
    def simulated_devices(self) -> list[str]:
        """Return the names of the simulated devices."""
        return [name for name, device in self.devices.items() if device.identity.simulated]

    @property
    def camera_world(self) -> World | None:
        """Return the virtual world before the camera; None before a real camera."""
        return self.world if self.camera.identity.simulated else None

    def calibration_warnings_at(self, wavelengths: Iterable[float]) -> tuple[str, ...]:
        """Return the reasons why the calibration may not hold at wavelengths in metres."""
        calibration = self.file.active_calibration
        beyond = wavelength_warnings(calibration, wavelengths) if calibration else []
        return (*self.calibration_warnings, *beyond)

    def make_safe(self) -> list[DeviceError]:
        """Make all devices safe at once, and return the errors of those that fail.

        Safe means that the SLM shows the neutral pattern, the filter is parked and the camera is
        stopped.
        """
        return _make_safe(self.supervised_devices.values())

    def failed_devices(self) -> list[str]:
        """Return a message with the reason for each device that was given up."""
        return [
            f"the {role} {one.failure_reason}"
            for role, one in self.supervised_devices.items()
            if one.failure_reason
        ]

    @contextmanager
    def cancellable_by(self, cancelled: Callable[[], bool]) -> Iterator[None]:
        """Within the block, end calls to the devices once `cancelled` returns true."""
        for device in self.supervised_devices.values():
            device.cancelled = cancelled
        try:
            yield
        finally:
            for device in self.supervised_devices.values():
                device.cancelled = lambda: False

    def device_error(self, role: str, command: str, reply: str) -> DeviceError:
        """Build a device's DeviceError from a command and its reply."""
        device = self.devices[role]
        error = DeviceError(device.identity.model, command, reply, "If it stays, restart it")
        error.role = role
        return error


@dataclass(frozen=True)
class BenchFiles:
    """Files that a bench is opened from.

    Parameters
    ----------
    bench : Path
        Bench file.
    scene : Path
        Scene file, for benches with simulated devices.
    image : Path or None
        The user's own photograph, which replaces those of the scene.
    faults : Path or None
        Fault file for simulated devices.
    memory : int or None
        Bytes that simulated pictures may keep for later ones; the simulator's default if None.
    """

    bench: Path
    scene: Path
    image: Path | None = None
    faults: Path | None = None
    memory: int | None = None

    @staticmethod
    def with_defaults(
        bench: Path | None = None,
        scene: Path | None = None,
        image: Path | None = None,
        faults: Path | None = None,
        memory: int | None = None,
    ) -> BenchFiles:
        """Return the files to open, the bundled ones where None is given.

        `scene` may be the name of a bundled scene.
        """
        bench = bench or bundled_path("bench.toml")
        scene = find_scene(scene) if scene else bundled_path("scene.toml")
        return BenchFiles(bench, scene, image, faults, memory)

    def read(self) -> BenchSetup:
        """Read bench, scene and faults; UserError names the wrong file and key."""
        bench = read_bench(self.bench)
        faults = read_faults(self.faults) if self.faults else ()
        if not bench.is_virtual:
            if faults:
                raise UserError(f"{self.faults}: {self.bench} has no simulated device to fail.")
            return BenchSetup(bench, None, str(self.bench), "")
        scene = read_scene(self)
        return BenchSetup(bench, scene, str(self.bench), str(self.scene), faults, self.memory)


@dataclass(frozen=True)
class BenchSetup:
    """Contents of the files, from the files themselves or from the record of a run.

    Parameters
    ----------
    bench : BenchFile
        Bench file.
    scene : SceneFile or None
        Scene of simulated devices; its pictures have absolute paths.
    source : str
        Name of the bench file in error messages.
    scene_source : str
        Name of the scene file in error messages.
    faults : tuple of Fault
        Faults of simulated devices.
    memory : int or None
        Bytes that simulated pictures may keep for later ones; the simulator's default if None.
    """

    bench: BenchFile
    scene: SceneFile | None
    source: str
    scene_source: str
    faults: tuple[Fault, ...] = ()
    memory: int | None = None


@contextmanager
def open_bench(
    files_or_setup: BenchFiles | BenchSetup, *, speed: float = math.inf
) -> Iterator[Bench]:
    """Open all devices; make them safe and close them however the block ends.

    A device that doesn't open is never replaced by a simulated one.

    Parameters
    ----------
    files_or_setup : BenchFiles or BenchSetup
        Files to read, or their contents.
    speed : float
        Seconds of a virtual bench's time in a second of real time.

    Yields
    ------
    Bench
        The bench with its open devices.

    Raises
    ------
    UserError
        If a file is wrong, naming file and key; if another application uses a device; or if the
        camera isn't as the file's sensor describes it.
    DeviceError
        If a device doesn't open.
    """
    setup = files_or_setup.read() if isinstance(files_or_setup, BenchFiles) else files_or_setup
    camera = setup.bench.build_camera()
    tables = setup.bench.devices.run_devices
    with _open_devices(setup, tables, speed) as (surroundings, watched):
        opened: dict[str, Any] = dict(watched)
        bench = Bench(
            setup.bench,
            setup.scene,
            camera,
            surroundings.clock,
            world=surroundings.world,
            supervised_devices=watched,
            **opened,
        )
        try:
            require_described_camera(bench.camera, camera.sensor, setup.source)
            bench.calibration_warnings = _log_calibration(bench)
            yield bench
        finally:
            bench.make_safe()


@dataclass(frozen=True)
class OpenDevice:
    """A device that was opened alone, and its clock.

    Parameters
    ----------
    clock : Clock
        Time of the device, real or virtual.
    device : Device
        The open device.
    """

    clock: Clock
    device: Any


@contextmanager
def open_device(files_or_setup: BenchFiles | BenchSetup, role: str) -> Iterator[OpenDevice]:
    """Open one device alone, whether or not the others are there.

    The device is made safe and closed however the block ends.

    Parameters
    ----------
    files_or_setup : BenchFiles or BenchSetup
        Files to read, or their contents.
    role : str
        Name of the device on the bench, such as "camera".

    Yields
    ------
    OpenDevice
        The device and its clock.

    Raises
    ------
    UserError
        If a file is wrong, the bench has no such device, or another application uses it.
    DeviceError
        If the device doesn't open.
    """
    with open_devices(files_or_setup, (role,)) as (clock, devices):
        yield OpenDevice(clock, devices[role])


@contextmanager
def open_devices(
    files_or_setup: BenchFiles | BenchSetup, roles: Sequence[str], *, speed: float = math.inf
) -> Iterator[tuple[Clock, dict[str, Any]]]:
    """Open some devices together, whether or not the others are there.

    Simulated ones share one world. The devices are made safe and closed however the block ends.

    Parameters
    ----------
    files_or_setup : BenchFiles or BenchSetup
        Files to read, or their contents.
    roles : sequence of str
        Names of the devices on the bench, such as "camera".
    speed : float
        Seconds of a virtual bench's time in a second of real time.

    Yields
    ------
    tuple of Clock and dict
        Time of the devices, real or virtual, and the open devices by name.

    Raises
    ------
    UserError
        If a file is wrong, the bench has no such device, or another application uses one.
    DeviceError
        If a device doesn't open.
    """
    setup = files_or_setup.read() if isinstance(files_or_setup, BenchFiles) else files_or_setup
    tables = setup.bench.devices.tables
    for role in roles:
        if role not in tables:
            raise UserError(
                f"{setup.source} has no device {role!r}. Choose one of {', '.join(tables)}."
            )
    chosen = {role: tables[role] for role in roles}
    with _open_devices(setup, chosen, speed) as (surroundings, watched):
        try:
            yield surroundings.clock, dict(watched)
        finally:
            _make_safe(watched.values())


def _make_safe(devices: Iterable[SupervisedDevice]) -> list[DeviceError]:
    """Make devices safe at once, and return the errors of those that fail."""
    failures = []
    with delay_interrupts():
        begun = [device.begin_make_safe() for device in devices]
        for finish in begun:
            try:
                finish()
            except DeviceError as error:
                log.error("%s", error)
                note_unsafe(str(error))
                failures.append(error)
    return failures


@contextmanager
def _open_devices(
    setup: BenchSetup, tables: Mapping[str, DeviceTable], speed: float
) -> Iterator[tuple[Surroundings, dict[str, SupervisedDevice]]]:
    """Lock and open devices under supervision, by name, while the block runs."""
    # If any device is real, the simulated ones run in real time, too.
    virtual = all(table.is_simulated for table in tables.values())
    clock: Clock = VirtualClock(speed) if virtual else RealClock()
    # A calibration is knowledge about the devices and doesn't change the virtual world.
    described = setup.bench.without_calibration().build_camera()
    world = build_world(described, setup, clock) if setup.scene else None
    surroundings = Surroundings(clock, world)
    with raise_on_interrupt(), ExitStack() as stack:
        if world is not None:
            # Last in, first out: its pictures are freed even if something refers to it.
            stack.callback(give_back_freed_memory)
            stack.callback(world.forget)
        stack.enter_context(lock_devices(tables))
        stack.enter_context(guard_devices(driver_loading.guarded_devices(tables)))
        watched: dict[str, SupervisedDevice] = {}
        for name, table in tables.items():
            make = driver_loading.device_maker(name, table, surroundings, setup.source)
            device = (
                SupervisedCamera(name, make, 1 / speed, simulated=table.simulated)
                if name == "camera"
                else SupervisedDevice(name, make, simulated=table.simulated)
            )
            watched[name] = stack.enter_context(device)
            stack.enter_context(lock_serial_number(name, table, device.identity))
        yield surroundings, watched


def _log_calibration(bench: Bench) -> tuple[str, ...]:
    """Log which calibrations are in force; return warnings if they may not hold."""
    identities = {name: device.identity for name, device in bench.devices.items()}
    found = []
    if (calibration := bench.file.active_calibration) is not None:
        log.info("%s", calibration_summary(calibration))
        found += validity_warnings(calibration, bench.file, identities)
    if (camera := bench.file.active_camera_calibration) is not None:
        log.info("%s", camera_calibration_summary(camera))
        found += camera_validity_warnings(camera, bench.file, identities)
    for doubt in found:
        log.warning("STALE CALIBRATION: %s", doubt)
    return tuple(found)


def read_scene(files: BenchFiles) -> SceneFile:
    """Read the scene file, and put the user's own picture into its photographs if given."""
    scene = read_file(files.scene, SceneFile)
    if files.image is None:
        return scene.with_files_in(files.scene.resolve().parent)
    own = {"file": str(files.image.resolve()), "credit": ""}
    return scene.with_files_in(files.scene.resolve().parent).with_photographs(own)


def build_world(camera: CameraDescription, setup: BenchSetup, clock: Clock) -> World:
    """Build the virtual world of a scene; UserError names the scene file if that fails.

    `camera` is the camera as the bench file describes it. Where the scene states the true
    properties of the devices, only the world has them.
    """
    scene = setup.scene
    assert scene is not None
    targets, truth = scene.build(), scene.truth
    polarisation = setup.bench.polarisation
    try:
        world = World(
            truth.true_camera(camera) if truth else camera,
            targets,
            mount=truth.mount.build() if truth else None,
            # The camera already includes transmission and unmodulated light. The path adds only
            # the interference of both.
            path=polarisation.build().effect() if polarisation else None,
            tol=scene.tol,
            clock=clock,
            faults=setup.faults,
            memory=setup.memory,
            decide_by=scene.decide_by,
            effective_index=truth.filter.effective_index if truth else None,
        )
    except ValueError as error:
        raise UserError(f"{setup.scene_source}: {error}.") from error
    try:
        world.force(scene.effects)
    except ValueError as error:
        raise UserError(f"{setup.scene_source}: key 'effects': {error}.") from error
    return world
