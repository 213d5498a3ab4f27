"""A Fourier transform between two planes, one sample after the other."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from judges.basics import positions
from optics.plane import Plane


def direct_transform(field: NDArray, pupil: Plane, image: Plane, scale: float) -> NDArray:
    """Sum of f(y, x) exp(-2 pi i (y v + x u) / scale), one image sample after the other."""
    y = positions(pupil.shape[0], pupil.pitch[0], pupil.centre[0])[:, None]
    x = positions(pupil.shape[1], pupil.pitch[1], pupil.centre[1])[None, :]
    answer = np.empty(image.shape, dtype=np.complex128)
    for j, v in enumerate(positions(image.shape[0], image.pitch[0], image.centre[0])):
        for i, u in enumerate(positions(image.shape[1], image.pitch[1], image.centre[1])):
            answer[j, i] = np.sum(field * np.exp(-2j * np.pi * (y * v + x * u) / scale))
    return answer
