"""The bench file: which devices, bound to which description of a camera."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pydantic import Field

from labapp.files.camera_file import CameraFile, resolve_included_files
from labapp.files.reading import FileModel, bundled_path, read_file
from optics.camera import Camera


class DeviceTable(FileModel):
    """A device: the name of its entry point, and the options that it is opened with.

    own_process: whether its driver runs in a process of its own, which can be killed when
    a library hangs. simulated: whether what is behind its wire is, as `labapp virtual-bench
    serve` says of what it serves; the driver can't know.
    """

    driver: str
    options: dict[str, Any] = Field(default_factory=dict)
    own_process: bool = False
    simulated: bool = False

    @property
    def is_simulated(self) -> bool:
        return self.driver.startswith("simulated-")

    @property
    def is_exclusive(self) -> bool:
        """Whether only one application can have it: neither made up nor a person."""
        return not self.is_simulated and self.driver != "manual-targets"


class DevicesTable(FileModel):
    """The devices by the names that the bench has for them.

    A run takes all but the spectroradiometer, which stands beside, and not on every bench.
    """

    slm: DeviceTable
    filter: DeviceTable
    camera: DeviceTable
    targets: DeviceTable
    spectroradiometer: DeviceTable | None = None

    @property
    def tables(self) -> dict[str, DeviceTable]:
        """All that there are."""
        named = {name: getattr(self, name) for name in DevicesTable.model_fields}
        return {name: table for name, table in named.items() if table is not None}

    @property
    def run_devices(self) -> dict[str, DeviceTable]:
        """Those that every run needs."""
        return {name: table for name, table in self.tables.items() if name != "spectroradiometer"}


class BenchFile(CameraFile):
    """A bench: devices bound to a camera description."""

    devices: DevicesTable

    @property
    def is_virtual(self) -> bool:
        """Whether a device is simulated, so that there must be a scene before it."""
        return any(table.is_simulated for table in self.devices.tables.values())

    @property
    def is_real(self) -> bool:
        """Whether a device of its runs is real, so that their time is the wall's."""
        return not all(table.is_simulated for table in self.devices.run_devices.values())


def read_bench(path: Path) -> BenchFile:
    """A bench file; see resolve_included_files() for the files that it may name, and for errors."""
    return resolve_included_files(read_file(path, dict[str, Any]), path, BenchFile)


def read_camera_file(path: Path) -> CameraFile:
    """A camera file, or a bench file. As read_bench()."""
    data = read_file(path, dict[str, Any])
    return resolve_included_files(data, path, BenchFile if "devices" in data else CameraFile)


def read_camera(path: Path | None) -> Camera:
    """The camera of a camera file or a bench file, calibrated; None: of the virtual bench.

    UserError as read_bench(), and for a calibration of another panel.
    """
    return read_camera_file(bundled_path("bench.toml") if path is None else path).build_camera()
