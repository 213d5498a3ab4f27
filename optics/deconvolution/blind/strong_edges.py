"""Estimation of a picture with few strong edges, and of the kernel that blurs it."""

from __future__ import annotations

import torch

from optics.deconvolution.blind.gradient_statistics import gradients
from optics.deconvolution.blind.quadratic import (
    fast_period,
    least_squares_problem,
    minimise_nonnegative,
    padded_spectrum,
)
from optics.deconvolution.border import extend_periodically
from optics.deconvolution.derivatives import laplacian_spectrum
from optics.fourier import irfft2, rfft2
from optics.operators.blur import transfer_function
from optics.operators.gram import squared_modulus
from optics.plane import centred_crop


class StrongEdges:
    """Estimates the strong edges of a photograph's scene, and the blur kernel from them.

    The photograph is (rows, columns) with a standard deviation of about LIGHT_DEVIATION. Kernels
    are at most (rows, columns) `size`.
    """

    def __init__(self, image: torch.Tensor, valid: torch.Tensor, size: tuple[int, int]) -> None:
        self._image, self._size = image, size
        rows, columns = image.shape
        self._period_shape = fast_period(rows + 2 * size[0], columns + 2 * size[1])
        self._spectrum = rfft2(extend_periodically(image, self._period_shape))
        self._laplacian = laplacian_spectrum(self._period_shape).to(image)
        trusted = (valid[1:, 1:] * valid[:-1, :-1] * valid[1:, :-1] * valid[:-1, 1:])[None]
        self._valid_gradients = gradients(image) * trusted
        # These gradients lie so far inside the frame that all of their blurred light was measured.
        unseen = torch.nn.functional.max_pool2d(
            1 - trusted, (2 * size[0] + 1, 2 * size[1] + 1), 1, (size[0], size[1])
        )
        down, along = size[0] // 2, size[1] // 2
        self._interior = torch.zeros_like(trusted)
        frame = (..., slice(down, rows - 1 - down), slice(along, columns - 1 - along))
        self._interior[frame] = 1 - unseen[frame]

    def estimate_picture(self, kernel: torch.Tensor, weight: float) -> torch.Tensor:
        """Estimate a sharp picture with few edges by deconvolution with a trial blur kernel.

        The picture x minimises |k * x - image|² + weight * (number of pixels where x has a
        gradient), by half-quadratic splitting (Xu, Zheng and Jia 2013, doi 10.1109/CVPR.2013.147).
        `kernel` is k, with its origin at n // 2. Opposite borders of the photograph are blended.
        """
        transfer = transfer_function(kernel, self._period_shape)
        told, power = transfer.conj() * self._spectrum, squared_modulus(transfer)
        x, coupling = irfft2(self._spectrum, self._period_shape), 2 * weight
        # The coupling of the picture to its edges grows up to 1000.
        while coupling < 1e3:
            along, down = torch.roll(x, -1, 1) - x, torch.roll(x, -1, 0) - x
            weak = along.square() + down.square() < weight / coupling
            along.masked_fill_(weak, 0)
            down.masked_fill_(weak, 0)
            kept = torch.roll(along, 1, 1) - along + torch.roll(down, 1, 0) - down
            wanted = told + coupling * rfft2(kept)
            x = irfft2(wanted / (power + coupling * self._laplacian), self._period_shape)
            coupling *= 2
        return centred_crop(x, self._image.shape)

    def estimate_kernel(
        self, picture: torch.Tensor, start: torch.Tensor, ridge: float
    ) -> torch.Tensor:
        """Estimate the kernel k of blind deconvolution from a sharp picture with few edges.

        The picture, blurred by k, matches the photograph best. `ridge` is the weight of |k|², which
        determines what the edges don't. The result sums to 1. If the picture has no edges, the
        result is `start`.
        """
        edges = gradients(picture) * self._interior
        rows, columns = self._size
        period = fast_period(edges.shape[-2] + rows, edges.shape[-1] + columns)
        # The padding shifts the lags, so that the lag of -(n // 2) becomes 0.
        shift = torch.nn.functional.pad(self._valid_gradients, (columns // 2, 0, rows // 2, 0))
        problem = least_squares_problem(
            padded_spectrum(edges, period), padded_spectrum(shift, period), self._size
        )
        found = minimise_nonnegative(problem.with_ridge(ridge), start, sum_is_one=False, steps=100)
        total = float(found.sum())
        return found / total if total > 0 else start
