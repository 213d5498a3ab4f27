"""Demosaicing of all bands together, with a convex prior on luminance and colour differences."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import torch

from optics.deconvolution.band_coupling import BandCoupling
from optics.deconvolution.derivatives import CURVATURE
from optics.deconvolution.frequency_step import frequency_step
from optics.deconvolution.priors import DerivativePenalty
from optics.deconvolution.splitting import SplittingSettings, solve_by_splitting
from optics.demosaicing.mosaic_observation import MosaicObservation
from optics.progress import Progress
from optics.threads import single_threaded
from optics.validation import require_count, require_positive


@dataclass(frozen=True)
class DemosaicingSettings:
    """Tune the prior and the splitting of the demosaicing of all bands together.

    All values are chosen.

    Attributes
    ----------
    luminance : float
        Weight of the luminance's curvature relative to that of the colour differences.
    curvature_threshold : float
        Curvature that one iteration sets to zero, relative to the standard deviation of the light.
    noiseless_weight : float
        Regularisation weight of a picture without noise, relative to the scale of the light.
    noise_weight : float
        Factor of the squared relative noise, which is added to `noiseless_weight`.
    """

    luminance: float = 0.4
    curvature_threshold: float = 1.0
    noiseless_weight: float = 1e-3
    noise_weight: float = 1.8


_SETTINGS = DemosaicingSettings()


@single_threaded
@torch.no_grad()
def demosaic(
    observation: MosaicObservation,
    weight: float | None = None,
    *,
    iterations: int = 30,
    progress: Progress | None = None,
) -> Any:
    """Demosaic a raw picture: estimate all bands of each pixel of a mosaic of colour filters.

    The result x solves Eq. 4.7 of the thesis. It minimises ``|S G x - y|² / 2 + weight *
    (|w ∇²L| + |∇²C|)``, summed over the pixels, where S are the filters, G is the blur, and the
    first term counts trusted pixels only. ``|∇²L|`` is the length of the second derivatives of the
    luminance, with the weight w, and ``|∇²C|`` is the joint length of those of all colour
    differences.
    The bands of a white surface are taken to be equal. Where there is blur, `restore` undoes it
    better.

    Parameters
    ----------
    observation : MosaicObservation
        The raw picture with its filters: see `build_mosaic_observation`.
    weight : float, optional
        Regularisation weight. Chosen from the noise and the scale of the light if None.
    iterations : int, default 30
        Number of iterations, 1 or more.
    progress : Progress, optional
        Receives reports, and can cancel the work.

    Returns
    -------
    torch.Tensor or numpy.ndarray, (bands, rows, columns)
        Light of each band, an array of the raw picture's kind. Noise may make it negative.

    Raises
    ------
    ValueError
        For a weight that isn't positive, or no iteration.
    """
    if weight is not None:
        require_positive("weight", weight, "")
    require_count("iterations", iterations)
    unit, observation = observation.unit, observation.in_own_unit
    used = (
        weight / unit if weight else demosaicing_weight(observation.scene_noise, observation.scale)
    )
    prior = DerivativePenalty(
        BandCoupling.luminance_chrominance(observation.bands, _SETTINGS.luminance),
        observation.period_shape, _SETTINGS.curvature_threshold * observation.scale,
        observation.image.dtype, derivative=CURVATURE,
    )  # fmt: skip
    step, settings = frequency_step(observation, iterations), SplittingSettings(iterations, used)
    solution = solve_by_splitting(step, [prior], settings, "demosaicing", progress or Progress())
    bands = observation.crop_to_frame(solution.picture) * unit
    return bands.numpy() if observation.is_numpy else bands


def demosaicing_weight(noise: float, scale: float) -> float:
    """Return the regularisation weight that demosaicing takes by default.

    Parameters
    ----------
    noise : float
        Standard deviation of a pixel.
    scale : float
        Standard deviation of the light over the picture, in the same unit.

    Returns
    -------
    float
        In that unit. Parts of a picture that are demosaiced by themselves need one in common.
    """
    return scale * (_SETTINGS.noiseless_weight + _SETTINGS.noise_weight * (noise / scale) ** 2)
