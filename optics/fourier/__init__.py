"""Fourier transforms between two sampled planes, each computed by whichever method is cheapest.

All of them compute, to rounding or to an error that they state,

    F(u, v) = sum over (y, x) of f(y, x) exp(-2 pi i (y u + x v) / scale)

between two planes. For a pupil and its focal plane, scale is wavelength times distance (Goodman,
Introduction to Fourier Optics; thesis Eq. 2.13 and 3.1). They share one interface: call, adjoint,
bytes, predicted processor time and derivatives. Phases are reduced to one turn in float64 before
they are stored in single precision.
"""

from optics.fourier.fft import fast_fft_length, fft, irfft2, rfft, rfft2, rfft_column_weights
from optics.fourier.gridded import GriddedTransform
from optics.fourier.nonuniform import NonuniformTransform
from optics.fourier.separable import ChirpTransform, CommensurateTransform
from optics.fourier.transform import FourierGeometry, Transform, unit_phasor
from optics.fourier.transform_choice import MatrixTransform, plan_transform, valid_transforms

__all__ = [
    "ChirpTransform",
    "CommensurateTransform",
    "FourierGeometry",
    "GriddedTransform",
    "MatrixTransform",
    "NonuniformTransform",
    "Transform",
    "fast_fft_length",
    "fft",
    "irfft2",
    "plan_transform",
    "rfft",
    "rfft2",
    "rfft_column_weights",
    "unit_phasor",
    "valid_transforms",
]
