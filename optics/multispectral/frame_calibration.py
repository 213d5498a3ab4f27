"""Calibrate a snapshot camera from frames of even surfaces and of a star."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.optimize import least_squares

from optics.fourier import irfft2, rfft2
from optics.inverse.blur import transfer_function
from optics.multispectral.snapshot_calibration import SnapshotCalibration
from optics.multispectral.snapshot_model import SnapshotModel
from optics.threads import single_threaded
from optics.validation import as_finite_array, require_positive

# Standard deviation of what interpolation leaves wrong of a PSF's pixel, relative to the brightest
# of the pixels around it. Measured with rings and peaks of 0.6 pixels.
_PSF_ERROR = 0.03


@dataclass(frozen=True, eq=False)
class FlatFrames:
    """Flat frames, whose samples are the means of each channel's pixels.

    measured: (bands, samples), float64. counts: pixels that each sample is the mean of, (samples,).
    """

    model: SnapshotModel
    measured: torch.Tensor
    counts: torch.Tensor

    @classmethod
    def create(cls, model: SnapshotModel, frames: Any) -> FlatFrames:
        """Average the pixels of each channel; `frames` are (bands, rows, columns), of any kind."""
        frames = _as_frames("flats", frames, model)
        chosen = model.channel_masks(frames.shape[1:])
        counts = chosen.sum((1, 2))
        if not bool((counts > 0).all()):
            raise ValueError(
                f"flats are {tuple(frames.shape)}; each frame must hold the whole pattern"
            )
        return cls(model, torch.einsum("cyx,byx->bc", chosen, frames) / counts, counts)

    def predict(self, deviation: torch.Tensor) -> torch.Tensor:
        """Return the samples, (bands, samples), for a light source of 1."""
        return self.model.response_at(deviation).mT

    def derivatives(self, deviation: torch.Tensor) -> torch.Tensor:
        """Return the derivatives of predict() by the parameters, (bands, samples, parameters)."""
        found = torch.zeros(*self.measured.shape, self.model.layout.count, dtype=torch.float64)
        _set_by_band(found, self.model.layout.ratio_places, self.model.response_slopes(deviation))
        return found

    def model_variance(self, light: torch.Tensor) -> torch.Tensor:
        """Return the variance of what the model can't follow in samples of this light."""
        return torch.zeros_like(light)


@dataclass(frozen=True, eq=False)
class StarFrames(FlatFrames):
    """Star frames, cut to the pixels that the PSFs reach; each pixel is a sample.

    channel_masks: 1 where a pixel around the star has the channel's filter, else 0; (channels,
        rows, columns), float64.
    """

    channel_masks: torch.Tensor

    @classmethod
    def create(cls, model: SnapshotModel, frames: Any) -> StarFrames:
        """Find the star, and cut the frames, (bands, rows, columns), around it."""
        frames = _as_frames("stars", frames, model)
        sides = [n + 2 * model.margin for n in model.coded.shape[1:]]
        if any(n < side for n, side in zip(frames.shape[1:], sides, strict=True)):
            raise ValueError(
                f"stars are {tuple(frames.shape)}; each frame must have {sides[0]} x {sides[1]} "
                "pixels or more, so that the PSFs and some pixels around them lie in it"
            )
        row, column = _star_corner(model, frames, sides)
        window = (slice(None), slice(row, row + sides[0]), slice(column, column + sides[1]))
        one = torch.ones(1, dtype=torch.float64)
        return cls(
            model, frames[window].flatten(1), one, model.channel_masks(frames.shape[1:])[window]
        )

    def _seen_shares(self, deviation: torch.Tensor) -> torch.Tensor:
        """Return the share of each band that each pixel sees, (bands, rows, columns)."""
        return torch.einsum("cyx,cb->byx", self.channel_masks, self.model.response_at(deviation))

    def predict(self, deviation: torch.Tensor) -> torch.Tensor:
        return (self._seen_shares(deviation) * self.model.psfs(deviation)).flatten(1)

    def derivatives(self, deviation: torch.Tensor) -> torch.Tensor:
        model, masks, seen = self.model, self.channel_masks, self._seen_shares(deviation)
        found = torch.zeros(*self.measured.shape, model.layout.count, dtype=torch.float64)
        by_psf = (model.psf_slopes(deviation) * seen).flatten(2).transpose(1, 2)
        _set_by_band(found, model.layout.band_places, by_psf)
        sensitivity = torch.einsum("cyx,rcb->rbyx", masks, model.response_slopes(deviation))
        by_ratio = (sensitivity * model.psfs(deviation)).flatten(2).transpose(1, 2)
        _set_by_band(found, model.layout.ratio_places, by_ratio)
        return found

    def model_variance(self, light: torch.Tensor) -> torch.Tensor:
        around = light.reshape(-1, 1, *self.channel_masks.shape[1:])
        brightest = torch.nn.functional.max_pool2d(around, 3, 1, 1).flatten(1)
        return (_PSF_ERROR * brightest).square()


