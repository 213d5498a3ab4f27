"""The list of Fourier transforms that are valid between two planes, and the choice among them."""

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
    """List all Fourier transforms that are valid for a geometry of two planes.

    Parameters
    ----------
    geometry : FourierGeometry
        The two planes.
    dtype : torch.dtype
        complex64 or complex128.
    error : float, optional
        Relative L2 error of the field that a transform may add beyond rounding; none by default.

    Returns
    -------
    list of Transform
        The transforms. They allocate their large arrays only when they are called.
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
    """Choose the cheapest valid Fourier transform for a geometry, or the named one.

    Parameters
    ----------
    geometry : FourierGeometry
        The two planes.
    dtype : torch.dtype, optional
        complex64 (the default) or complex128.
    budget : Budget, optional
        The memory allowed, and the machine's speed.
    method : str, optional
        The name of a transform; the cheapest by default.
    error : float, optional
        Relative L2 error of the field that a transform may add beyond rounding; none by default.

    Returns
    -------
    Transform
        The transform.

    Raises
    ------
    ToleranceError
        If no transform fits in memory.
    ValueError
        If the named transform isn't valid for the geometry.
    """
    what = f"a transform from {geometry.pupil.shape} to {geometry.image.shape} samples"
    valid = {one.name: one for one in valid_transforms(geometry, dtype, error)}
    chosen = [valid[name] for name in select_methods(valid, method, what)]
    return cheapest_candidate(chosen, budget or Budget(), what)
