"""A fixed piece of work, whose time tells how fast the machine is at the moment."""

from __future__ import annotations

import numpy as np
import scipy.fft


class CalibrationKernel:
    """A matrix product, an FFT and a gather, the operations that the methods consist of.

    A call takes about 10 ms. Times that were measured on different days or machines are compared
    as multiples of the time of this call.
    """

    def __init__(self) -> None:
        rng = np.random.default_rng(0)
        side = 512
        shape = (side, side)
        self._matrix = (rng.normal(size=shape) + 1j * rng.normal(size=shape)).astype(np.complex64)
        self._values = rng.normal(size=side**2)
        self._places = rng.integers(0, side**2, side**2)

    def __call__(self) -> float:
        product = self._matrix @ self._matrix
        spectrum = scipy.fft.fft2(self._matrix)
        return float(abs(product[0, 0] + spectrum[0, 0]) + self._values[self._places].sum())
