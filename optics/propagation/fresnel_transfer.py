"""Fresnel's transfer function between any two windows."""

from __future__ import annotations

import torch

from optics.plane import Plane
from optics.propagation.angular_spectrum import ScaledAngularSpectrum


class FresnelTransfer(ScaledAngularSpectrum):
    """As the scaled angular spectrum, with H = exp(-i pi wavelength z f²) (Goodman 4.2.3).

    H is one function along y times one along x: two lines are kept instead of a plane.
    The model where paraxial is asked for; for a scalar wave, where it is off by less than a
    part of the tolerance.
    """

    name = "Fresnel transfer function"
    paraxial = True

    def _build_filter(self, frequencies: Plane) -> torch.Tensor:
        """W along y, then along x, in one line."""
        y, x = (frequencies.coordinates(axis) for axis in (0, 1))
        zero = torch.zeros(1, dtype=torch.float64)
        down = self._transfer(y, zero) * self._weight(frequencies, 0)
        along = self._transfer(zero, x) * self._weight(frequencies, 1)
        return torch.cat((down, along)).to(self.dtype)

    def _apply_filter(
        self, spectrum: torch.Tensor, frequencies: Plane, *, back: bool = False
    ) -> torch.Tensor:
        w = self._filter(frequencies, spectrum.device)
        down, along = torch.split(w.conj() if back else w, list(frequencies.shape))
        return spectrum * down[:, None] * along
