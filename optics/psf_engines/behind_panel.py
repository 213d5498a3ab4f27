"""The base class of engines that compute a PSF behind a panel."""

from __future__ import annotations

from abc import abstractmethod

import torch

from optics.psf_engines.engine import PSFEngine
from optics.psf_engines.window_error import AddedLight


class BehindPanelEngine(PSFEngine):
    """Computes the light of a point behind a panel, part of which the panel may not modulate.

    Both parts are added in intensity, and their error counts together: where one of them is dim in
    the window, its error matters little.
    """

    _own_error: float | None = None

    @property
    def own_error(self) -> float:
        """The relative L2 error of the last call's PSF without other light that is added."""
        return self.error.value + self.arithmetic if self._own_error is None else self._own_error

    @abstractmethod
    def intensity(
        self,
        phase: torch.Tensor | None,
        amplitude: torch.Tensor | None,
        added: AddedLight | None = None,
    ) -> torch.Tensor: ...
