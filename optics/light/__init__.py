"""Sources, their spectra and flicker, the filter's band, and the light that reaches a sensor."""

from optics.light.bands import Band
from optics.light.sources import blackbody, broadband, halogen, monochromatic, tabulated
from optics.light.spectrum import Spectrum
from optics.light.throughput import PLANCK, SPEED_OF_LIGHT, electron_rate
from optics.light.waveform import Waveform

__all__ = [
    "PLANCK",
    "SPEED_OF_LIGHT",
    "Band",
    "Spectrum",
    "Waveform",
    "blackbody",
    "broadband",
    "electron_rate",
    "halogen",
    "monochromatic",
    "tabulated",
]
