"""Hold maps over a panel: its flatness, its illumination."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import torch

from optics.slm.cells import as_float64, interpolate_cells
from optics.validation import require_finite

if TYPE_CHECKING:
    from optics.slm.panel import Panel


@dataclass(frozen=True, eq=False)
class PanelMap:
    """Hold a map of a quantity over a panel, such as its flatness or its illumination.

    The values are those of equal cells that cover the panel. The cells may be coarser than the
    pixels.

    Parameters
    ----------
    values : torch.Tensor or numpy.ndarray
        (rows, columns) of cells; kept as a float64 tensor.

    Raises
    ------
    ValueError
        If the values are empty, not finite, or have another number of axes than two.
    """

    values: torch.Tensor

    def __post_init__(self) -> None:
        values = as_float64(self.values)
        if values.ndim != 2 or not values.numel():
            raise ValueError(
                f"a map's values are {tuple(values.shape)}; they need rows and columns"
            )
        require_finite("a map", values)
        object.__setattr__(self, "values", values)

    def at_pixels(self, panel: Panel) -> torch.Tensor:
        """Interpolate a map's values at the SLM's pixels, (rows, columns) float64.

        The values are bilinear between the cells' centres and constant beyond the outermost ones.
        """
        rows, columns = panel.shape
        return interpolate_cells(interpolate_cells(self.values, rows, 0), columns, 1)
