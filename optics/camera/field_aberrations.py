"""Aberrations that grow from the axis to the edge of a lens' field (Seidel's)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from optics.validation import require_positive, require_size

Array = NDArray[np.float64]
ZernikeTerms = tuple[tuple[int, int, float], ...]


@dataclass(frozen=True)
class FieldAberrations:
    """A wavefront by Seidel's coefficients at the edge of the field.

    At the relative image height H, a vector in the direction of the point's image, the optical path
    at the pupil's place v, a vector in stop radii, is W131 v² (v·H) + W222 (v·H)² + W220 v² H². It
    is relative to the point's paraxial image, so that coma moves the middle of the light. With
    positive coefficients, coma points outwards, and light off the axis meets behind the sensor
    (Welford 1986, Aberrations of Optical Systems, chapters 7 and 8).

    height: image height in metres at which the coefficients hold.
    coma: W131 in metres of optical path.
    astigmatism: W222 in metres: the difference of tangential and sagittal focus.
    curvature: W220 in metres: the curvature of the sagittal field.

    Raises ValueError if the height isn't positive, or a coefficient isn't finite or is too large to
    be meant.
    """

    height: float
    coma: float = 0.0
    astigmatism: float = 0.0
    curvature: float = 0.0

    def __post_init__(self) -> None:
        require_positive("height", self.height, "m")
        require_size("field", "height", self.height)
        for name in ("coma", "astigmatism", "curvature"):
            require_size("aberration", name, getattr(self, name))

    def path(self, place: tuple[float, float], y: Array, x: Array) -> Array:
        """Return the optical path in metres at the pupil's places (y, x), in stop radii.

        place: (y, x) metres of the point's image from the axis.
        """
        v, u = place[0] / self.height, place[1] / self.height
        along, r2 = y * v + x * u, y**2 + x**2
        return np.asarray(
            self.coma * r2 * along
            + self.astigmatism * along**2
            + self.curvature * r2 * (v**2 + u**2)
        )

    def at(self, y: float, x: float) -> ZernikeTerms:
        """Return the Zernike coefficients (n, m, metres) of a point imaged at (y, x) metres.

        The mean over the stop, which has no effect, is left out.
        """
        v, u = y / self.height, x / self.height
        squared = v**2 + u**2
        # Over the disc: r² = Z(2,0) / √12 + 1/2, r² cos 2θ = Z(2,2) / √6 with sine and Z(2,-2)
        # alike, and r³ cos θ = Z(3,1) / √72 + Z(1,1) / 3, from x towards y.
        round_ = (self.astigmatism / 2 + self.curvature) * squared / math.sqrt(12)
        bent = self.astigmatism / 2 / math.sqrt(6)
        tail, tilt = self.coma / math.sqrt(72), self.coma / 3
        found = (
            (1, 1, tilt * u), (1, -1, tilt * v),
            (2, 0, round_), (2, 2, bent * (u**2 - v**2)), (2, -2, bent * 2 * v * u),
            (3, 1, tail * u), (3, -1, tail * v),
        )  # fmt: skip
        return tuple(one for one in found if one[2])


def add_aberrations(one: ZernikeTerms, other: ZernikeTerms) -> ZernikeTerms:
    """Return the sum of two wavefronts as Zernike coefficients, each polynomial once."""
    total: dict[tuple[int, int], float] = {}
    for n, m, path in (*one, *other):
        total[n, m] = total.get((n, m), 0.0) + path
    return tuple((n, m, path) for (n, m), path in total.items())
