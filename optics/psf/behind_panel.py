"""Define the base class of engines for light behind a panel."""

from __future__ import annotations

from abc import abstractmethod

import torch

from optics.accuracy import ErrorEstimate
from optics.psf.dim_windows import AddedLight, error_beside
from optics.psf.engine import PSFEngine


class BehindPanelEngine(PSFEngine):
    """Computes the light of a point behind a panel, part of which the panel may not modulate.

    Both parts are added in intensity, and their error counts together: where one of them is dim in
    the window, its error matters little.
    """

    _own_error: float | None = None

    @property
    def own_error(self) -> float:
        """The relative L2 error of the last call's light without other light that is added."""
        return self.error.value + self.arithmetic if self._own_error is None else self._own_error

    def tell_error(
        self, own: float, norm: torch.Tensor, added: AddedLight | None, rounding: float, how: str
    ) -> float:
        """Tell the error of light together with what is added to it, and return it.

        own: relative L2 error of the light by itself, `rounding` of which is arithmetic.
        norm: its L2 norm in the window, (...).
        """
        self._own_error = own
        error = error_beside(own, norm, added)
        self.error = ErrorEstimate(max(error - rounding, 0.0), how)
        return error

    @abstractmethod
    def intensity(
        self,
        phase: torch.Tensor | None,
        amplitude: torch.Tensor | None,
        added: AddedLight | None = None,
    ) -> torch.Tensor: ...
