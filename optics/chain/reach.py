"""Limit how far light of a chain's panel goes sideways before it meets the stop."""

from __future__ import annotations

import math

import numpy as np

from optics.chain.lens_grid import LensGridSearch
from optics.chain.panel_to_lens import TaperedBand

TAPER_TOL_SHARE = 1e-2
"""Share of the tolerance that smooth ends of a band may change within the area that the light
reaches. Chosen."""


def tapered_band(low: float, high: float, fresnel_area: float, tol: float) -> TaperedBand:
    """Return a band of a chain's panel frequencies whose smooth ends leave low to high unchanged.

    Light of the frequency f moves sideways by f times the Fresnel area A. Against the chirp
    exp(-i pi A (f - f0)²), a Gaussian step of standard deviation s at the distance D from the
    stationary frequency f0 leaves exp(-2 (pi A s D)² / (1 + (2 pi A s²)²)). The best s² is 1 / (2
    pi A), which leaves exp(-pi A D² / 2). The same holds for a step in the light's way sideways.
    """
    steps = math.sqrt(2 * math.log(1 / (TAPER_TOL_SHARE * tol)))
    room = steps / math.sqrt(math.pi * fresnel_area)
    return TaperedBand(low - room, high + room, 1 / math.sqrt(2 * math.pi * fresnel_area), steps)


def limited_reach(
    search: LensGridSearch, fresnel_area: float, error: float, tol: float
) -> tuple[TaperedBand, TaperedBand]:
    """Return the bands (y, x) of a chain's light without which the PSF has at most an error.

    A pixel sends light of the frequency f to places in the stop that lie f times the Fresnel area
    beside it, so the bands say how far each pixel's light must be followed sideways. What is left
    out reaches the window only by way of the stop's edge (see StopEdgeScatter).

    error: relative L2 error of the PSF of an evenly lit panel. tol: what the bands' smooth ends may
    not matter to.
    """
    low, high = search.without_limit.find_band(error, np.zeros(2))
    bands = [tapered_band(low[k], high[k], fresnel_area, tol) for k in (0, 1)]
    return bands[0], bands[1]