def _set_by_band(found: torch.Tensor, places: torch.Tensor, slopes: torch.Tensor) -> None:
    """Set derivatives of samples, (bands, samples, parameters), by band and parameter.

    `places` are the parameters' places, (kinds, bands), and `slopes` are (kinds, samples, bands).
    """
    for place, slope in zip(places, slopes, strict=True):
        found[torch.arange(len(found)), :, place] = slope.mT


def _star_corner(model: SnapshotModel, frames: torch.Tensor, sides: list[int]) -> tuple[int, int]:
    """Find the first pixel (row, column) of the window around the star.

    Frames, each over its norm, are correlated with the nominal PSFs as seen through the mosaic.
    """
    shape = (frames.shape[1], frames.shape[2])
    filters = model.filters(model.response, shape)
    psfs = model.psfs(torch.zeros(model.layout.count, dtype=torch.float64))
    transfer = transfer_function(psfs, shape).conj()
    squares = transfer_function(psfs.square(), shape).conj()
    norms = frames.square().sum((1, 2), keepdim=True).sqrt().clamp(min=1e-300)
    likeness = irfft2(rfft2(frames * filters / norms) * transfer, shape).sum(0)
    power = irfft2(rfft2(filters.square()) * squares, shape).sum(0)
    likeness = likeness / power.clamp(min=1e-300).sqrt()
    first = [side // 2 for side in sides]
    count = [n - side + 1 for n, side in zip(shape, sides, strict=True)]
    inside = likeness[first[0] : first[0] + count[0], first[1] : first[1] + count[1]]
    return divmod(int(inside.argmax()), count[1])


def _as_frames(name: str, frames: Any, model: SnapshotModel) -> torch.Tensor:
    """Return frames in double precision, one for each band."""
    axes = f"(bands, rows, columns) with {model.bands} bands"
    tensor = as_finite_array(name, frames, axes)
    if len(tensor) != model.bands:
        raise ValueError(f"{name} are {tuple(tensor.shape)}; give {axes}")
    return tensor


_PASSES = 3  # fits, each with the last one's noise; a third changes less than 1 % of a deviation

# Factor on the variance of all samples. Without it, intervals hold as often as they say on average
# over 31 parameters and 40 cameras; with it, those of the worst parameter do as well.
_CAUTION = 1.5

# Errors in pixels that interpolation leaves in the coded PSFs' radius and in their centres, even
# with a bright star. Measured with rings of 20 pixels, and a star 2000 times brighter than the
# noise.
_SCALE_ERROR, _CENTRE_ERROR = 0.006, 0.004


@single_threaded
def calibrate_from_frames(
    prior: SnapshotCalibration,
    *,
    flats: Any = None,
    stars: Any = None,
    noise: float,
    photon_variance: float = 0.0,
) -> SnapshotCalibration:
    """Calibrate a snapshot camera from pictures of an even surface and of a star.

    Flat frames give the ratios between the channels. Star frames through the coded pattern give
    the PSFs' centres relative to each other, the size of the coded PSFs, and the zeroth order. All
    parameters are fitted together by least squares, weighted by the noise, with the prior.

    Parameters
    ----------
    prior : SnapshotCalibration
        What is known before, as of `SnapshotCalibration.nominal`.
    flats, stars : torch.Tensor or numpy.ndarray, (bands, rows, columns), optional
        Raw frames for each band, less the dark frame, of an evenly lit white surface, in any unit;
        and of a point source through the coded pattern, of the same pixels in all bands. Nothing
        may be clipped.
    noise, photon_variance : float, default 0
        Standard deviation of a dark pixel of these frames, in their unit, above 0; variance of
        photon noise over light, in the same unit: that of one electron.

    Returns
    -------
    SnapshotCalibration
        The calibration with its uncertainty, which grows with misfits beyond the noise.

    Raises
    ------
    ValueError
        Without frames, or for frames of another shape, too small or not finite, or another number.
    """
    require_positive("noise", noise, "in the frames' unit")
    if not 0 <= photon_variance < np.inf:
        raise ValueError(f"photon_variance is {photon_variance:g}; it must be finite, 0 or more")
    groups = list[FlatFrames]()
    if flats is not None:
        groups.append(FlatFrames.create(prior.model, flats))
    if stars is not None:
        groups.append(StarFrames.create(prior.model, stars))
    if not groups:
        raise ValueError("neither flats nor stars are given; give frames of one kind or both")
    deviation, covariance = _JointFit(prior, groups, noise, photon_variance).solve()
    if stars is not None:
        covariance = covariance + torch.diag(_interpolation_variance(prior.model))
    return prior.with_estimates(deviation, covariance, "frames")


class _JointFit:
    """The least-squares fit of a camera's parameters to calibration frames.

    Unknown are the parameters, as standard normal variables of the prior, and the light of each
    frame.
    """

    def __init__(
        self,
        prior: SnapshotCalibration,
        groups: list[FlatFrames],
        noise: float,
        photon_variance: float,
    ) -> None:
        self._prior, self._groups = prior, groups
        self._noise, self._photon_variance = noise, photon_variance
        self._root = torch.linalg.cholesky(prior.covariance)
        self._count = prior.model.layout.count

    def solve(self) -> tuple[torch.Tensor, torch.Tensor]:
        """Return the estimated deviations from nominal and their covariance."""
        # The light of each frame that fits the prior best comes first.
        lights = []
        for one in self._groups:
            seen = one.predict(self._prior.deviation)
            light = (one.counts * seen * one.measured).sum(1) / (one.counts * seen.square()).sum(1)
            lights.append(light)
        unknown = torch.cat([torch.zeros(self._count, dtype=torch.float64), *lights])
        spreads = self._spreads(unknown)
        for _ in range(_PASSES):
            found = least_squares(
                _on_arrays(partial(self._residuals, spreads)),
                unknown.numpy(),
                jac=_on_arrays(partial(self._jacobian, spreads)),
                x_scale="jac",
            )
            unknown = torch.from_numpy(found.x)
            spreads = self._spreads(unknown)
        return self._deviation(unknown), self._covariance(unknown, spreads)

    def _deviation(self, unknown: torch.Tensor) -> torch.Tensor:
        return self._prior.deviation + self._root @ unknown[: self._count]

    def _predictions(self, unknown: torch.Tensor) -> list[torch.Tensor]:
        """Return the samples of each kind of frames that the model predicts."""
        deviation = self._deviation(unknown)
        lights = unknown[self._count :].reshape(len(self._groups), -1, 1)
        return [
            light * group.predict(deviation)
            for light, group in zip(lights, self._groups, strict=True)
        ]

    def _spreads(self, unknown: torch.Tensor) -> list[torch.Tensor]:
        """Return the standard deviation of each sample."""
        spreads = []
        for group, light in zip(self._groups, self._predictions(unknown), strict=True):
            bright = light.clamp(min=0)
            pixel = (self._noise**2 + self._photon_variance * bright) / group.counts
            spreads.append((pixel + group.model_variance(bright)).sqrt())
        return spreads

    def _residuals(self, spreads: list[torch.Tensor], unknown: torch.Tensor) -> torch.Tensor:
        """Return residuals over their standard deviations, and then the prior's."""
        left = [
            ((light - one.measured) / spread).flatten()
            for one, light, spread in zip(
                self._groups, self._predictions(unknown), spreads, strict=True
            )
        ]
        return torch.cat([*left, unknown[: self._count]])

    def _jacobian(self, spreads: list[torch.Tensor], unknown: torch.Tensor) -> torch.Tensor:
        """Return the derivatives of the residuals, (residuals, unknowns)."""
        deviation, parts, first = self._deviation(unknown), list[torch.Tensor](), self._count
        for group, spread in zip(self._groups, spreads, strict=True):
            bands, samples = group.measured.shape
            lights = unknown[first : first + bands]
            part = torch.zeros(bands, samples, len(unknown), dtype=torch.float64)
            slopes = group.derivatives(deviation) @ self._root
            part[..., : self._count] = slopes * lights[:, None, None]
            each = torch.arange(bands)
            part[each, :, first + each] = group.predict(deviation)
            parts.append((part / spread[..., None]).flatten(0, 1))
            first += bands
        return torch.cat([*parts, torch.eye(self._count, len(unknown), dtype=torch.float64)])

    def _covariance(self, unknown: torch.Tensor, spreads: list[torch.Tensor]) -> torch.Tensor:
        """Return the covariance of the estimated deviations.

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


def _on_arrays(
    function: Callable[[torch.Tensor], torch.Tensor],
) -> Callable[[NDArray[np.float64]], NDArray[np.float64]]:
    """Make a function of a tensor one of an array, for scipy."""
    return lambda unknown: function(torch.from_numpy(unknown)).numpy()


def _interpolation_variance(model: SnapshotModel) -> torch.Tensor:
    """Return the variance that interpolation adds to each parameter."""
    y, x = (torch.arange(n, dtype=torch.float64) - n // 2 for n in model.coded.shape[1:])
    distance = y[:, None].square() + x.square()
    radius = float((model.coded.clamp(min=0) * distance).sum((1, 2)).mean().sqrt())
    variance = torch.zeros(model.layout.count, dtype=torch.float64)
    variance[model.layout.scale] = (_SCALE_ERROR / max(radius, 1.0)) ** 2
    variance[model.layout.centres] = _CENTRE_ERROR**2
    return variance
