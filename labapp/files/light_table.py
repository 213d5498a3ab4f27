"""A scene's table [lights]: lamps, their spectra and their flicker."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, model_validator

from labapp.files.quantities import Finite, Nanometres, Positive
from labapp.files.reading import FileModel
from labapp.files.spectrum_file import read_spectrum
from optics.light import (
    Spectrum,
    Waveform,
    blackbody,
    broadband,
    halogen,
    lamp_from_table,
    monochromatic,
)
from optics.light.spectrum import HALOGEN_TEMPERATURE

Temperature = Annotated[float, Field(ge=1000, allow_inf_nan=False)]


@dataclass(frozen=True)
class Lamp:
    """A lamp: relative spectrum, or None for even light, and its flicker, or None for steady."""

    spectrum: Spectrum | None
    waveform: Waveform | None = None


class FlickerTable(FileModel):
    """A lamp's flicker: a periodic change of its light with time.

    depth is the largest deviation from the mean, as a share of the mean. duty is the share of a
    period for which a square wave is bright.
    """

    shape: Literal["sine", "square", "filament"] = "filament"
    frequency_hz: Positive = 100.0
    depth: Annotated[float, Field(ge=0, le=1)]
    phase_deg: Finite = 0.0
    duty: Annotated[float, Field(gt=0, lt=1)] = 0.5

    def build(self) -> Waveform:
        phase = math.radians(self.phase_deg % 360)
        return Waveform(self.shape, self.frequency_hz, self.depth, phase, self.duty)


class _LampTableBase(FileModel):
    flicker: FlickerTable | None = None

    def spectrum(self) -> Spectrum:
        """Return the relative spectral radiance."""
        raise NotImplementedError

    def build(self) -> Lamp:
        """Return the lamp; UserError if its measured spectrum can't be read."""
        return Lamp(self.spectrum(), self.flicker.build() if self.flicker else None)


class HalogenTable(_LampTableBase):
    """A photographic halogen lamp of a colour temperature in kelvin."""

    kind: Literal["halogen"]
    temperature_k: Temperature = HALOGEN_TEMPERATURE

    def spectrum(self) -> Spectrum:
        return halogen(self.temperature_k)


class BlackbodyTable(_LampTableBase):
    kind: Literal["blackbody"]
    temperature_k: Temperature

    def spectrum(self) -> Spectrum:
        return blackbody(self.temperature_k)


class BroadbandTable(_LampTableBase):
    """A lamp of constant spectral radiance between two wavelengths."""

    kind: Literal["broadband"]
    range_nm: tuple[Nanometres, Nanometres] = (300.0, 1100.0)

    @model_validator(mode="after")
    def _rises(self) -> BroadbandTable:
        if not self.range_nm[0] < self.range_nm[1]:
            raise ValueError("range_nm must have the shorter wavelength first")
        return self

    def spectrum(self) -> Spectrum:
        low, high = self.range_nm
        return broadband(low / 1e9, high / 1e9)


class MonochromaticTable(_LampTableBase):
    """A lamp of one spectral line; width_nm is its full width at half maximum."""

    kind: Literal["monochromatic"]
    wavelength_nm: Nanometres
    width_nm: Positive = 1.0

    @model_validator(mode="after")
    def _is_narrow(self) -> MonochromaticTable:
        self.spectrum()
        return self

    def spectrum(self) -> Spectrum:
        return monochromatic(self.wavelength_nm / 1e9, self.width_nm / 1e9)


class LampTable(_LampTableBase):
    """A measured lamp: a CSV file of wavelengths in nm and relative radiances."""

    kind: Literal["table"]
    file: str
    column: str | None = None

    def spectrum(self) -> Spectrum:
        return lamp_from_table(read_spectrum(Path(self.file), self.column))


LightTable = Annotated[
    HalogenTable | BlackbodyTable | BroadbandTable | MonochromaticTable | LampTable,
    Field(discriminator="kind"),
]
