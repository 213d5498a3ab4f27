"""A photograph of several depths, each blurred by a PSF of its own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import torch
from scipy.ndimage import distance_transform_edt

from optics.deconvolution.noise import PowerLaw, fit_power_law_with_mtf, squared_modulus
from optics.deconvolution.observation import Observation, require_psf
from optics.operators.blur import Border, transfer_function
from optics.operators.varying import layer_weights
from optics.plane import centred_pad
from optics.validation import accepts_numpy, as_floating_point, require_finite

_SHARE_TOLERANCE = 1e-3
"""By which shares of a place may miss 1."""

_RISE, _MIN_WINDOW_SHARE = 16, 0.02
"""Pixels over which a layer's window rises; share of the frame that it must have to tell noise."""


@dataclass(frozen=True, eq=False)
class LayeredObservation(Observation):
    """What a camera measured of a scene of several depths: see build_layered_observation().

    psf: the mean of all. psfs: (layers, rows, columns), on the photograph's scale. shares: how much
    of each pixel of the photograph is which layer, (layers, rows, columns).
    """

    psfs: torch.Tensor = field(default_factory=lambda: torch.empty(0))
    shares: torch.Tensor = field(default_factory=lambda: torch.empty(0))

    @cached_property
    def areas(self) -> torch.Tensor:
        """Share of the frame that is each layer, (layers,)."""
        return self.shares.mean((-2, -1))

    @cached_property
    def period_shares(self) -> torch.Tensor:
        """The layers of the whole period: beyond the frame those of the nearest pixel of it."""
        rows, columns = (
            (torch.arange(whole) - (whole // 2 - n // 2)).clamp(0, n - 1)
            for whole, n in zip(self.period_shape, self.image.shape, strict=True)
        )
        return self.shares[:, rows][:, :, columns]

    @cached_property
    def squared_mtf(self) -> torch.Tensor:
        """Mean of |H|² on the whole period."""
        return self._squared_mtf_on(self.period_shape)

    @cached_property
    def power_law(self) -> PowerLaw:
        """What the photograph's spectrum shows, on the photograph's scale: layers add powers."""
        shape = (int(self.image.shape[0]), int(self.image.shape[1]))
        image = self.inpainted_image * self.psf_sum
        law = fit_power_law_with_mtf(image, self._squared_mtf_on(shape))
        # The sharpest layer's detail looks like noise, the most blurred one's doesn't.
        powers = squared_modulus(transfer_function(self.psfs / self.psf_sum, shape))
        dullest = int(powers.mean((-2, -1)).argmin())
        region = _interior_window(self.shares[dullest])
        if float(region.mean()) < _MIN_WINDOW_SHARE:
            return law
        return replace(
            law,
            noise_variance=fit_power_law_with_mtf(image, powers[dullest], region).noise_variance,
        )

    def as_single_layer(self, number: int) -> Observation:
        """The photograph as if all of it were that layer."""
        return Observation(
            self.image, self.psfs[number], self.noise, self.border, self.weights, self.clipped
        )

    def _squared_mtf_on(self, shape: tuple[int, int]) -> torch.Tensor:
        powers = squared_modulus(transfer_function(self.psfs / self.psf_sum, shape))
        return (self.areas[:, None, None] * powers).sum(0)


def _interior_window(share: torch.Tensor) -> torch.Tensor:
    """A window that rises smoothly from where a layer ends, over a few pixels."""
    depth = distance_transform_edt(np.pad(share.numpy() > 1 - _SHARE_TOLERANCE, 1, mode="edge"))
    rise = torch.from_numpy(depth[1:-1, 1:-1] / _RISE).clamp(0, 1)
    return (torch.pi * rise / 2).sin().square()


@accepts_numpy
def build_layered_observation(
    image: torch.Tensor,
    psfs: torch.Tensor | Sequence[torch.Tensor],
    layers: torch.Tensor,
    noise: float | None = None,
    border: Border = "unknown",
    weights: torch.Tensor | None = None,
    clipped: torch.Tensor | None = None,
) -> LayeredObservation:
    """Build the observation of a scene of several depths, each blurred by its own PSF.

    Arrays may be of any kind. The photograph is restored in double precision if `image` is double,
    otherwise in single precision.

    Parameters
    ----------
    image : torch.Tensor or numpy.ndarray, (rows, columns)
        The photograph, light per pixel.
    psfs : torch.Tensor or numpy.ndarray, (layers, rows, columns), or a sequence of (rows, columns)
        PSF of each layer, origin at n // 2; the nearest layer first where one hides another.
    layers : torch.Tensor or numpy.ndarray
        Which layer is seen at each pixel: whole numbers from 0, (rows, columns). Or how much of
        each layer: shares, (layers, rows, columns), not negative, that add up to 1 at each pixel.
    noise : float, optional
        Standard deviation of a pixel of weight 1. Estimated from the photograph if None.
    border : {"unknown", "dark", "periodic"}, default "unknown"
        What the scene does beyond the frame: see `Observation`.
    weights : torch.Tensor or numpy.ndarray, (rows, columns), optional
        How much each pixel is to be trusted: see `Observation`.
    clipped : torch.Tensor or numpy.ndarray of bool, (rows, columns), optional
        True where the well was full.

    Returns
    -------
    LayeredObservation
        An observation that `restore` takes. Its `psf` is the mean of all PSFs by area.

    Raises
    ------
    ValueError
        If shapes don't fit, shares are negative or miss 1 by more than 1e-3, a PSF sends no light,
        or `Observation` refuses what is given.
    """
    image = as_floating_point(image)
    each = [torch.as_tensor(psf).to(image) for psf in psfs]
    if not each or any(psf.ndim != 2 for psf in each):
        raise ValueError("psfs must be one or more, each (rows, columns)")
    for psf in each:
        require_psf(psf)
    size = [max(psf.shape[axis] for psf in each) for axis in (0, 1)]
    stacked = torch.stack([centred_pad(psf, size) for psf in each])
    shares = _layer_shares(torch.as_tensor(layers), len(each), tuple(image.shape)).to(image)
    mean = (shares.mean((-2, -1))[:, None, None] * stacked).sum(0)
    return LayeredObservation(
        image,
        mean,
        noise if noise is None else float(noise),
        border,
        weights if weights is None else weights.to(image),
        clipped if clipped is None else clipped.to(torch.bool),
        stacked,
        shares,
    )


def _layer_shares(layers: torch.Tensor, count: int, shape: tuple[int, ...]) -> torch.Tensor:
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
    if float(layers.min()) < 0 or missed > _SHARE_TOLERANCE:
        raise ValueError(
            f"layers miss 1 by {missed:.2g} in places, or are negative; at each pixel they must "
            "add up to 1"
        )
    return layers
