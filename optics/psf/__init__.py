"""Compute point spread functions: the light of a point source on the sensor.

A PSFOperator selects the cheapest engine that keeps its tolerance: `axial` for round lenses,
`scattered` for any smooth wave in any stop, `sampled` for large tolerances, and
`optics.psf.panel_engine` behind a modulator. If the modulator stands apart from the lens, the
engines are those of `optics.psf.chain_choice`.
"""

from optics.psf.behind_modulator import modulated_psf
from optics.psf.chain_choice import CHAIN_METHODS
from optics.psf.choice import METHODS
from optics.psf.many import PolychromaticPSF, PSFStack, psf
from optics.psf.operator import PSFOperator
from optics.psf.panel_methods import PANEL_METHODS
from optics.psf.request import nyquist_samples_per_pixel
from optics.psf.symmetry import SYMMETRIES, expand_phase, symmetric_shape

__all__ = [
    "CHAIN_METHODS",
    "METHODS",
    "PANEL_METHODS",
    "SYMMETRIES",
    "PSFOperator",
    "PSFStack",
    "PolychromaticPSF",
    "expand_phase",
    "modulated_psf",
    "nyquist_samples_per_pixel",
    "psf",
    "symmetric_shape",
]
