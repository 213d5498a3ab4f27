"""The spectral cube: pictures of one scene in many bands, with their wavelengths and unit."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from labapp.common.errors import UserError
from labapp.files.cubes.stored_values import StoredValues, Values
from labapp.files.wavelengths import require_metres

_BLOCK = 8 << 20
"""Bytes of a cube that are looked at together, 8 MiB. Chosen."""

SHARE_OF_WHITE = "share of white"
"""Unit of a cube whose values are reflectances: 1 is what a white surface gives in that band."""


@dataclass(frozen=True, eq=False)
class SpectralCube:
    """Pictures of one scene in several narrow bands of the spectrum.

    Parameters
    ----------
    values : NDArray of float32 or StoredValues, (bands, rows, columns)
        What each band shows; finite, or NaN where a value is missing. Other real numbers are
        converted, and masked ones are missing. Those of a file are read when they are indexed.
    wavelengths : tuple of float
        Central wavelength of each band in metres, rising.
    unit : str, default "share of white"
        Unit of the values, in words.
    error : NDArray of float32 or StoredValues, (bands, rows, columns), optional
        Half width of the interval that holds the true value with a probability of 90 %, in the
        unit of the values; not negative.
    light : str, default ""
        Name of the light in which the scene was seen; empty if it isn't known.
    pitch : float, optional
        Distance in metres between neighbouring pixels on the sensor.
    description : str, default ""
        Where the cube is from, in a sentence.
    notes : tuple of str, optional
        Remarks for the user on how its file was read.
    may_miss : bool, default False
        Whether NaN is allowed among the values, and stands for a missing one.

    Raises
    ------
    UserError
        For arrays of another shape or with values that aren't finite, for wavelengths of another
        number, in another unit or that don't rise, or for a pitch that isn't positive.
    """

    values: Values | StoredValues
    wavelengths: tuple[float, ...]
    unit: str = SHARE_OF_WHITE
    error: Values | StoredValues | None = None
    light: str = ""
    pitch: float | None = None
    description: str = ""
    notes: tuple[str, ...] = ()
    may_miss: bool = False

    def __post_init__(self) -> None:
        is_masked = isinstance(self.values, np.ma.MaskedArray | StoredValues)
        object.__setattr__(self, "may_miss", self.may_miss or is_masked)
        values = _single_precision(self.values, "values", may_miss=self.may_miss)
        object.__setattr__(self, "values", values)
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
            error = _single_precision(self.error, "error", may_miss=self.may_miss)
            object.__setattr__(self, "error", error)
            if error.shape != self.values.shape:
                raise UserError(f"error is {error.shape}. Give {self.values.shape}")
            if not isinstance(error, StoredValues) and (error < 0).any():
                raise UserError(f"error is down to {np.nanmin(error):g}. Give 0 or more")
        if self.pitch is not None and not 0 < self.pitch < 1e-3:
            raise UserError(f"pitch is {self.pitch:g} m. Give metres between pixels, such as 5e-6")

    @cached_property
    def missing(self) -> NDArray[np.bool_]:
        """Pixels that lack a value in a band or more, (rows, columns)."""
        found = np.zeros(self.shape[1:], np.bool_)
        if self.may_miss:
            for rows in self.row_blocks():
                found[rows] = np.isnan(self.values[:, rows]).any(0)
        return found

    def row_blocks(self) -> Iterator[slice]:
        """Yield the rows, for `values[:, rows]`, in blocks of some megabytes that read quickly."""
        bands, rows, columns = self.shape
        step = max(_BLOCK // (4 * bands * columns), 1)
        yield from (slice(at, min(at + step, rows)) for at in range(0, rows, step))

    @property
    def shape(self) -> tuple[int, int, int]:
        """Numbers of bands, rows and columns."""
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
                raise UserError(
                    f"there is no band at {one * 1e9:g} nm. The cube has {listed} nm"
                    f"{''.join(f' ({note})' for note in self.notes)}"
                )
            chosen.append(at)
        error = None if self.error is None else self.error[chosen]
        return replace(
            self, values=self.values[chosen], wavelengths=tuple(own[chosen]), error=error
        )


def _single_precision(values: object, name: str, *, may_miss: bool) -> Values | StoredValues:
    """Return an array in float32; UserError unless it is finite real numbers, or NaN may be."""
    if isinstance(values, StoredValues):
        return values
    given = np.asanyarray(values)
    if given.dtype.kind not in "iuf":
        raise UserError(f"{name} are of type {given.dtype}. Give real numbers")
    with np.errstate(over="ignore"):
        found = given.astype(np.float32, copy=False)
    if isinstance(found, np.ma.MaskedArray):
        found = found.filled(np.nan)
    bad = int((np.isinf(found) if may_miss else ~np.isfinite(found)).sum())
    if bad:
        raise UserError(f"{name} have {bad} NaN or infinite numbers of {found.size}")
    return found
