"""Undoing a blur that nobody knows: the kernel, how surely, and the picture without it."""

from optics.deconvolution.blind.estimate import blind_deconvolution, find_kernel
from optics.deconvolution.blind.kernel_estimate import BlindRestoration, KernelEstimate

__all__ = ["BlindRestoration", "KernelEstimate", "blind_deconvolution", "find_kernel"]
