"""The point spread function: what the light of a point becomes on the sensor.

A PSFOperator takes the cheapest engine that keeps its tolerance: `axial` for round lenses,
`scattered` for any smooth wave in any stop, `sampled` where a percent will do, and `panel`
behind a modulator. Where the modulator stands apart from the lens, `shadow` while the two may
count as one plane, `chain_grid` with FFTs from plane to plane, and `chain_nodes` for many digits.
"""

from optics.psf.choice import CHAIN_METHODS as CHAIN_METHODS
from optics.psf.choice import METHODS as METHODS
from optics.psf.modulated import modulated_psf as modulated_psf
from optics.psf.operator import PSFOperator as PSFOperator
from optics.psf.operator import nyquist_samples as nyquist_samples
from optics.psf.operator import psf as psf
from optics.psf.panel import TRANSFORMS as TRANSFORMS
from optics.psf.passed import Light as Light
from optics.psf.polychromatic import PolychromaticPSF as PolychromaticPSF
from optics.psf.stack import PSFStack as PSFStack
