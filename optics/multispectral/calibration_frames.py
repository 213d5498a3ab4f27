"""Frames that calibrate a snapshot spectral camera: even surfaces and a star, as samples to fit."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch

from optics.fourier import irfft2, rfft2
from optics.inverse.blur import transfer_function
from optics.multispectral.snapshot_model import SnapshotModel
from optics.validation import require_finite, require_unmasked

_PSF_ERROR = 0.03
"""Standard deviation of what interpolation leaves wrong of a PSF's pixel, relative to the brightest
of the pixels around it. Measured with rings and peaks of 0.6 pixels."""


class FrameGroup:
    """Base class of the calibration frames of one kind, whose light a snapshot model predicts.

    Attributes
    ----------
    measured : torch.Tensor, (bands, samples), float64
        What was measured.
    counts : torch.Tensor, (samples,) or (1,), float64
        Number of pixels that each sample is the mean of.
    """

    measured: torch.Tensor
    counts: torch.Tensor

    def predict(self, deviation: torch.Tensor) -> torch.Tensor:
        """Return the snapshot camera's samples, (bands, samples), for a light source of 1."""
        raise NotImplementedError

    def derivatives(self, deviation: torch.Tensor) -> torch.Tensor:
        """Return the derivatives of predict() by the snapshot camera's parameters.

        They are (bands, samples, parameters).
        """
        raise NotImplementedError

    def model_variance(self, light: torch.Tensor) -> torch.Tensor:
        """Return the variance of what the snapshot model can't follow in samples of this light."""
        return torch.zeros_like(light)


@dataclass(frozen=True, eq=False)
class FlatFrames(FrameGroup):
    """Flat calibration frames of a snapshot camera, as the mean of each channel's pixels.

    Attributes
    ----------
    model : SnapshotModel
        The camera's model.
    measured : torch.Tensor, (bands, channels), float64
        Mean of each channel's pixels.
    counts : torch.Tensor, (channels,), float64
        Number of each channel's pixels.
    """

    model: SnapshotModel
    measured: torch.Tensor
    counts: torch.Tensor

    @classmethod
    def create(cls, model: SnapshotModel, frames: Any) -> FlatFrames:
        """Average the pixels of each channel of a snapshot camera's flat frames.

        `frames` are (bands, rows, columns), of any kind.
        """
        frames = _as_frames("flats", frames, model)
        chosen = model.channel_masks(frames.shape[1:])
        counts = chosen.sum((1, 2))
        if not bool((counts > 0).all()):
            raise ValueError(
                f"flats are {tuple(frames.shape)}; each frame must hold the whole pattern"
            )
        return cls(model, torch.einsum("cyx,byx->bc", chosen, frames) / counts, counts)

    def predict(self, deviation: torch.Tensor) -> torch.Tensor:
        return self.model.response_at(deviation).mT

    def derivatives(self, deviation: torch.Tensor) -> torch.Tensor:
        found = torch.zeros(*self.measured.shape, self.model.layout.count, dtype=torch.float64)
        _set_by_band(found, self.model.layout.ratio_places, self.model.response_slopes(deviation))
        return found


@dataclass(frozen=True, eq=False)
class StarFrames(FrameGroup):
    """Star frames of a snapshot camera, cut to the pixels that its PSFs reach.

    Attributes
    ----------
    model : SnapshotModel
        The camera's model.
    measured : torch.Tensor, (bands, pixels), float64
        The pixels around the star.
    counts : torch.Tensor, (1,), float64
        1: each sample is a pixel.
    channel_masks : torch.Tensor, (channels, rows, columns), float64
        1 where a pixel around the star has the channel's filter, else 0.
    """

    model: SnapshotModel
    measured: torch.Tensor
    counts: torch.Tensor
    channel_masks: torch.Tensor

    @classmethod
    def create(cls, model: SnapshotModel, frames: Any) -> StarFrames:
        """Find the star of a snapshot camera's frames, and cut the frames around it.

        `frames` are (bands, rows, columns), of any kind.
        """
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

    def predict(self, deviation: torch.Tensor) -> torch.Tensor:
        seen = torch.einsum("cyx,cb->byx", self.channel_masks, self.model.response_at(deviation))
        return (seen * self.model.psfs(deviation)).flatten(1)

    def derivatives(self, deviation: torch.Tensor) -> torch.Tensor:
        model, masks = self.model, self.channel_masks
        found = torch.zeros(*self.measured.shape, model.layout.count, dtype=torch.float64)
        seen = torch.einsum("cyx,cb->byx", masks, model.response_at(deviation))
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
    """Set derivatives of calibration samples, (bands, samples, parameters), by band and parameter.

    `places` are the parameters' places, (kinds, bands), and `slopes` are (kinds, samples, bands).
    """
    for place, slope in zip(places, slopes, strict=True):
        for band, number in enumerate(place.tolist()):
            found[band, :, number] = slope[:, band]


def _star_corner(model: SnapshotModel, frames: torch.Tensor, sides: list[int]) -> tuple[int, int]:
    """Find the first pixel (row, column) of the window around the star of calibration frames.

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
    """Return calibration frames of a snapshot camera as a tensor in double precision."""
    require_unmasked(frames)
    tensor = torch.as_tensor(np.asarray(frames)).to(torch.float64)
    require_finite(name, tensor)
    if tensor.ndim != 3 or len(tensor) != model.bands:
        raise ValueError(
            f"{name} are {tuple(tensor.shape)}; give (bands, rows, columns) with {model.bands} "
            "bands"
        )
    return tensor
