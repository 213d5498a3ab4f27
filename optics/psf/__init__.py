"""Compute point spread functions: the light of a point source on the sensor.

A PSFOperator selects the cheapest engine that keeps its tolerance: `axial` for round lenses,
`scattered_nodes` for any smooth wave in any stop, `sampled` for large tolerances, and
`optics.psf_engines.panel_engine` behind a modulator. If the modulator stands apart from the lens,
the engines are those of optics.chain.
"""

from optics.chain import CHAIN_METHODS
from optics.psf.behind_modulator import modulated_psf
from optics.psf.engine_choice import METHODS
from optics.psf.nyquist import nyquist_samples_per_pixel
from optics.psf.operator import PSFOperator
from optics.psf.pattern_symmetry import SYMMETRIES, expand_phase, symmetric_shape
from optics.psf.polychromatic import PolychromaticPSF
from optics.psf.single_psf import psf
from optics.psf.stack import PSFStack
from optics.psf_engines.panel_engine import PANEL_METHODS

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
