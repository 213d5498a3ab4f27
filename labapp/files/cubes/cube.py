"""The spectral cube: pictures of one scene in many bands, with their wavelengths and unit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from labapp.common.errors import UserError
from labapp.files.wavelengths import require_metres

Values = NDArray[np.float32]

SHARE_OF_WHITE = "share of white"
"""Unit of a cube whose values are reflectances: 1 is what a white surface gives in that band."""


@dataclass(frozen=True, eq=False)
class SpectralCube:
    """Pictures of one scene in several narrow bands of the spectrum.

    Parameters
    ----------
    values : NDArray of float32, (bands, rows, columns)
        What each band shows; finite. Other real numbers are converted.
    wavelengths : tuple of float
        Central wavelength of each band in metres, rising.
    unit : str, default "share of white"
        Unit of the values, in words.
    error : NDArray of float32, (bands, rows, columns), optional
        Half width of the interval that holds the true value with a probability of 90 %, in the
        unit of the values; not negative.
    light : str, default ""
        Name of the light in which the scene was seen; empty if it isn't known.
    pitch : float, optional
        Distance in metres between neighbouring pixels on the sensor.
    description : str, default ""
        Where the cube is from, in a sentence.

    Raises
    ------
    UserError
        For arrays of another shape or with values that aren't finite, for wavelengths of another
        number, in another unit or that don't rise, or for a pitch that isn't positive.
    """

    values: Values
    wavelengths: tuple[float, ...]
    unit: str = SHARE_OF_WHITE
    error: Values | None = None
    light: str = ""
    pitch: float | None = None
    description: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "values", _single_precision(self.values, "values"))
        wavelengths = tuple(float(one) for one in self.wavelengths)
        object.__setattr__(self, "wavelengths", wavelengths)
        if self.values.ndim != 3 or not self.values.size:
            raise UserError(
                f"values are {self.values.shape}. Give (bands, rows, columns) with a pixel or more"
            )
        if len(wavelengths) != len(self.values):
            raise UserError(
                f"{len(self.values)} bands and {len(wavelengths)} wavelengths are given. Give one "
                "for each"
            )
        require_metres(wavelengths)
        if self.error is not None:
            self._require_error_map()
        if self.pitch is not None and not 0 < self.pitch < 1e-3:
            raise UserError(f"pitch is {self.pitch:g} m. Give metres between pixels, such as 5e-6")

    def _require_error_map(self) -> None:
        """Convert the cube's error map to float32; raise UserError if it doesn't fit the values."""
        assert self.error is not None
        error = _single_precision(self.error, "error")
        object.__setattr__(self, "error", error)
        if error.shape != self.values.shape or (error < 0).any():
            raise UserError(
                f"error is {error.shape}, down to {error.min():g}. Give {self.values.shape}, 0 or "
                "more"
            )

    @property
    def shape(self) -> tuple[int, int, int]:
        """Return the cube's numbers of bands, rows and columns."""
        bands, rows, columns = self.values.shape
        return bands, rows, columns

    def select_bands(
        self, wavelengths: tuple[float, ...], tolerance: float = 5e-10
    ) -> SpectralCube:
        """Return the cube with some of its bands only.

        Parameters
        ----------
        wavelengths : tuple of float
            Metres, rising.
        tolerance : float, default 5e-10
            Largest distance in metres between a wanted wavelength and a band's.

        Returns
        -------
        SpectralCube
            With the wanted bands, in their order.

        Raises
        ------
        UserError
            If the cube has no band at one of the wavelengths.
        """
        own = np.asarray(self.wavelengths)
        chosen = []
        for one in wavelengths:
            at = int(np.abs(own - one).argmin())
            if abs(own[at] - one) > tolerance:
                listed = ", ".join(f"{band * 1e9:g}" for band in self.wavelengths)
                raise UserError(f"there is no band at {one * 1e9:g} nm. The cube has {listed} nm")
            chosen.append(at)
        return SpectralCube(
            self.values[chosen],
            tuple(own[chosen]),
            self.unit,
            None if self.error is None else self.error[chosen],
            self.light,
            self.pitch,
            self.description,
        )


def _single_precision(values: object, name: str) -> Values:
    """Return a cube's array in float32; raise UserError if it isn't finite real numbers."""
    given = np.asarray(values)
    if given.dtype.kind not in "iuf":
        raise UserError(f"{name} are of type {given.dtype}. Give real numbers")
    found = given.astype(np.float32, copy=False)
    bad = int((~np.isfinite(found)).sum())
    if bad:
        raise UserError(f"{name} have {bad} NaN or infinite numbers of {found.size}")
    return found
