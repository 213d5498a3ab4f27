"""The point spread function: what the light of a point becomes on the sensor.

A PSFOperator takes the cheapest engine that keeps its tolerance: `axial` for round lenses,
`scattered_nodes` for any smooth wave in any stop, `sampled` where a percent will do, and
`panel_engine` behind a modulator (optics.point). Where the modulator stands apart from the lens,
the engines are those of optics.chain.
"""

from optics.chain import CHAIN_METHODS as CHAIN_METHODS
from optics.chain import LightBudget as LightBudget
from optics.point.panel_engine import PANEL_METHODS as PANEL_METHODS
from optics.psf.behind_modulator import modulated_psf as modulated_psf
from optics.psf.engine_choice import METHODS as METHODS
from optics.psf.operator import PSFOperator as PSFOperator
from optics.psf.operator import nyquist_samples_per_pixel as nyquist_samples_per_pixel
from optics.psf.operator import psf as psf
from optics.psf.polychromatic import PolychromaticPSF as PolychromaticPSF
from optics.psf.stack import PSFStack as PSFStack
