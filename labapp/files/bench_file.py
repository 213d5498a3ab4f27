"""The bench file: which devices, bound to which description of a camera."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import ConfigDict, Field, model_validator

from labapp.errors import UserError
from labapp.files.calibration_file import CalibrationFile
from labapp.files.panel_file import PanelTable, with_panel
from labapp.files.reading import FileModel, read_file, validate
from optics.camera import Camera, Lens, Sensor

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Share = Annotated[float, Field(ge=0, le=1)]
Count = Annotated[int, Field(ge=1, le=100_000)]


class LensTable(FileModel):
    focal_length_mm: Positive
    f_number: Positive
    focus_distance_m: Annotated[float, Field(gt=0)]

    @model_validator(mode="after")
    def _focus_in_front(self) -> LensTable:
        if self.focus_distance_m * 1e3 <= self.focal_length_mm:
            raise ValueError(
                f"focus_distance_m must be more than the focal length, {self.focal_length_mm:g} mm"
            )
        return self

    def build(self) -> Lens:
        return Lens(self.focal_length_mm * 1e-3, self.f_number, self.focus_distance_m)


class SensorTable(FileModel):
    """The sensor, in the quantities of EMVA 1288."""

    model: str
    width: Count
    height: Count
    pitch_um: Positive
    bits: Annotated[int, Field(ge=1, le=16)]
    full_well_electrons: Positive
    gain_electrons_per_dn: Positive
    read_noise_electrons: Annotated[float, Field(ge=0)]
    dark_current_electrons_per_s: Annotated[float, Field(ge=0)]
    black_level_dn: Annotated[float, Field(ge=0)]
    quantum_efficiency: Annotated[float, Field(gt=0, le=1)]
    shortest_exposure_us: Positive
    longest_exposure_s: Positive

    def build(self) -> Sensor:
        return Sensor(
            shape=(self.height, self.width),
            pitch=self.pitch_um * 1e-6,
            bits=self.bits,
            full_well=self.full_well_electrons,
            gain=self.gain_electrons_per_dn,
            read_noise=self.read_noise_electrons,
            dark_current=self.dark_current_electrons_per_s,
            black_level=self.black_level_dn,
            quantum_efficiency=self.quantum_efficiency,
            exposure_range=(self.shortest_exposure_us * 1e-6, self.longest_exposure_s),
        )


class DeviceTable(FileModel):
    """A device: the name of its entry point, and the options that it is opened with.

    own_process: whether its driver runs in a process of its own, which can be killed when
    a library hangs.
    """

    driver: str
    options: dict[str, Any] = Field(default_factory=dict)
    own_process: bool = False

    @property
    def is_simulated(self) -> bool:
        return self.driver.startswith("simulated-")

    @property
    def is_exclusive(self) -> bool:
        """Whether only one application can have it: neither made up nor a person."""
        return not self.is_simulated and self.driver != "manual-targets"


class DevicesTable(FileModel):
    slm: DeviceTable
    filter: DeviceTable
    camera: DeviceTable
    targets: DeviceTable

    @property
    def tables(self) -> dict[str, DeviceTable]:
        """The devices by the names that the bench has for them."""
        return {name: getattr(self, name) for name in DevicesTable.model_fields}


class BenchFile(FileModel):
    """A bench: devices bound to a camera description.

    calibration: a file that `labapp calibrate` wrote, or what is in it; what it found counts
    more than the description.
    """

    version: Literal[1]
    name: str
    transmission: Share
    panel: PanelTable
    lens: LensTable
    sensor: SensorTable
    devices: DevicesTable
    calibration: str | CalibrationFile | None = None

    @property
    def is_virtual(self) -> bool:
        """Whether a device is simulated, so that there must be a scene before it."""
        return any(table.is_simulated for table in self.devices.tables.values())

    @property
    def is_real(self) -> bool:
        """Whether a device is real, so that time is the wall's."""
        return not all(table.is_simulated for table in self.devices.tables.values())

    @property
    def in_force(self) -> CalibrationFile | None:
        """The calibration that counts; UserError if its file can't be read."""
        if isinstance(self.calibration, str):
            return read_file(Path(self.calibration), CalibrationFile)
        return self.calibration

    def uncalibrated(self) -> BenchFile:
        """The bench as it is described."""
        return self.model_copy(update={"calibration": None})

    def build_camera(self) -> Camera:
        """The camera as it is described, and calibrated; UserError if the two don't fit."""
        described = Camera(
            self.panel.build(), self.lens.build(), self.sensor.build(), self.transmission
        )
        calibration = self.in_force
        if calibration is None:
            return described
        try:
            return calibration.applied_to(described)
        except ValueError as error:
            raise UserError(
                f"the calibration of {calibration.date:%Y-%m-%d} is not of this panel: {error}. "
                "Calibrate this bench, or remove the key 'calibration' from its file."
            ) from error


class _Unread(FileModel):
    """A file's plain data."""

    model_config = ConfigDict(extra="allow")


def read_bench(path: Path) -> BenchFile:
    """A bench file; its panel may be a file of its own, as in `panel = { file = "mine.toml" }`.

    The name of a bundled panel does as well (see labapp.files.panel_file), and keys beside
    `file` count more than the file's. The panel's own files are looked for beside the file that
    names them; the answer holds what is in them, or absolute paths of pictures, so that a
    record of it can be read again. So it is with the file of a calibration. UserError names
    file, key, value and rule.
    """
    folder = path.resolve().parent
    data = with_panel(read_file(path, _Unread).model_dump(), folder, str(path))
    bench = validate(data, BenchFile, str(path))
    found: dict[str, Any] = {"panel": bench.panel.found_in(folder)}
    if isinstance(bench.calibration, str):
        found["calibration"] = read_file(folder / bench.calibration, CalibrationFile)
    return bench.model_copy(update=found)
