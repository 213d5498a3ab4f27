"""A photograph of several depths, each blurred by a PSF of its own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import torch
from scipy.ndimage import distance_transform_edt

from optics.deconvolution.blurred import Blurred, require_psf
from optics.deconvolution.noise import PowerLaw, spectrum_through, squared
from optics.edge import floating, require_finite, tensors_inside
from optics.operators.blur import Border, transfer_function
from optics.operators.varying import layer_weights
from optics.plane import centred_pad

_ADDING_UP = 1e-3
"""By which shares of a place may miss 1."""

_RISE, _ENOUGH = 16, 0.02
"""Pixels over which a layer's window rises; share of the frame that it must have to tell noise."""


@dataclass(frozen=True, eq=False)
class Layered(Blurred):
    """What a camera measured of a scene of several depths: see layered(). psf is the mean of all.

    psfs: (layers, rows, columns), on the photograph's scale. shares: how much of each pixel of the
    photograph is which layer, (layers, rows, columns).
    """

    psfs: torch.Tensor = field(default_factory=lambda: torch.empty(0))
    shares: torch.Tensor = field(default_factory=lambda: torch.empty(0))

    @cached_property
    def areas(self) -> torch.Tensor:
        """Share of the frame that is each layer, (layers,)."""
        return self.shares.mean((-2, -1))

    @cached_property
    def around(self) -> torch.Tensor:
        """The layers of the whole period: beyond the frame those of the nearest pixel of it."""
        rows, columns = (
            (torch.arange(whole) - (whole // 2 - n // 2)).clamp(0, n - 1)
            for whole, n in zip(self.whole, self.image.shape, strict=True)
        )
        return self.shares[:, rows][:, :, columns]

    @cached_property
    def power(self) -> torch.Tensor:
        """Mean of |H|² on the whole period."""
        return self._let(self.whole)

    @cached_property
    def law(self) -> PowerLaw:
        """What the photograph's spectrum shows, on the photograph's scale: layers add powers."""
        shape = (int(self.image.shape[0]), int(self.image.shape[1]))
        image = self.filled * self.gain
        law = spectrum_through(image, self._let(shape))
        # The sharpest layer's detail looks like noise, the most blurred one's doesn't.
        powers = squared(transfer_function(self.psfs / self.gain, shape))
        dullest = int(powers.mean((-2, -1)).argmin())
        region = _inside(self.shares[dullest])
        if float(region.mean()) < _ENOUGH:
            return law
        return replace(law, noise=spectrum_through(image, powers[dullest], region).noise)

    def layer(self, number: int) -> Blurred:
        """The photograph as if all of it were that layer."""
        return Blurred(
            self.image, self.psfs[number], self.noise, self.border, self.weights, self.clipped
        )

    def _let(self, shape: tuple[int, int]) -> torch.Tensor:
        powers = squared(transfer_function(self.psfs / self.gain, shape))
        return (self.areas[:, None, None] * powers).sum(0)


def _inside(share: torch.Tensor) -> torch.Tensor:
    """A window that rises smoothly from where a layer ends, over a few pixels."""
    depth = distance_transform_edt(np.pad(share.numpy() > 1 - _ADDING_UP, 1, mode="edge"))
    rise = torch.from_numpy(depth[1:-1, 1:-1] / _RISE).clamp(0, 1)
    return (torch.pi * rise / 2).sin().square()


@tensors_inside
def layered(
    image: torch.Tensor,
    psfs: torch.Tensor | Sequence[torch.Tensor],
    layers: torch.Tensor,
    noise: float | None = None,
    border: Border = "unknown",
    weights: torch.Tensor | None = None,
    clipped: torch.Tensor | None = None,
) -> Layered:
    """A photograph of several depths, of arrays of any kind; beside these see Blurred.

    psfs: of each layer, (rows, columns) each, origin at n // 2; the nearest first where one hides
    another. layers: which one is seen at each pixel of the photograph, (rows, columns) whole
    numbers from 0; or how much of each, (layers, rows, columns), not negative, adding up to 1.
    Raises ValueError for what doesn't fit.
    """
    image = floating(image)
    each = [torch.as_tensor(psf).to(image) for psf in psfs]
    if not each or any(psf.ndim != 2 for psf in each):
        raise ValueError("psfs must be one or more, each (rows, columns)")
    for psf in each:
        require_psf(psf)
    size = [max(psf.shape[axis] for psf in each) for axis in (0, 1)]
    stacked = torch.stack([centred_pad(psf, size) for psf in each])
    shares = _shares(torch.as_tensor(layers), len(each), tuple(image.shape)).to(image)
    mean = (shares.mean((-2, -1))[:, None, None] * stacked).sum(0)
    return Layered(
        image,
        mean,
        noise if noise is None else float(noise),
        border,
        weights if weights is None else weights.to(image),
        clipped if clipped is None else clipped.to(torch.bool),
        stacked,
        shares,
    )


def _shares(layers: torch.Tensor, count: int, shape: tuple[int, ...]) -> torch.Tensor:
    """(layers, rows, columns)."""
    require_finite("layers", layers)
    if tuple(layers.shape) == shape:
        return layer_weights(layers, count)
    if tuple(layers.shape) != (count, *shape):
        raise ValueError(
            f"layers are {tuple(layers.shape)}; with {count} PSFs and an image of {shape} they "
            f"must be {shape} or {(count, *shape)}"
        )
    missed = float((layers.sum(0) - 1).abs().max())
    if float(layers.min()) < 0 or missed > _ADDING_UP:
        raise ValueError(
            f"layers miss 1 by {missed:.2g} in places, or are negative; at each pixel they must "
            "add up to 1"
        )
    return layers
