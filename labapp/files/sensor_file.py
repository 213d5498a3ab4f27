"""The sensor in a bench or camera file, or in a file of its own that several benches share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import Field, model_validator

from labapp.common.errors import UserError
from labapp.files.file_lookup import find_part_file, split_part
from labapp.files.quantities import Amount, Finite, NanometresText, Positive
from labapp.files.reading import FileModel, read_file, validate
from labapp.files.spectrum_file import read_spectrum
from optics.camera import Sensor
from optics.light import Spectrum
from optics.sensor import Mosaic

Efficiency = Annotated[float, Field(gt=0, le=1)]
Millionths = Annotated[float, Field(ge=0, le=1e6)]
Count = Annotated[int, Field(ge=1, le=100_000)]
InlineCurve = dict[NanometresText, Annotated[float, Field(ge=0, le=1)]]


class CurveFile(FileModel):
    """A curve of quantum efficiency in a CSV file: wavelengths in nm, and electrons per photon."""

    file: str
    column: str | None = None

    def read_curve(self, folder: Path) -> InlineCurve:
        """Read the curve from its place in `folder`: electrons per photon by nm as text."""
        path = folder / self.file
        curve = read_spectrum(path, self.column)
        if curve.peak > 1:
            raise UserError(
                f"{path}: {curve.peak:g} electrons a photon can't be. Give shares, 0 to 1."
            )
        return {
            f"{wavelength * 1e9:.6g}": value
            for wavelength, value in zip(curve.wavelengths, curve.values, strict=True)
        }


Curve = InlineCurve | CurveFile


class ColourTable(FileModel):
    """Colour filters on a sensor's pixels.

    pattern is a list of rows of letters, which repeats over the sensor from its first pixel on.
    efficiency is the quantum efficiency of each letter's pixels by wavelength, filter included.
    """

    pattern: Annotated[list[Annotated[str, Field(min_length=1)]], Field(min_length=1)]
    efficiency: dict[str, Curve]

    def build(self) -> Mosaic:
        return Mosaic(
            tuple(self.pattern), {name: _spectrum(one) for name, one in self.efficiency.items()}
        )

    def resolve_files(self, folder: Path) -> ColourTable:
        found = {
            name: one.read_curve(folder) if isinstance(one, CurveFile) else one
            for name, one in self.efficiency.items()
        }
        return self.model_copy(update={"efficiency": found})


class SensorTable(FileModel):
    """The sensor in a camera file, by the quantities of EMVA 1288.

    quantum_efficiency is a number for all wavelengths, or a table of shares by wavelength in nm,
    linear between them and 0 beyond, or a file of such a table. A colour sensor has a table
    `colour` instead. bits are those of the numbers that the camera sends, and clip_level_dn the
    number at which its pixels clip, where that isn't the largest of so many bits; `labapp devices
    test camera` measures it. crosstalk_percent is the share of a pixel's electrons that each
    neighbour in row and column collects. dust is a list of specks on the cover glass, [y, x,
    diameter] in µm from the sensor's middle, and dust_distance_um the glass over its index and the
    air from there to the pixels. The defaults switch a feature off; optics.camera.Sensor describes
    all of them.
    """

    model: str
    width: Count
    height: Count
    pitch_um: Positive
    bits: Annotated[int, Field(ge=1, le=16)]
    clip_level_dn: Annotated[int, Field(ge=1, le=65535)] | None = None
    full_well_electrons: Positive
    gain_electrons_per_dn: Positive
    read_noise_electrons: Amount
    dark_current_electrons_per_s: Amount
    black_level_dn: Amount
    quantum_efficiency: Efficiency | Curve | None = None
    shortest_exposure_us: Positive
    longest_exposure_s: Positive
    colour: ColourTable | None = None
    prnu_percent: Annotated[float, Field(ge=0, le=20)] = 0.0
    dsnu_electrons: Amount = 0.0
    dead_pixels_ppm: Millionths = 0.0
    hot_pixels_ppm: Millionths = 0.0
    hot_electrons_per_s: Amount = 0.0
    fixed_pattern_seed: Annotated[int, Field(ge=0, lt=2**63)] = 0
    shutter: Literal["global", "rolling"] = "global"
    line_time_us: Amount = 0.0
    crosstalk_percent: Annotated[float, Field(ge=0, le=25)] = 0.0
    dust: tuple[tuple[Finite, Finite, Positive], ...] = ()
    dust_distance_um: Amount = 0.0

    @model_validator(mode="after")
    def _validate_sensor(self) -> Self:
        if self.quantum_efficiency is None and self.colour is None:
            raise ValueError("quantum_efficiency is missing; add it, or a table 'colour'")
        if self.quantum_efficiency is not None and self.colour is not None:
            raise ValueError(
                "quantum_efficiency and a table 'colour' are given; the filters' curves are the "
                "efficiency: remove one of the two"
            )
        if self.has_all_curves:
            self.build()
        return self

    @property
    def pitch(self) -> float:
        """Distance of neighbouring pixels, metres."""
        return self.pitch_um * 1e-6

    @property
    def has_all_curves(self) -> bool:
        """Whether all curves of quantum efficiency are here, and none in a file of its own."""
        curves = [
            self.quantum_efficiency,
            *(self.colour.efficiency.values() if self.colour else ()),
        ]
        return not any(isinstance(one, CurveFile) for one in curves)

    def resolve_files(self, folder: Path) -> Self:
        """Return the table with its curves read from their files in `folder`."""
        efficiency = self.quantum_efficiency
        if isinstance(efficiency, CurveFile):
            efficiency = efficiency.read_curve(folder)
        colour = self.colour.resolve_files(folder) if self.colour else None
        return self.model_copy(update={"quantum_efficiency": efficiency, "colour": colour})

    def build(self) -> Sensor:
        """Return the sensor in SI units.

        Raises ValueError for impossible values or a curve that wasn't read.
        """
        efficiency = self.quantum_efficiency
        even = efficiency if isinstance(efficiency, float) else None
        curve = _spectrum(efficiency) if isinstance(efficiency, dict | CurveFile) else None
        colour = self.colour.build() if self.colour else None
        peaks = [one.peak for one in (colour.efficiencies.values() if colour else ())]
        return Sensor(
            shape=(self.height, self.width),
            pitch=self.pitch_um * 1e-6,
            bits=self.bits,
            full_well=self.full_well_electrons,
            gain=self.gain_electrons_per_dn,
            read_noise=self.read_noise_electrons,
            dark_current=self.dark_current_electrons_per_s,
            black_level=self.black_level_dn,
            # The peak of the curve is the single number that stands for it.
            quantum_efficiency=even or max([curve.peak] if curve else peaks),
            exposure_range=(self.shortest_exposure_us * 1e-6, self.longest_exposure_s),
            spectral_efficiency=curve,
            colour=colour,
            prnu=self.prnu_percent / 100,
            dsnu=self.dsnu_electrons,
            dead=self.dead_pixels_ppm * 1e-6,
            hot=self.hot_pixels_ppm * 1e-6,
            hot_current=self.hot_electrons_per_s,
            fixed_seed=self.fixed_pattern_seed,
            shutter=self.shutter,
            line_time=self.line_time_us * 1e-6,
            model=self.model,
            clip_level=self.clip_level_dn,
            crosstalk=self.crosstalk_percent / 100,
            dust=tuple((y * 1e-6, x * 1e-6, size * 1e-6) for y, x, size in self.dust),
            dust_distance=self.dust_distance_um * 1e-6,
        )


class SensorFile(SensorTable):
    """A sensor file, which several benches can share."""

    version: Literal[1]


def read_sensor(file: str, folder: Path) -> SensorTable:
    """Read a sensor, given a bundled name or a path relative to `folder`.

    Raises UserError with file, key, value and rule.
    """
    path = find_part_file("sensor", file, folder)
    found = read_file(path, SensorFile).resolve_files(path.parent)
    return validate(found.model_dump(exclude={"version"}), SensorTable, str(path))


def with_sensor(data: dict[str, Any], folder: Path, source: str) -> dict[str, Any]:
    """Return a bench's plain data with its sensor file included, if it names one.

    Keys beside `file` override those of the sensor file; quantum_efficiency and colour replace
    each other. `source` is the name of the bench file in errors.
    """
    found = split_part(data, "sensor", source)
    if found is None:
        return data
    file, own = found
    given = read_sensor(file, folder).model_dump()
    if "colour" in own:
        given["quantum_efficiency"] = None
    if "quantum_efficiency" in own:
        given["colour"] = None
    return data | {"sensor": given | own}


def require_monochrome_sensor(sensor: Sensor, task: str) -> None:
    """Raise UserError if a sensor has colour filters; `task` names what can't use them."""
    if sensor.colour is not None:
        raise UserError(
            f"{task}: measures light of one wavelength on neighbouring pixels, and the bench's "
            f"sensor has colour filters, {' '.join(sensor.colour.pattern)}. Take a bench with a "
            "monochrome sensor; labapp reconstruct and labapp report restore records in colour."
        )


def _spectrum(curve: Curve) -> Spectrum:
    if isinstance(curve, CurveFile):
        raise ValueError(f"the curve in {curve.file!r} has not been read")
    nodes = sorted((float(nm) / 1e9, value) for nm, value in curve.items())
    return Spectrum(tuple(nm for nm, _ in nodes), tuple(value for _, value in nodes))
