"""The bench file: which devices, bound to which description of a camera."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from labapp.files.reading import FileModel
from optics.camera import Camera, Lens, Panel, Sensor

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Share = Annotated[float, Field(ge=0, le=1)]
Count = Annotated[int, Field(ge=1, le=100_000)]


class PanelTable(FileModel):
    """The modulator. max_phase_pi: wavelength in nm to highest phase in units of pi."""

    model: str
    width: Count
    height: Count
    pitch_um: Positive
    fill_factor: Annotated[float, Field(gt=0, le=1)]
    levels: Annotated[int, Field(ge=2, le=256)] = 256
    unmodulated: Share
    reflectivity: Share
    settling_ms: Annotated[float, Field(ge=0)]
    max_phase_pi: dict[Annotated[str, Field(pattern=r"^\d+(\.\d+)?$")], Positive]

    def build(self) -> Panel:
        return Panel(
            shape=(self.height, self.width),
            pitch=self.pitch_um * 1e-6,
            fill_factor=self.fill_factor,
            levels=self.levels,
            max_phase=tuple((float(nm) * 1e-9, p * math.pi) for nm, p in self.max_phase_pi.items()),
            unmodulated=self.unmodulated,
            reflectivity=self.reflectivity,
            settling=self.settling_ms * 1e-3,
        )


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
    """A bench: devices bound to a camera description."""

    version: Literal[1]
    name: str
    transmission: Share
    panel: PanelTable
    lens: LensTable
    sensor: SensorTable
    devices: DevicesTable

    @property
    def is_virtual(self) -> bool:
        """Whether a device is simulated, so that there must be a scene before it."""
        return any(table.is_simulated for table in self.devices.tables.values())

    @property
    def is_real(self) -> bool:
        """Whether a device is real, so that time is the wall's."""
        return not all(table.is_simulated for table in self.devices.tables.values())

    def build_camera(self) -> Camera:
        return Camera(self.panel.build(), self.lens.build(), self.sensor.build(), self.transmission)
