"""The point spread function: what the light of a point becomes on the sensor.

A PSFOperator takes the cheapest engine that keeps its tolerance: `axial` for round lenses,
`scattered` for any smooth wave in any stop, `sampled` where a percent will do, and `panel`
behind a modulator (optics.point). Where the modulator stands apart from the lens, the engines are
those of optics.chain.
"""

from optics.chain import CHAIN_METHODS as CHAIN_METHODS
from optics.chain import Light as Light
from optics.point.panel import TRANSFORMS as TRANSFORMS
from optics.psf.choice import METHODS as METHODS
from optics.psf.modulated import modulated_psf as modulated_psf
from optics.psf.operator import PSFOperator as PSFOperator
from optics.psf.operator import nyquist_samples as nyquist_samples
from optics.psf.operator import psf as psf
from optics.psf.polychromatic import PolychromaticPSF as PolychromaticPSF
from optics.psf.stack import PSFStack as PSFStack
