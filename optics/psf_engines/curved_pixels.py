"""Compute the Fourier integral over panel pixels inside which the wave is curved."""

from __future__ import annotations

import math

import torch

from optics.accuracy import MachineSpeed
from optics.fourier import FourierGeometry, MatrixTransform, unit_phasor
from optics.fourier.transform import PASSES_PER_PHASOR
from optics.gauss_legendre import gauss_legendre
from optics.psf_engines.pixel_integral import PixelIntegralTransform
from optics.psf_engines.pixel_wave import full_precision_nodes


class CurvedPixelTransform(MatrixTransform, PixelIntegralTransform):
    """Computes the Fourier integral over square panel pixels under a quadratic phase.

    For pixels of constant phase, the integral is the sum over their centres times one envelope.
    Defocus bends the wave differently inside each pixel. The curvature is the same along both axes
    and the pixel is a square, so the integral still factors into rows and columns. Each factor is a
    matrix:

        K(u, x) = mean over |d| < side / 2 of exp(i curvature (x + d)² - 2 pi i u (x + d) / scale)

    curvature: radians per square metre. side: of a pixel's active square, metres.
    """

    name = "matrix DFT with curved pixels"

    def __init__(
        self, geometry: FourierGeometry, dtype: torch.dtype, curvature: float, side: float
    ) -> None:
        super().__init__(geometry, dtype)
        self._curvature, self._side = curvature, side

    def node_count(self, axis: int) -> int:
        """Return the number of quadrature nodes that the PSF engine takes in a curved panel pixel.

        It suffices for the pixel and the sample with the largest change of phase.
        """
        x, u = (p.coordinates(axis).abs().max() for p in (self.geometry.pupil, self.geometry.image))
        half = self._side / 2
        bend = abs(self._curvature) * (2 * float(x) * half + half**2)
        tilt = 2 * math.pi * float(u) * half / self.geometry.scale
        return full_precision_nodes(bend + tilt)

    def _kernel(self, axis: int) -> torch.Tensor:
        g = self.geometry
        u, x = g.image.coordinates(axis), g.pupil.coordinates(axis)
        points, weights = gauss_legendre(self.node_count(axis))
        d = torch.from_numpy(points * self._side / 2)
        weight = torch.from_numpy(weights / 2)
        turns = self._curvature / (2 * math.pi) * (x[:, None] + d) ** 2
        bent = unit_phasor(turns, torch.complex128) * weight
        tilted = unit_phasor(-torch.outer(u, d) / g.scale, torch.complex128)
        centres = unit_phasor(-torch.outer(u, x) / g.scale, torch.complex128)
        return (centres * (tilted @ bent.mT)).to(self.dtype)

    def mean_squared_kernel(self, axis: int) -> torch.Tensor:
        """Return the mean of |K|² over a PSF's panel pixels along an axis, float64, by sample.

        It is how much of a pattern's light a sample gets on average.
        """
        kernel = self._kernels(torch.device("cpu"))[axis].to(torch.complex128)
        return (kernel.real**2 + kernel.imag**2).mean(1)

    def planning_seconds(self, speed: MachineSpeed) -> float:
        """Predict the processor seconds of computing the matrices for a PSF's curved pixels."""
        seconds = 0.0
        for axis in (0, 1):
            n, m = self.geometry.pupil.shape[axis], self.geometry.image.shape[axis]
            nodes = self.node_count(axis)
            phasors = (m * n + nodes * (m + n)) * PASSES_PER_PHASOR * speed.touch
            seconds += phasors + 4 * m * n * nodes * speed.multiply_add * speed.double
        return seconds
