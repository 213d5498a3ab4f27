"""A multispectral picture as a target."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from numpy.typing import NDArray

from optics.light.spectrum import Spectrum
from simulator.scene.colours import extend_to_silicon_range
from simulator.scene.framed import FramedPicture, require_image
from simulator.scene.target import Layer


def factorise_spectra(
    samples: NDArray[np.float64], tol: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Factorise spectra (n, bands) into weights (n, rank) and a basis (rank, bands).

    samples: not negative. tol: relative error in the L2 norm. The first basis spectrum is the mean.
    The others are singular vectors of the residual, to which the mean is added until they are
    nowhere negative. Weights may be negative.
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


@dataclass(frozen=True, eq=False)
class Cube(FramedPicture):
    """Flat, matt, evenly lit print with a reflectance in many bands.

    Between the bands' wavelengths the reflectance is linear; beyond them it has its end values.

    Parameters
    ----------
    image : torch.Tensor
        Reflectances, shape (rows, columns, bands), 0 or more, 1 = white.
    wavelengths : tuple of float
        Wavelengths of the bands, ascending, metres.
    distance, radiance : float
        Metres from the panel, positive; spectral radiance of white, W / (sr m² m), not negative.
    tol : float, default 5e-3
        Relative error, 0 to below 1, of replacing the spectra by mixtures of fewer ones.
    light, lamp, velocity, polarisation_angle, speckle, name : optional
        See `Target`.
    cover, height, offset, side : optional
        See `PhotographPrint`.

    Raises
    ------
    ValueError
        For an image, wavelengths or `tol` other than these.
    """

    image: torch.Tensor
    wavelengths: tuple[float, ...]
    distance: float
    radiance: float
    tol: float = 5e-3

    def __post_init__(self) -> None:
        super().__post_init__()
        require_image(self.image, "bands")
        if self.image.shape[2] != len(self.wavelengths):
            raise ValueError(
                f"image has {self.image.shape[2]} bands and {len(self.wavelengths)} wavelengths "
                "are given; give one for each"
            )
        if self.image.min() < 0:
            raise ValueError(
                f"image has reflectances down to {float(self.image.min()):g}; give 0 or more"
            )
        if not 0 <= self.tol < 1:
            raise ValueError(f"tol is {self.tol:g}; give 0 to below 1")
        Spectrum(self.wavelengths, (0.0,) * len(self.wavelengths))

    @cached_property
    def images(self) -> tuple[tuple[Spectrum, torch.Tensor], ...]:
        """Reflectances and pictures whose products sum to the cube, within the tolerance."""
        samples = self.image.reshape(-1, self.image.shape[2]).numpy().astype(np.float64)
        weights, basis = factorise_spectra(samples, self.tol)
        pictures = map(torch.from_numpy, weights.T.reshape(-1, *self.shape).astype(np.float32))
        spectra = (Spectrum(self.wavelengths, tuple(one)) for one in basis)
        return tuple(zip(map(extend_to_silicon_range, spectra), pictures, strict=True))

    @cached_property
    def layers(self) -> tuple[Layer, ...]:
        return (self.painted_layer(self.distance, self.images),)
