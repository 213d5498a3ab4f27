"""Reflectances in a scene: a name, a number, a colour, or a measured spectrum."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator

from labapp.files.reading import FileModel
from labapp.files.spectrum_file import bundled_spectra, read_spectrum
from optics.light import Spectrum
from simulator.scene import basis_of, mix_reflectances, primaries
from simulator.scene.colours import Basis, extend_to_silicon_range

PAINTS: dict[str, tuple[float, float, float]] = {
    "white": (0.9, 0.9, 0.9),
    "grey": (0.18, 0.18, 0.18),
    "black": (0.03, 0.03, 0.03),
    "red": (0.58, 0.03, 0.03),
    "green": (0.05, 0.36, 0.08),
    "blue": (0.02, 0.10, 0.45),
    "yellow": (0.85, 0.62, 0.03),
    "orange": (0.80, 0.26, 0.02),
}
"""Approximate linear red, green and blue of toy plastic, by name."""


def _validate_reflectance(value: Any) -> Any:
    """Check a reflectance before pydantic tries each kind, for one error instead of four."""
    shares = value if isinstance(value, list | tuple) else [value]
    if isinstance(value, str):
        if value not in PAINTS:
            raise ValueError(f"choose among {', '.join(PAINTS)}, or give a number or three")
    elif not isinstance(value, dict | SpectrumTable) and not (
        len(shares) in (1, 3) and all(isinstance(s, int | float) and 0 <= s <= 1 for s in shares)
    ):
        raise ValueError("give a name, a share from 0 to 1, three of them, or a table with a file")
    return value


class SpectrumTable(FileModel):
    """A measured reflectance, 0 to 1: a CSV file of wavelengths in nm and values."""

    file: str
    column: str | None = None


Reflectance = Annotated[
    float | tuple[float, float, float] | str | SpectrumTable, BeforeValidator(_validate_reflectance)
]
"""A constant reflectance; one for linear red, green and blue; a name; or a measured spectrum."""


def reflectance_spectrum(surface: Reflectance) -> Spectrum:
    """Return a reflectance as a spectrum; UserError if a measured one can't be read."""
    if isinstance(surface, SpectrumTable):
        return extend_to_silicon_range(read_spectrum(Path(surface.file), surface.column))
    if isinstance(surface, str):
        surface = PAINTS[surface]
    if isinstance(surface, tuple):
        return mix_reflectances(mallett_basis(), surface)
    return Spectrum.flat(surface)


def mallett_basis() -> Basis:
    """Read the bundled reflectance spectra of sRGB's primaries, Mallett and Yuksel (2019)."""
    table = bundled_spectra("mallett2019")
    return basis_of(table["red"], table["green"], table["blue"])


def reflectance_basis(spectra: Literal["mallett", "primaries"]) -> Basis:
    """Return the basis of spectra by which a photograph's colours become reflectances."""
    return mallett_basis() if spectra == "mallett" else primaries()
