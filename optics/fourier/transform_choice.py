"""Every transform that serves between two planes, and the cheapest of them."""

from __future__ import annotations

import torch

from optics.accuracy import Budget, cheapest_candidate, select_methods
from optics.fourier.chirp import ChirpTransform
from optics.fourier.commensurate import CommensurateTransform
from optics.fourier.geometry import FourierGeometry
from optics.fourier.gridded import FINEST_GRIDDING, GriddedTransform
from optics.fourier.matrix import MatrixTransform
from optics.fourier.transform import PlaneTransform
from optics.plane import Plane


def valid_transforms(
    geometry: FourierGeometry, dtype: torch.dtype, error: float = 0.0
) -> list[PlaneTransform]:
    """Every transform that is valid for a geometry.

    error: what a transform may add beyond rounding, relative L2 of the field; none by
    default.
    """
    found: list[PlaneTransform] = [MatrixTransform(geometry, dtype)]
    if isinstance(geometry.pupil, Plane):
        found.append(ChirpTransform(geometry, dtype))
        if CommensurateTransform.is_commensurate(geometry):
            found.append(CommensurateTransform(geometry, dtype))
    if error >= FINEST_GRIDDING:
        found.append(GriddedTransform(geometry, dtype, min(error, 0.1)))
    return found


def plan_transform(
    geometry: FourierGeometry,
    dtype: torch.dtype = torch.complex64,
    budget: Budget | None = None,
    method: str | None = None,
    error: float = 0.0,
) -> PlaneTransform:
    """The cheapest valid transform for a geometry, or the one that `method` names.

    Raises ToleranceError without memory, ValueError if the named one isn't valid here.
    """
    what = f"a transform from {geometry.pupil.shape} to {geometry.image.shape} samples"
    valid = {one.name: one for one in valid_transforms(geometry, dtype, error)}
    chosen = [valid[name] for name in select_methods(valid, method, what)]
    return cheapest_candidate(chosen, budget or Budget(), what)
