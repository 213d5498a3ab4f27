"""Undoing a blur that nobody knows: the kernel, how surely, and the picture without it."""

from optics.deconvolution.blind.estimate import blind_deconvolution as blind_deconvolution
from optics.deconvolution.blind.estimate import find_kernel as find_kernel
from optics.deconvolution.blind.found import Deblurred as Deblurred
from optics.deconvolution.blind.found import Kernel as Kernel
