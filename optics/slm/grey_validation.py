"""Check that a pattern of grey levels can be displayed on a panel."""

from __future__ import annotations

import numpy as np

from optics.slm.panel import Panel


def require_grey(panel: Panel, grey: np.ndarray) -> None:
    """Raise an error unless an SLM can display an array of grey levels.

    Parameters
    ----------
    panel : Panel
        The panel.
    grey : numpy.ndarray
        Grey levels, uint8, (rows, columns) of the panel.

    Raises
    ------
    TypeError
        If the array's type isn't uint8.
    ValueError
        If the array's shape isn't the panel's, or the panel lacks one of its levels.
    """
    if grey.dtype != np.uint8:
        raise TypeError(f"the pattern's type is {grey.dtype}; the panel shows uint8 grey levels")
    if grey.shape != panel.shape:
        raise ValueError(
            f"the pattern is {grey.shape[-1]}x{grey.shape[0]} pixels; "
            f"the panel needs {panel.shape[1]}x{panel.shape[0]}"
            if grey.ndim == 2
            else f"the pattern has {grey.ndim} axes; the panel needs rows and columns"
        )
    if grey.max() >= panel.levels:
        raise ValueError(
            f"the pattern has level {grey.max()}; the panel's levels are 0 to {panel.levels - 1}"
        )
