"""A test chart of coloured patches, like a ColorChecker."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from optics.light.spectrum import Spectrum
from optics.validation import require_positive
from simulator.scene.colours import extend_to_silicon_range
from simulator.scene.cube import factorise_spectra
from simulator.scene.polygons import Polygons, rectangle
from simulator.scene.sheets import PaintedPicture


def checker(
    reflectances: Sequence[Spectrum], width: float, offset: tuple[float, float] = (0.0, 0.0)
) -> tuple[PaintedPicture, ...]:
    """Draw a chart of 24 coloured patches in four rows of six, framed in black.

    Parameters
    ----------
    reflectances : sequence of Spectrum
        Reflectances of the 24 patches, row by row from the upper left, all at the same
        wavelengths.
    width : float
        Width of the chart in metres, positive.
    offset : tuple of float, default (0.0, 0.0)
        Position (y, x) of the chart's middle relative to the axis, metres on the object.

    Returns
    -------
    tuple of tuple
        Pairs of a reflectance and a picture, which add up; see `Sheet`.

    Raises
    ------
    ValueError
        If the number of reflectances isn't 24, their wavelengths differ, or the width isn't
        positive.
    """
    require_positive("width", width, "m")
    rows, columns = 4, 6
    if len(reflectances) != rows * columns:
        raise ValueError(
            f"{len(reflectances)} reflectances are given; the chart has {rows * columns} patches"
        )
    wavelengths = reflectances[0].wavelengths
    if any(one.wavelengths != wavelengths for one in reflectances):
        raise ValueError("the patches' wavelengths differ; give all at the same ones")
    frame_reflectance = 0.03
    samples = np.array(
        [(frame_reflectance,) * len(wavelengths), *(one.values for one in reflectances)]
    )
    # Tables of reflectances have three decimals, so a smaller error than 3e-3 isn't needed.
    weights, basis = factorise_spectra(samples, 3e-3)
    step = width / columns
    patch_side = 0.85 * step
    sheet = rectangle(offset, (rows * step, width))
    patches = [
        rectangle(
            (offset[0] + (row - (rows - 1) / 2) * step, offset[1] + (x - (columns - 1) / 2) * step),
            (patch_side, patch_side),
        )
        for row in range(rows)
        for x in range(columns)
    ]
    # A patch's value is its difference from the frame's, because overlapping polygons add up.
    return tuple(
        (
            extend_to_silicon_range(Spectrum(wavelengths, tuple(one))),
            Polygons((sheet, *patches), (w[0], *(w[1:] - w[0]))),
        )
        for one, w in zip(basis, weights.T, strict=True)
    )
