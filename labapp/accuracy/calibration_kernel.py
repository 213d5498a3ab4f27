"""A fixed piece of work whose time says how fast the machine is just now."""

from __future__ import annotations

import numpy as np
import scipy.fft

_SIDE = 512


class CalibrationKernel:
    """A matrix product, an FFT and a gather, as the methods are made of; about ten ms.

    Times of two runs, on different days or machines, compare as multiples of it.
    """

    def __init__(self) -> None:
        rng = np.random.default_rng(0)
        shape = (_SIDE, _SIDE)
        self._matrix = (rng.normal(size=shape) + 1j * rng.normal(size=shape)).astype(np.complex64)
        self._values = rng.normal(size=_SIDE**2)
        self._places = rng.integers(0, _SIDE**2, _SIDE**2)

    def __call__(self) -> float:
        product = self._matrix @ self._matrix
        spectrum = scipy.fft.fft2(self._matrix)
        return float(abs(product[0, 0] + spectrum[0, 0]) + self._values[self._places].sum())
