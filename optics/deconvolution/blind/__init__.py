"""Undoing a blur that nobody knows: the kernel, how surely, and the picture without it."""

from optics.deconvolution.blind.estimate import blind_deconvolution as blind_deconvolution
from optics.deconvolution.blind.estimate import find_kernel as find_kernel
from optics.deconvolution.blind.kernel_estimate import BlindRestoration as BlindRestoration
from optics.deconvolution.blind.kernel_estimate import KernelEstimate as KernelEstimate
