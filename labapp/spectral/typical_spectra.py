"""Typical reflectances of things, by which spectra are told apart where the photograph can't."""

from __future__ import annotations

import importlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

from labapp.common.colour_library import colour_library
from labapp.common.errors import UserError
from labapp.files.wavelengths import list_nanometres

_KNOWN = (380e-9, 780e-9)  # metres; where the samples' reflectances are known


def typical_reflectances(wavelengths: tuple[float, ...]) -> NDArray[np.float64]:
    """Read the reflectances of 99 typical things in bands, (99, bands), 0 to 1.

    They are the colour evaluation samples of CIE 224:2017, "Colour fidelity index for accurate
    scientific use", which were chosen from more than 100 000 measured reflectances of nature, skin,
    textiles, paints, plastics, prints and colour systems, so that they fill the space of colours
    evenly and favour no wavelength. The library colour-science has them, in steps of 5 nm, between
    which they are linear. `optics.multispectral.restore_spectra` takes them as typical spectra; in
    a light that isn't white, they are to be multiplied by what white gives in each band.

    wavelengths: centre of each band in metres, 380e-9 to 780e-9; others raise UserError.
    """
    if not all(_KNOWN[0] <= one <= _KNOWN[1] for one in wavelengths):
        raise UserError(
            f"bands at {list_nanometres(wavelengths)}: typical reflectances are known from "
            f"{list_nanometres(_KNOWN).replace(', ', ' to ')}. Choose bands in that range."
        )
    colour = colour_library()
    fidelity: Any = importlib.import_module("colour.quality.cfi2017")
    low, high = (round(1e9 * one) for one in _KNOWN)
    samples = fidelity.load_TCS_CIE2017(colour.SpectralShape(low, high, 5))
    nm = 1e9 * np.array(wavelengths)
    return np.stack([np.interp(nm, samples.wavelengths, one) for one in samples.values.T])
