"""A score of how sharp a picture is, by which a person or a program focuses."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from optics.alignment.hot_pixels import without_hot
from optics.calibration.spots import frame_variance
from optics.camera import Sensor
from optics.validation import require_unmasked

_LEAST_LIGHT = 3.0
"""Standard deviations of its error by which a region's mean light must exceed none. Chosen: a
score is divided by the light's square."""


def focus_score(numbers: NDArray[Any], sensor: Sensor) -> float:
    """Return the focus score of a region: the energy of its gradients over its light squared.

    The mean square of the gradient is the focus measure of Tenenbaum, here by central differences,
    with the part that noise is expected to add subtracted. Divided by the square of the mean light
    it doesn't depend on the exposure. It is comparable as long as the same scene is in the region,
    and the larger, the sharper. Central differences compare pixels two apart, which have the same
    colour filter in a Bayer pattern. Hot pixels are left out.

    Parameters
    ----------
    numbers : NDArray, (rows, columns)
        Digital numbers of the region, 3 x 3 pixels at least.
    sensor : Sensor
        Tells gain, noise and black level.

    Returns
    -------
    float
        In 1/pixel². A cosine of modulation m and angular frequency k, in rad/pixel, has
        m² sin²(k) / 2. By noise, the score of a scene without structure may be slightly negative.

    Raises
    ------
    ValueError
        For a smaller region, and one without light.

    References
    ----------
    S. Pertuz, D. Puig and M. A. Garcia, "Analysis of focus measure operators for shape-from-focus",
    Pattern Recognition 46, 1415 (2013), doi 10.1016/j.patcog.2012.11.011.
    """
    require_unmasked(numbers)
    if numbers.ndim != 2 or min(numbers.shape) < 3:
        raise ValueError(f"the region is {numbers.shape} pixels; give 3 x 3 at least")
    raw = numbers.astype(np.float64)
    variance = frame_variance(raw, sensor)
    light = without_hot(raw, variance, sensor) - sensor.black_level
    mean = float(light.mean())
    error = math.sqrt(float(variance.mean()) / light.size)
    if mean < _LEAST_LIGHT * error:
        raise ValueError(
            f"the region's mean light is {mean:.2g} DN; that is too dark to judge the focus. "
            "Expose longer"
        )
    down = (light[2:, 1:-1] - light[:-2, 1:-1]) / 2
    across = (light[1:-1, 2:] - light[1:-1, :-2]) / 2
    around = (
        variance[2:, 1:-1] + variance[:-2, 1:-1] + variance[1:-1, 2:] + variance[1:-1, :-2]
    ) / 4
    energy = float((down**2 + across**2 - around).mean())
    return energy / mean**2
