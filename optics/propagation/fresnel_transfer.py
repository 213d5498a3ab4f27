"""Propagate light by Fresnel's transfer function between any two windows."""

from __future__ import annotations

import torch

from optics.plane import Plane
from optics.propagation.angular_spectrum import ScaledAngularSpectrum
from optics.propagation.spectral_propagator import times


class FresnelTransfer(ScaledAngularSpectrum):
    """Propagate as the scaled angular spectrum does, with Fresnel's transfer function.

    It is H = exp(-i pi wavelength z f²) (section 4.2.3 of Goodman), the product of a function of y
    and one of x, so two lines are kept instead of a plane. The method is valid for the paraxial
    model. For a scalar wave it is valid where its error is below a share of the tolerance.
    """

    name = "Fresnel transfer function"
    paraxial = True

    @property
    def _filter_size(self) -> int:
        return sum(self.frequencies.shape)

    def _build_filter(self, frequencies: Plane) -> torch.Tensor:
        """Compute the Fresnel propagation's filter W along y and along x, joined in one vector."""
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
        return times(times(spectrum, down[:, None]), along)
