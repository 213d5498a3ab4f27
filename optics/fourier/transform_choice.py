"""Which transforms are valid between two planes, and the choice among them.

The matrix transform, which always is, multiplies a field by a matrix of phases along each axis.
"""

from __future__ import annotations

import torch

from optics.accuracy import Budget, MachineSpeed, cheapest_candidate, select_methods
from optics.fourier.gridded import FINEST_GRIDDING, GriddedTransform
from optics.fourier.separable import ChirpTransform, CommensurateTransform
from optics.fourier.transform import PASSES_PER_PHASOR, FourierGeometry, PlaneTransform, unit_phasor
from optics.plane import Plane


class MatrixTransform(PlaneTransform):
    """Multiplies by a matrix of phases on each axis, the fastest way to few samples.

    It is exact to rounding.

    Parameters
    ----------
    geometry : FourierGeometry
        The two planes; the pupil's rows and columns may be unevenly spaced.
    dtype : torch.dtype
        complex64 or complex128.

    References
    ----------
    R. Soummer et al., doi 10.1364/OE.15.015935.
    """

    name = "matrix DFT"
    bytes = 0

    def __init__(self, geometry: FourierGeometry, dtype: torch.dtype) -> None:
        super().__init__(geometry, dtype)
        (ny, nx), (my, mx) = geometry.pupil.shape, geometry.image.shape
        rows_first, columns_first = my * nx * (ny + mx), ny * mx * (nx + my)
        self._rows_first = rows_first <= columns_first
        self._products = min(rows_first, columns_first)
        between = my * nx if self._rows_first else ny * mx
        self.bytes = dtype.itemsize * (my * ny + mx * nx + between + my * mx)
        self._matrices: tuple[torch.Tensor, torch.Tensor] | None = None

    def _kernel(self, axis: int) -> torch.Tensor:
        g = self.geometry
        u, x = g.image.coordinates(axis), g.pupil.coordinates(axis)
        return unit_phasor(-torch.outer(u, x) / g.scale, self.dtype)

    def _kernels(self, device: torch.device) -> tuple[torch.Tensor, torch.Tensor]:
        if self._matrices is None or self._matrices[0].device != device:
            self._matrices = (self._kernel(0).to(device), self._kernel(1).to(device))
        return self._matrices

    def _forward(self, field: torch.Tensor) -> torch.Tensor:
        rows, columns = self._kernels(field.device)
        if self._rows_first:
            return (rows @ field) @ columns.mT
        return rows @ (field @ columns.mT)

    def forward_axis(self, field: torch.Tensor, axis: int) -> torch.Tensor:
        """Multiply a field by the matrix of one axis, 0 (y) or 1 (x)."""
        kernel = self._kernels(field.device)[axis]
        field = field.to(self.dtype)
        return kernel @ field if axis == 0 else field @ kernel.mT

    def _adjoint(self, field: torch.Tensor) -> torch.Tensor:
        rows, columns = self._kernels(field.device)
        return rows.mH @ field @ columns.conj()

    def cpu_seconds(self, speed: MachineSpeed) -> float:
        """Predict the processor seconds of one call at a machine's speed."""
        touched = self.geometry.image.shape[0] * self.geometry.image.shape[1]
        products = 4 * self._products * speed.multiply_add + touched * speed.touch
        seconds = products * speed.slowdown(self.dtype) + self.allocation_seconds(speed)
        return speed.call + seconds

    def planning_seconds(self, speed: MachineSpeed) -> float:
        """Predict the processor seconds of computing the matrices."""
        (ny, nx), (my, mx) = self.geometry.pupil.shape, self.geometry.image.shape
        return (my * ny + mx * nx) * PASSES_PER_PHASOR * speed.touch


def valid_transforms(
    geometry: FourierGeometry,
    dtype: torch.dtype,
    error: float = 0.0,
    *,
    to_few_samples: bool = False,
) -> list[PlaneTransform]:
    """List all transforms that are valid for a geometry of two planes.

    Parameters
    ----------
    geometry : FourierGeometry
        The two planes.
    dtype : torch.dtype
        complex64 or complex128.
    error : float, optional
        Relative L2 error of the field that a transform may add beyond rounding; none by default.
    to_few_samples : bool, optional
        Whether those are left out that are for wide images: where the image has fewer samples than
        the pupil, as a PSF has, chirp-Z and folded FFTs save a few percent at most.

    Returns
    -------
    list of Transform
        The transforms. They allocate their large arrays only when they are called.
    """
    found: list[PlaneTransform] = [MatrixTransform(geometry, dtype)]
    if isinstance(geometry.pupil, Plane) and not to_few_samples:
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
    """Choose the cheapest valid transform for a geometry, or the named one.

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
    valid = valid_transforms(geometry, dtype, error)
    if method is not None:
        names = [one.name for one in valid]
        valid = [valid[names.index(name)] for name in select_methods(names, method, what)]
    return cheapest_candidate(valid, budget or Budget(), what)
