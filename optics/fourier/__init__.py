"""The Fourier integral from one plane to another, by whichever method is cheapest.

Every transform computes, to rounding or to an error that it states,

    F(u, v) = sum over (y, x) of f(y, x) exp(-2 pi i (y u + x v) / scale)

between two planes; for a pupil and its focal plane, scale is wavelength times
distance (Goodman, Introduction to Fourier Optics; thesis Eq. 2.13 and 3.1). All of
them share one contract: call, adjoint, bytes, predicted processor time, derivatives.
Phases are reduced to one turn in float64 before they are stored in single precision.
"""

from optics.fourier.chirp import ChirpTransform as ChirpTransform
from optics.fourier.commensurate import CommensurateTransform as CommensurateTransform
from optics.fourier.fft import fast_fft_length as fast_fft_length
from optics.fourier.fft import fft as fft
from optics.fourier.fft import irfft2 as irfft2
from optics.fourier.fft import rfft as rfft
from optics.fourier.fft import rfft2 as rfft2
from optics.fourier.fft import rfft_column_weights as rfft_column_weights
from optics.fourier.geometry import FourierGeometry as FourierGeometry
from optics.fourier.geometry import unit_phasor as unit_phasor
from optics.fourier.gridded import GriddedTransform as GriddedTransform
from optics.fourier.matrix import MatrixTransform as MatrixTransform
from optics.fourier.nonuniform import NonuniformTransform as NonuniformTransform
from optics.fourier.transform import Transform as Transform
from optics.fourier.transform_choice import plan_transform as plan_transform
from optics.fourier.transform_choice import valid_transforms as valid_transforms
