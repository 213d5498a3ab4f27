"""Divide the tolerance of a free-space propagation among its sources of error."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class PropagationToleranceShares:
    """Set which share of a propagation's tolerance each source of error may use.

    All fields are shares of `tol`, between 0 and 1, and all values are chosen. No method uses all
    of them at once.

    Attributes
    ----------
    band : float
        For the light that a spectral method cuts off, and the light of replicas.
    transform : float
        For each of the two Fourier transforms of a method.
    sampling : float
        For the samples of a Fresnel method: replicas that pass close to the target, or a cell's
        envelope between its interpolation nodes.
    replica : float
        For each of the four nearest replicas of a smooth field in a Fresnel method.
    model : float
        For what a paraxial method leaves out of a scalar wave.
    chirp_rounding : float
        For the rounding of the long chirps of the two-step Fresnel method.
    single_precision : float
        For the rounding of a computation in complex64.
    direct : float
        For one axis of the direct quadrature: the nearest replica of a smooth field, or the
        Gauss-Legendre rule inside a cell.
    smooth_field : float
        For the light of a smooth field that lies outside its declared band or at the edges of the
        source.
    """

    band: float = 0.4
    transform: float = 0.05
    sampling: float = 0.2
    replica: float = 0.05
    model: float = 0.3
    chirp_rounding: float = 0.2
    single_precision: float = 0.5
    direct: float = 0.05
    smooth_field: float = 0.5

    @property
    def spectral(self) -> float:
        """Return the share of all sampling errors of a spectral propagation method."""
        return self.band + 2 * self.transform


TOLERANCE_SHARES = PropagationToleranceShares()
