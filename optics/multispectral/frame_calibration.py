"""Calibration of a snapshot spectral camera from frames, by one least-squares fit."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.optimize import least_squares

from optics.multispectral.calibration_frames import FlatFrames, FrameGroup, StarFrames
from optics.multispectral.snapshot_calibration import SnapshotCalibration
from optics.multispectral.snapshot_model import SnapshotModel
from optics.threads import single_threaded
from optics.validation import require_positive

_PASSES = 3
"""Number of fits, each with the noise that the last one's model has. The third changes estimates by
less than a hundredth of their deviation."""

_CAUTION = 1.5
"""Factor on the variance of all samples. Without it, intervals hold as often as they say on average
over 31 parameters and 40 cameras; with it, those of the worst parameter do as well."""

_SCALE_ERROR, _CENTRE_ERROR = 0.006, 0.004
"""Errors in pixels that interpolation leaves in the coded PSFs' radius and in their centres, even
with a bright star. Measured with rings of 20 pixels, and a star 2000 times brighter than the noise.
"""


@single_threaded
def calibrate_from_frames(
    prior: SnapshotCalibration,
    *,
    flats: Any = None,
    stars: Any = None,
    noise: float,
    photon_variance: float = 0.0,
) -> SnapshotCalibration:
    """Calibrate a snapshot spectral camera from pictures of an even surface and of a star.

    Flat frames give the ratios between the channels. Star frames through the coded pattern give
    the PSFs' centres relative to each other, the size of the coded PSFs, and the zeroth order. All
    parameters are fitted together by least squares, weighted by the noise, with the prior.

    Parameters
    ----------
    prior : SnapshotCalibration
        What is known before, as of `SnapshotCalibration.nominal`.
    flats : torch.Tensor or numpy.ndarray, (bands, rows, columns), optional
        Raw frame of an evenly lit white surface for each band, less the dark frame, in any unit.
    stars : torch.Tensor or numpy.ndarray, (bands, rows, columns), optional
        Raw frame of a point source through the coded pattern for each band, less the dark frame,
        of the same pixels in all bands. Nothing may be clipped.
    noise : float
        Standard deviation of a dark pixel of these frames, in their unit, above 0.
    photon_variance : float, default 0
        Variance of photon noise over light, in the frames' unit: that of one electron.

    Returns
    -------
    SnapshotCalibration
        The calibration with its uncertainty, which grows with misfits beyond the noise.

    Raises
    ------
    ValueError
        Without frames, or for frames of another shape, too small or not finite, for noise that
        isn't positive, or for a negative photon variance.
    """
    require_positive("noise", noise, "in the frames' unit")
    if not 0 <= photon_variance < np.inf:
        raise ValueError(f"photon_variance is {photon_variance:g}; it must be finite, 0 or more")
    groups = list[FrameGroup]()
    if flats is not None:
        groups.append(FlatFrames.create(prior.model, flats))
    if stars is not None:
        groups.append(StarFrames.create(prior.model, stars))
    if not groups:
        raise ValueError("neither flats nor stars are given; give frames of one kind or both")
    fit = _JointFit(prior, groups, noise, photon_variance)
    deviation, covariance = fit.solve()
    if stars is not None:
        covariance = covariance + torch.diag(_interpolation_variance(prior.model))
    return prior.with_estimates(deviation, covariance, "frames")


class _JointFit:
    """The least-squares fit of a snapshot camera's parameters to calibration frames.

    Unknown are the parameters, as standard normal variables of the prior, and the light of each
    frame.
    """

    def __init__(
        self,
        prior: SnapshotCalibration,
        groups: list[FrameGroup],
        noise: float,
        photon_variance: float,
    ) -> None:
        self._prior, self._groups = prior, groups
        self._noise, self._photon_variance = noise, photon_variance
        self._root = torch.linalg.cholesky(prior.covariance)
        self._count = prior.model.layout.count

    def solve(self) -> tuple[torch.Tensor, torch.Tensor]:
        """Return the calibrated deviations of the snapshot model and their covariance."""
        standard = torch.zeros(self._count, dtype=torch.float64)
        unknown = torch.cat([standard, *self._first_lights()])
        spreads = self._spreads(unknown)
        for _ in range(_PASSES):
            found = least_squares(
                partial(_apply_to_array, partial(self._residuals, spreads)),
                unknown.numpy(),
                jac=partial(_apply_to_array, partial(self._jacobian, spreads)),
                x_scale="jac",
            )
            unknown = torch.from_numpy(found.x)
            spreads = self._spreads(unknown)
        return self._deviation(unknown), self._covariance(unknown, spreads)

    def _first_lights(self) -> list[torch.Tensor]:
        """Return the light of each calibration frame that fits the snapshot's prior best."""
        predicted = [one.predict(self._prior.deviation) for one in self._groups]
        return [
            (one.counts * seen * one.measured).sum(1) / (one.counts * seen.square()).sum(1)
            for one, seen in zip(self._groups, predicted, strict=True)
        ]

    def _deviation(self, unknown: torch.Tensor) -> torch.Tensor:
        """Return the snapshot model's deviations for the calibration fit's unknowns."""
        return self._prior.deviation + self._root @ unknown[: self._count]

    def _predictions(self, unknown: torch.Tensor) -> list[torch.Tensor]:
        """Return the samples of each kind of calibration frames that the fit's model predicts."""
        deviation = self._deviation(unknown)
        lights = unknown[self._count :].reshape(len(self._groups), -1, 1)
        return [
            light * group.predict(deviation)
            for light, group in zip(lights, self._groups, strict=True)
        ]

    def _spreads(self, unknown: torch.Tensor) -> list[torch.Tensor]:
        """Return the standard deviation of each sample of the calibration frames."""
        spreads = []
        for group, light in zip(self._groups, self._predictions(unknown), strict=True):
            bright = light.clamp(min=0)
            pixel = (self._noise**2 + self._photon_variance * bright) / group.counts
            spreads.append((pixel + group.model_variance(bright)).sqrt())
        return spreads

    def _residuals(self, spreads: list[torch.Tensor], unknown: torch.Tensor) -> torch.Tensor:
        """Return the calibration fit's residuals over their deviations, and the prior's."""
        left = [
            ((light - one.measured) / spread).flatten()
            for one, light, spread in zip(
                self._groups, self._predictions(unknown), spreads, strict=True
            )
        ]
        return torch.cat([*left, unknown[: self._count]])

    def _jacobian(self, spreads: list[torch.Tensor], unknown: torch.Tensor) -> torch.Tensor:
        """Return the derivatives of the calibration fit's residuals, (residuals, unknowns)."""
        deviation, parts, first = self._deviation(unknown), list[torch.Tensor](), self._count
        for group, spread in zip(self._groups, spreads, strict=True):
            bands, samples = group.measured.shape
            lights = unknown[first : first + bands]
            part = torch.zeros(bands, samples, len(unknown), dtype=torch.float64)
            slopes = group.derivatives(deviation) @ self._root
            part[..., : self._count] = slopes * lights[:, None, None]
            predicted = group.predict(deviation)
            for band in range(bands):
                part[band, :, first + band] = predicted[band]
            parts.append((part / spread[..., None]).flatten(0, 1))
            first += bands
        return torch.cat([*parts, torch.eye(self._count, len(unknown), dtype=torch.float64)])

    def _covariance(self, unknown: torch.Tensor, spreads: list[torch.Tensor]) -> torch.Tensor:
        """Return the covariance of the calibrated deviations of the snapshot model.

        Where frames of a kind misfit by more than the noise, their variance is larger in
        proportion.
        """
        jacobian, residuals = self._jacobian(spreads, unknown), self._residuals(spreads, unknown)
        information = jacobian[-self._count :].mT @ jacobian[-self._count :]
        first = 0
        for group in self._groups:
            rows = slice(first, first + group.measured.numel())
            first = rows.stop
            misfit = _CAUTION * max(float(residuals[rows].square().mean()), 1.0)
            information = information + jacobian[rows].mT @ jacobian[rows] / misfit
        inverse = torch.linalg.inv(information)[: self._count, : self._count]
        return self._root @ inverse @ self._root.mT


def _apply_to_array(function: Any, unknown: NDArray[np.float64]) -> NDArray[np.float64]:
    """Apply a function of a calibration fit's unknowns to an array, for scipy."""
    result: NDArray[np.float64] = function(torch.from_numpy(unknown)).numpy()
    return result


def _interpolation_variance(model: SnapshotModel) -> torch.Tensor:
    """Return the variance that interpolation adds to a snapshot model's parameters."""
    rows, columns = model.coded.shape[1:]
    y = torch.arange(rows, dtype=torch.float64) - rows // 2
    x = torch.arange(columns, dtype=torch.float64) - columns // 2
    distance = y[:, None].square() + x.square()
    radius = float((model.coded.clamp(min=0) * distance).sum((1, 2)).mean().sqrt())
    variance = torch.zeros(model.layout.count, dtype=torch.float64)
    variance[model.layout.scale] = (_SCALE_ERROR / max(radius, 1.0)) ** 2
    variance[model.layout.centres] = _CENTRE_ERROR**2
    return variance
