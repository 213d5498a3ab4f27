"""Describe light sources, their spectra and flicker, and the band of a spectral filter."""

from optics.light.bands import Band
from optics.light.spectrum import (
    Spectrum,
    blackbody,
    broadband,
    halogen,
    lamp_from_table,
    monochromatic,
)
from optics.light.waveform import Waveform

__all__ = [
    "Band",
    "Spectrum",
    "Waveform",
    "blackbody",
    "broadband",
    "halogen",
    "lamp_from_table",
    "monochromatic",
]
