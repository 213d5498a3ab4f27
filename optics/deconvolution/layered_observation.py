"""The observation of a scene with several depth layers, each blurred by its own PSF."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import torch
from scipy.ndimage import distance_transform_edt

from optics.deconvolution.noise import PowerLaw, fit_power_law_with_mtf
from optics.deconvolution.observation import Observation, require_psf
from optics.operators.blur import Border, transfer_function
from optics.operators.gram import squared_modulus
from optics.operators.varying import layer_weights
from optics.plane import centred_pad
from optics.validation import accepts_numpy, as_floating_point, require_finite

_SHARE_TOLERANCE = 1e-3
"""Largest deviation from 1 of the sum of a pixel's shares."""


@dataclass(frozen=True, eq=False)
class LayeredObservation(Observation):
    """The photograph of a scene with several depth layers: see build_layered_observation().

    `psf` is the mean of all PSFs. `psfs` holds the PSF of each layer, (layers, rows, columns).
    `shares` is the share of each layer in each pixel of the photograph, (layers, rows, columns).
    """

    psfs: torch.Tensor = field(default_factory=lambda: torch.empty(0))
    shares: torch.Tensor = field(default_factory=lambda: torch.empty(0))

    @cached_property
    def areas(self) -> torch.Tensor:
        """The share of the photograph that each deconvolved depth layer covers, (layers,)."""
        return self.shares.mean((-2, -1))

    @property
    def psf_offset(self) -> tuple[int, int]:
        """0: the map of depth layers to deconvolve holds where the PSFs put the picture."""
        return 0, 0

    @cached_property
    def period_shares(self) -> torch.Tensor:
        """The depth layers' shares on the whole period of the deconvolution.

        Pixels beyond the frame have the shares of the nearest pixel in it.
        """
        rows, columns = (
            (torch.arange(whole) - (whole // 2 - n // 2)).clamp(0, n - 1)
            for whole, n in zip(self.period_shape, self.image.shape, strict=True)
        )
        return self.shares[:, rows][:, :, columns]

    @cached_property
    def squared_mtf(self) -> torch.Tensor:
        """The depth layers' mean squared MTF on the deconvolution's period, weighted by area."""
        return self._squared_mtf_on(self.period_shape)

    def _fitted_power_law(self) -> PowerLaw:
        """Fit the power law and noise of a photograph whose depth layers are to be deconvolved.

        The spectra of the layers add in power.
        """
        shape = (int(self.image.shape[0]), int(self.image.shape[1]))
        image = self.inpainted_image * self.psf_sum
        law = fit_power_law_with_mtf(image, self._squared_mtf_on(shape))
        # Fine detail of a sharp layer looks like noise. Therefore the noise is estimated in the
        # most blurred layer, if that covers enough of the frame.
        powers = squared_modulus(transfer_function(self.psfs / self.psf_sum, shape))
        dullest = int(powers.mean((-2, -1)).argmin())
        region = _interior_window(self.shares[dullest])
        if float(region.mean()) < 0.02:
            return law
        dull = fit_power_law_with_mtf(image, powers[dullest], region)
        return replace(
            law,
            noise_variance=dull.noise_variance,
            model_error_variance=dull.model_error_variance,
        )

    def as_single_layer(self, number: int) -> Observation:
        """Return the deconvolution's observation with one depth layer's PSF everywhere."""
        return Observation(
            self.image, self.psfs[number], self.noise, self.border, self.weights, self.clipped
        )

    def _squared_mtf_on(self, shape: tuple[int, int]) -> torch.Tensor:
        """Compute the depth layers' mean squared MTF for deconvolution on a given period."""
        powers = squared_modulus(transfer_function(self.psfs / self.psf_sum, shape))
        return (self.areas[:, None, None] * powers).sum(0)


def _interior_window(share: torch.Tensor) -> torch.Tensor:
    """Compute a smooth window inside a depth layer of a photograph to be deconvolved.

    The window rises from the layer's edge over 16 pixels.
    """
    depth = distance_transform_edt(np.pad(share.numpy() > 1 - _SHARE_TOLERANCE, 1, mode="edge"))
    rise = torch.from_numpy(depth[1:-1, 1:-1] / 16).clamp(0, 1)
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
    """Build the deconvolution's observation of depth layers, each blurred by its own PSF.

    Arrays may be of any kind. The photograph is restored in double precision if `image` is double,
    otherwise in single precision.

    Parameters
    ----------
    image : torch.Tensor or numpy.ndarray, (rows, columns)
        The photograph, light per pixel.
    psfs : torch.Tensor or numpy.ndarray, (layers, rows, columns), or a sequence of (rows, columns)
        PSF of each layer, origin at n // 2. The nearest layer comes first if layers hide each
        other.
    layers : torch.Tensor or numpy.ndarray
        Number of the layer that each pixel shows, (rows, columns), whole numbers from 0. Or the
        share of each layer in each pixel, (layers, rows, columns), not negative; the shares of a
        pixel add up to 1.
    noise : float, optional
        Standard deviation of a pixel of weight 1. Estimated from the photograph if None.
    border : {"unknown", "dark", "periodic"}, default "unknown"
        What the scene does beyond the frame: see `Observation`.
    weights : torch.Tensor or numpy.ndarray, (rows, columns), optional
        Weight of each pixel in the data term: see `Observation`.
    clipped : torch.Tensor or numpy.ndarray of bool, (rows, columns), optional
        True where the well was full.

    Returns
    -------
    LayeredObservation
        An observation that `restore` takes. Its `psf` is the mean of all PSFs by area.

    Raises
    ------
    ValueError
        If shapes don't fit, if shares are negative or their sum differs from 1 by more than 1e-3,
        if a PSF has no light, or if `Observation` raises it.
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
        psfs=stacked,
        shares=shares,
    )


def _layer_shares(layers: torch.Tensor, count: int, shape: tuple[int, ...]) -> torch.Tensor:
    """Check the depth layers of a deconvolution; return their shares (layers, rows, columns).

    `layers` is a map of layer numbers, (rows, columns), or the shares themselves.
    """
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
