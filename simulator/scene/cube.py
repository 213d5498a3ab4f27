"""A scene target that is a multispectral picture."""

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
    """Scene target that is a flat, matt, evenly lit print with a reflectance in many bands.

    Between the bands' wavelengths the reflectance is linear; beyond them it has its end values.

    Parameters
    ----------
    image : torch.Tensor
        Reflectances, shape (rows, columns, bands), 0 or more, 1 = white.
    wavelengths : tuple of float
        Wavelengths of the bands, ascending, metres.
    distance : float
        Distance from the panel in metres, positive.
    radiance : float
        Spectral radiance of white, W / (sr m² m), not negative.
    tol : float, default 5e-3
        Relative error with which the pixels' spectra are replaced by mixtures of fewer spectra,
        from 0 to below 1.
    light, lamp, velocity, polarisation_angle, speckle, name : optional
        See `Target`.
    cover, height, offset, side : optional
        See `PhotographPrint`.

    Raises
    ------
    ValueError
        If the image has no three axes, isn't finite or is negative, if the number of wavelengths
        isn't that of its bands, or if `tol` is outside its range.
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
