"""What judges and tests of every room begin with: places, errors, and pictures made of formulas."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def relative(value: NDArray, truth: NDArray) -> float:
    """Relative L2 error."""
    value, truth = np.asarray(value), np.asarray(truth)
    return float(np.linalg.norm(value - truth) / np.linalg.norm(truth))


def positions(n: int, pitch: float, centre: float = 0.0) -> Array:
    """Sample positions with the origin at n // 2, written out."""
    return np.array([(i - n // 2) * pitch + centre for i in range(n)])


def natural_image(rows: int, columns: int, seed: int) -> Array:
    """Noise with an amplitude spectrum that falls with frequency, and an edge; 0 to 1."""
    rng = np.random.default_rng(seed)
    fy, fx = np.fft.fftfreq(rows)[:, None], np.fft.rfftfreq(columns)[None, :]
    slope = 1 / np.maximum(np.hypot(fy, fx), 1 / max(rows, columns)) ** 1.2
    texture = np.fft.irfft2(np.fft.rfft2(rng.normal(size=(rows, columns))) * slope, (rows, columns))
    texture /= texture.std()
    y, x = np.mgrid[:rows, :columns]
    texture = texture + 1.5 * ((x - columns / 2.2) ** 2 + (y - rows / 1.8) ** 2 < (rows / 4) ** 2)
    low, high = texture.min(), texture.max()
    return 0.05 + 0.9 * (texture - low) / (high - low)


def gaussian_psf(side: int, sigma: float) -> Array:
    """A normalised Gaussian around n // 2, sigma in samples."""
    x = positions(side, 1.0)
    g = np.exp(-(x**2) / (2 * sigma**2))
    return np.outer(g, g) / g.sum() ** 2


def binned(array: Array, factor: int) -> Array:
    """Sums over blocks of factor x factor samples."""
    rows, columns = (n // factor for n in array.shape)
    return array.reshape(rows, factor, columns, factor).sum((1, 3))
