"""The bench file: its devices, and the description of the camera that they make up."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pydantic import Field

from labapp.files.camera_file import CameraFile, resolve_included_files
from labapp.files.quantities import Positive
from labapp.files.reading import FileModel, bundled_path, read_file
from optics.camera import Camera


class DeviceTable(FileModel):
    """A device in a bench file: the entry point of its driver, and the driver's options.

    With own_process, the driver runs in a process of its own, which can be killed when a library
    hangs. simulated says that a real driver talks to a simulated instrument, which the driver
    itself can't know; `labapp virtual-bench serve` sets it for the instruments that it serves.
    """

    driver: str
    options: dict[str, Any] = Field(default_factory=dict)
    own_process: bool = False
    simulated: bool = False

    @property
    def is_simulated(self) -> bool:
        """Whether the driver simulates the whole device, by its name."""
        return self.driver.startswith("simulated-")

    @property
    def is_exclusive(self) -> bool:
        """Whether one application at a time can open the device; others are simulated or manual."""
        return not self.is_simulated and self.driver != "manual-targets"


class DevicesTable(FileModel):
    """The devices of a bench file by their roles.

    A run uses all devices but the spectroradiometer, which is optional.
    """

    slm: DeviceTable
    filter: DeviceTable
    camera: DeviceTable
    targets: DeviceTable
    spectroradiometer: DeviceTable | None = None

    @property
    def tables(self) -> dict[str, DeviceTable]:
        """All devices that are given, by role."""
        named = {name: getattr(self, name) for name in DevicesTable.model_fields}
        return {name: table for name, table in named.items() if table is not None}

    @property
    def run_devices(self) -> dict[str, DeviceTable]:
        """The devices that every run needs, by role."""
        return {name: table for name, table in self.tables.items() if name != "spectroradiometer"}


class BenchFile(CameraFile):
    """A bench: devices bound to a camera description.

    flicker_hz is how often a second the light of the lamp repeats, which is twice the frequency of
    the mains: brackets that are chosen have exposures of whole periods.
    """

    devices: DevicesTable
    flicker_hz: Positive | None = None

    @property
    def is_virtual(self) -> bool:
        """Whether any device is simulated, so that a scene file is needed."""
        return any(table.is_simulated for table in self.devices.tables.values())

    @property
    def tells_clip_level(self) -> bool:
        """Whether description or calibration tell where pixels clip; simulated ones always do."""
        calibration = self.active_camera_calibration
        measured = calibration is not None and calibration.clip_number_dn is not None
        told = self.sensor.clip_level_dn is not None or measured
        return told or self.devices.camera.is_simulated

    @property
    def is_real(self) -> bool:
        """Whether any device of a run is real; such a run follows the wall clock."""
        return not all(table.is_simulated for table in self.devices.run_devices.values())


def read_bench(path: Path) -> BenchFile:
    """Read a bench; resolve_included_files() tells which files it may include, and errors."""
    return resolve_included_files(read_file(path, dict[str, Any]), path, BenchFile)


def read_camera_file(path: Path) -> CameraFile:
    """Read a camera's description, alone or as part of a bench, in the same way as read_bench()."""
    data = read_file(path, dict[str, Any])
    return resolve_included_files(data, path, BenchFile if "devices" in data else CameraFile)


def read_camera(path: Path | None) -> Camera:
    """Return the calibrated camera that a camera file or a bench file describes.

    If `path` is None, the camera is that of the bundled virtual bench. Raises the UserErrors of
    read_bench(), and another if the calibration belongs to another panel.
    """
    return read_camera_file(bundled_path("bench.toml") if path is None else path).build_camera()
