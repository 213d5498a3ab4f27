"""The light in which a spectral cube is shown: a standard illuminant, or a measured spectrum."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from labapp.common.colour_library import colour_library
from labapp.common.errors import UserError, suggest_spelling
from labapp.files.spectrum_file import read_spectrum
from optics.light import Spectrum


@dataclass(frozen=True)
class ViewingLight:
    """Light in which a cube is shown: its name, and its power by wavelength on any scale."""

    name: str
    spectrum: Spectrum


def find_light(name: str) -> ViewingLight:
    """Find the light in which colours are to be shown; UserError if there is none of that name.

    name: of a CIE illuminant, such as D65 or A, or the path of a CSV file with wavelengths in
        nanometres and power.
    """
    known = colour_library().SDS_ILLUMINANTS
    if name in known:
        table = known[name]
        metres = tuple(float(nm) / 1e9 for nm in table.wavelengths)
        return ViewingLight(name, Spectrum(metres, tuple(map(float, table.values))))
    path = Path(name)
    if path.is_file():
        return ViewingLight(path.stem, read_spectrum(path))
    raise UserError(
        f"--light {name}: is neither a CIE illuminant nor a file. "
        f"{suggest_spelling(name, list(known))}Take D65 (daylight), D50, A (halogen lamps), E "
        "(equal energy), or a CSV file of wavelengths in nm and power."
    )
