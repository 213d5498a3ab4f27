"""A chart of coloured patches, as a ColorChecker is."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from optics.light.spectrum import Spectrum
from optics.validation import require_positive
from simulator.scene.colours import extend_to_silicon_range
from simulator.scene.polygons import Polygons, rectangle
from simulator.scene.sheets import PaintedPicture
from simulator.scene.spectral_factorisation import factorise_spectra

ROWS, COLUMNS = 4, 6

_PATCH = 0.85
"""Side of a patch over the distance between patches: the rest is a black frame."""

_FRAME = 0.03
"""Reflectance of the frame."""

_TOL = 3e-3
"""Relative error at which the patches' reflectances count as mixtures of fewer ones: tables have
three decimals."""


def checker(
    reflectances: Sequence[Spectrum], width: float, offset: tuple[float, float] = (0.0, 0.0)
) -> tuple[PaintedPicture, ...]:
    """Patches in four rows of six, from the upper left on, in a black frame.

    reflectances: 24, of the same wavelengths. width: of the chart, metres. Raises ValueError
    where they aren't that.
    """
    require_positive("width", width, "m")
    if len(reflectances) != ROWS * COLUMNS:
        raise ValueError(
            f"{len(reflectances)} reflectances are given; the chart has {ROWS * COLUMNS} patches"
        )
    wavelengths = reflectances[0].wavelengths
    if any(one.wavelengths != wavelengths for one in reflectances):
        raise ValueError("the patches' wavelengths differ; give all at the same ones")
    # The frame is grey; a patch's difference from it need not be positive.
    samples = np.array([(_FRAME,) * len(wavelengths), *(one.values for one in reflectances)])
    weights, basis = factorise_spectra(samples, _TOL)
    step = width / COLUMNS
    sheet = rectangle(offset, (ROWS * step, width))
    patches = [
        rectangle(
            (offset[0] + (row - (ROWS - 1) / 2) * step, offset[1] + (x - (COLUMNS - 1) / 2) * step),
            (_PATCH * step, _PATCH * step),
        )
        for row in range(ROWS)
        for x in range(COLUMNS)
    ]
    return tuple(
        (
            extend_to_silicon_range(Spectrum(wavelengths, tuple(one))),
            Polygons((sheet, *patches), (w[0], *(w[1:] - w[0]))),
        )
        for one, w in zip(basis, weights.T, strict=True)
    )
