"""Figures of merit, each defined once."""

from __future__ import annotations

import math

import torch

from optics.edge import tensors_inside


@tensors_inside
def efficiency(psf: torch.Tensor, target: torch.Tensor, total: float = 1.0) -> float:
    """Share of the light where the target exceeds 2 % of its peak; `total` is all light."""
    return float(psf[target > 0.02 * target.max()].sum()) / total


@tensors_inside
def speckle_contrast(psf: torch.Tensor, target: torch.Tensor) -> float:
    """Standard deviation over mean of PSF / target where the target exceeds half its peak."""
    bright = target > 0.5 * target.max()
    ratio = psf[bright].to(torch.float64) / target[bright].to(torch.float64)
    return float(ratio.std(correction=0) / ratio.mean())


@tensors_inside
def relative_error(value: torch.Tensor, truth: torch.Tensor) -> float:
    """Relative L2 error without a fitted scale: |value - truth| / |truth|."""
    difference = value.to(torch.float64) - truth.to(torch.float64)
    return float(difference.norm() / truth.to(torch.float64).norm())


@tensors_inside
def psnr(image: torch.Tensor, reference: torch.Tensor, peak: float = 1.0) -> float:
    """Peak signal-to-noise ratio in dB; infinite for equal images."""
    error = float(((image.to(torch.float64) - reference.to(torch.float64)) ** 2).mean())
    return math.inf if error == 0 else 10 * math.log10(peak**2 / error)


@tensors_inside
def ssim(image: torch.Tensor, reference: torch.Tensor, data_range: float = 1.0) -> float:
    """Mean structural similarity (Wang et al. 2004, doi 10.1109/TIP.2003.819861).

    Gaussian window of sigma 1.5 cut at 3.5 sigma, K1 = .01, K2 = .03, population
    statistics, averaged where the window lies inside the picture.
    """
    radius, sigma = 5, 1.5
    x = torch.arange(-radius, radius + 1, dtype=torch.float64)
    window = torch.exp(-(x**2) / (2 * sigma**2))
    window = window / window.sum()

    def smooth(picture: torch.Tensor) -> torch.Tensor:
        rows = torch.nn.functional.conv2d(picture[None, None], window[None, None, :, None])
        return torch.nn.functional.conv2d(rows, window[None, None, None, :])[0, 0]

    a, b = image.to(torch.float64), reference.to(torch.float64)
    mean_a, mean_b = smooth(a), smooth(b)
    var_a, var_b = smooth(a * a) - mean_a**2, smooth(b * b) - mean_b**2
    covariance = smooth(a * b) - mean_a * mean_b
    c1, c2 = (0.01 * data_range) ** 2, (0.03 * data_range) ** 2
    luminance = (2 * mean_a * mean_b + c1) / (mean_a**2 + mean_b**2 + c1)
    structure = (2 * covariance + c2) / (var_a + var_b + c2)
    return float((luminance * structure).mean())


def central(image: torch.Tensor, share: float = 0.9) -> torch.Tensor:
    """The central part of a picture along each axis, by share of its sides."""
    rows, columns = image.shape[-2:]
    y, x = round(rows * (1 - share) / 2), round(columns * (1 - share) / 2)
    return image[..., y : rows - y, x : columns - x]
