"""Every transform that serves between two planes, and the cheapest of them."""

from __future__ import annotations

import torch

from optics.accuracy import Budget, cheapest, named
from optics.fourier.chirp import ChirpTransform
from optics.fourier.commensurate import CommensurateTransform
from optics.fourier.geometry import Geometry
from optics.fourier.gridded import FINEST_GRIDDING, GriddedTransform
from optics.fourier.matrix import MatrixTransform
from optics.fourier.transform import PlaneTransform
from optics.plane import Plane


def transforms(geometry: Geometry, dtype: torch.dtype, error: float = 0.0) -> list[PlaneTransform]:
    """Every transform that is valid for a geometry.

    error: what a transform may add beyond rounding, relative L2 of the field; none by
    default.
    """
    found: list[PlaneTransform] = [MatrixTransform(geometry, dtype)]
    if isinstance(geometry.pupil, Plane):
        found.append(ChirpTransform(geometry, dtype))
        if CommensurateTransform.fits(geometry):
            found.append(CommensurateTransform(geometry, dtype))
    if error >= FINEST_GRIDDING:
        found.append(GriddedTransform(geometry, dtype, min(error, 0.1)))
    return found


def plan_transform(
    geometry: Geometry,
    dtype: torch.dtype = torch.complex64,
    budget: Budget | None = None,
    method: str | None = None,
    error: float = 0.0,
) -> PlaneTransform:
    """The cheapest valid transform for a geometry, or the one that `method` names.

    Raises ToleranceError without memory, ValueError if the named one isn't valid here.
    """
    what = f"a transform from {geometry.pupil.shape} to {geometry.image.shape} samples"
    valid = {one.name: one for one in transforms(geometry, dtype, error)}
    chosen = [valid[name] for name in named(valid, method, what)]
    return cheapest(chosen, budget or Budget(), what)
