"""Factorisation of a picture's spectra into mixtures of a few."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def factorise_spectra(
    samples: NDArray[np.float64], tol: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Factorise a scene's spectra (n, bands) into weights (n, rank) and a basis (rank, bands).

    samples: not negative. tol: relative error in the L2 norm over all samples. The first basis
    spectrum is the mean. The others are the singular vectors of the residual; to each of them the
    mean is added until it is nowhere negative, because a spectrum must not be negative. Weights
    may be negative.
    """
    mean = samples.mean(axis=0)
    if not mean.any():
        return np.zeros((len(samples), 1)), np.ones((1, samples.shape[1]))
    first = samples @ mean / (mean @ mean)
    rest = samples - np.outer(first, mean)
    # The matrix (bands, bands) is small: a cube has far more pixels than bands.
    power, vectors = np.linalg.eigh(rest.T @ rest)
    order = np.argsort(power)[::-1]
    left = np.append(np.cumsum(np.maximum(power[order], 0)[::-1])[::-1], 0.0)
    rank = int(np.argmax(left <= (tol * np.linalg.norm(samples)) ** 2))
    basis = vectors[:, order[:rank]].T
    weights = rest @ basis.T
    lit = mean > 0
    for k in range(rank):
        share = float(np.max(np.maximum(-basis[k, lit] / mean[lit], 0)))
        basis[k] = np.maximum(basis[k] + share * mean, 0)
        first = first - share * weights[:, k]
    return np.column_stack([first, weights]), np.vstack([mean, basis])
