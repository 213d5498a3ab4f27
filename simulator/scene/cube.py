"""A multispectral picture."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch

from optics.light.spectrum import Spectrum
from simulator.scene.colours import extend_to_silicon_range
from simulator.scene.framed import FramedPicture, require_image
from simulator.scene.spectral_factorisation import factorise_spectra


@dataclass(frozen=True, eq=False)
class Cube(FramedPicture):
    """A flat, matt print across the axis, evenly lit, known at many wavelengths.

    image: (rows, columns, bands), reflectances from 0 on, 1 = white. wavelengths: of the bands,
    rising, metres; between them it is linear, and beyond them as at the last. distance: metres.
    radiance: of white, W / (sr m² m). tol: relative error at which spectra count as mixtures of
    fewer ones.
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
        samples = self.image.reshape(-1, self.image.shape[2]).numpy().astype(np.float64)
        weights, basis = factorise_spectra(samples, self.tol)
        pictures = weights.T.reshape(-1, *self.shape).astype(np.float32)
        return tuple(
            (
                extend_to_silicon_range(Spectrum(self.wavelengths, tuple(one))),
                torch.from_numpy(picture),
            )
            for one, picture in zip(basis, pictures, strict=True)
        )
