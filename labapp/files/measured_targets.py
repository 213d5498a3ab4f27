"""Tables of a scene's targets of measured data: multispectral cubes, reliefs and displays."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import torch
from numpy.typing import NDArray
from pydantic import Field, model_validator

from labapp.common.errors import UserError
from labapp.files.number_file import read_numbers
from labapp.files.picture.colour_picture import cached_picture
from labapp.files.quantities import Finite, Nanometres, Positive
from labapp.files.reflectance_table import reflectance_basis
from labapp.files.scene_targets import (
    Distance,
    EncodingName,
    IlluminatedTargetTable,
    Lamps,
    PictureTargetTable,
)
from simulator.scene import Cube, Display, Relief, Target, display_primaries, distances_of


class CubeTable(PictureTargetTable):
    """A multispectral picture in a scene: an array (rows, columns, bands) in .npy, .mat and others.

    variable is the array's name in a file of several. wavelengths_nm are those of the bands,
    rising, or the first and the last of evenly spaced bands. white is the file's value of a
    surface that reflects all light. tol is the relative error that is allowed when the spectra
    are approximated as mixtures of fewer spectra.
    """

    kind: Literal["cube"]
    distance_m: Distance
    variable: str | None = None
    wavelengths_nm: Annotated[list[Nanometres], Field(min_length=2)]
    white: Positive
    tol: Annotated[float, Field(ge=0, lt=1)] = 5e-3

    def build(self, lamps: Lamps) -> Target:
        values = read_numbers(Path(self.file), self.variable)
        if values.ndim != 3:
            raise UserError(f"{self.file}: is {values.shape}; give rows, columns and bands.")
        try:
            # The wavelengths of all bands, or of the first and the last of them.
            given = np.array(self.wavelengths_nm) / 1e9
            if len(given) == 2 and values.shape[2] > 2:
                given = np.linspace(given[0], given[1], values.shape[2])
            return Cube(
                image=torch.from_numpy((values / self.white).astype(np.float32)),
                wavelengths=tuple(given.tolist()),
                distance=self.distance_m,
                tol=self.tol,
                **self.picture_arguments(lamps),
            )
        except ValueError as error:
            raise UserError(f"{self.file}: {error}.") from error


class ReliefTable(PictureTargetTable):
    """A photograph of a scene with a distance for every pixel, divided into depth layers.

    The distances come from `depth`, a file in metres, or from `disparity`, a file of pixel shifts
    between the pictures of a stereo pair with baseline_mm, focal_px, and offset_px, which is added
    to the shifts. per_value is the size of a step of 1 in the file, in metres or pixels. Values of
    0 and NaN mean that the distance is unknown. levels is the number of depth layers, which are
    evenly spaced in the inverse of the distance.
    """

    kind: Literal["relief"]
    depth: str | None = None
    disparity: str | None = None
    per_value: Positive = 1.0
    baseline_mm: Positive | None = None
    focal_px: Positive | None = None
    offset_px: Finite = 0.0
    levels: Annotated[int, Field(ge=1, le=64)] = 8
    spectra: Literal["mallett", "primaries"] = "mallett"
    encoding: EncodingName | None = None

    @model_validator(mode="after")
    def _has_distances(self) -> ReliefTable:
        if (self.depth is None) == (self.disparity is None):
            raise ValueError("give either depth or disparity")
        if self.disparity is not None and None in (self.baseline_mm, self.focal_px):
            raise ValueError("disparity needs baseline_mm and focal_px")
        return self

    def build(self, lamps: Lamps) -> Target:
        source = self.depth or self.disparity or ""
        image = cached_picture(self.file, self.encoding)
        try:
            return Relief(
                image=torch.from_numpy(image),
                depths=torch.from_numpy(self._metres(read_numbers(Path(source)))),
                levels=self.levels,
                basis=reflectance_basis(self.spectra),
                **self.picture_arguments(lamps),
            )
        except ValueError as error:
            raise UserError(f"{source}: {error}.") from error

    def _metres(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        known = np.where(np.isfinite(values) & (values != 0), values * self.per_value, np.nan)
        if self.disparity is None:
            return known
        assert self.baseline_mm is not None
        assert self.focal_px is not None
        return distances_of(known, self.baseline_mm * 1e-3, self.focal_px, self.offset_px)


class DisplayTable(IlluminatedTargetTable):
    """A display in a scene that shows a picture (thesis §6.4), one pixel on each of its own.

    pixel_um is the pitch of the display's pixels, each of which has three stripes side by side.
    fill is the side of a stripe's window over the stripe's pitch. primaries_nm are [wavelength,
    full width at half maximum] of red, green and blue. radiance is that of a stripe that is fully
    on, at its primary's peak.
    """

    kind: Literal["display"]
    file: str
    distance_m: Distance
    pixel_um: Positive
    fill: Annotated[float, Field(gt=0, le=1)] = 0.9
    primaries_nm: tuple[
        tuple[Nanometres, Positive], tuple[Nanometres, Positive], tuple[Nanometres, Positive]
    ] = ((610.0, 35.0), (540.0, 40.0), (455.0, 22.0))
    polarised_deg: Finite | None = 90.0
    light: None = None
    encoding: EncodingName | None = None
    credit: str = ""

    def build(self, lamps: Lamps) -> Target:
        bands = [(centre * 1e-9, width * 1e-9) for centre, width in self.primaries_nm]
        return Display(
            image=torch.from_numpy(cached_picture(self.file, self.encoding)),
            pitch=self.pixel_um * 1e-6,
            distance=self.distance_m,
            primaries=display_primaries(bands),
            fill=self.fill,
            **self.light_arguments(lamps),
        )
