"""Blind deconvolution, which estimates an unknown blur kernel and restores the photograph."""

from optics.deconvolution.blind.estimate import blind_deconvolution, find_kernel
from optics.deconvolution.blind.kernel_estimate import BlindRestoration, KernelEstimate

__all__ = ["BlindRestoration", "KernelEstimate", "blind_deconvolution", "find_kernel"]
