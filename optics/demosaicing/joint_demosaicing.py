"""Demosaicing of all bands together, with a convex prior on brightness and colour differences."""

from __future__ import annotations

from dataclasses import dataclass

import torch

from optics.deconvolution.band_coupling import BandCoupling
from optics.deconvolution.derivatives import CURVATURE
from optics.deconvolution.light_split import frequency_step
from optics.deconvolution.priors import DerivativePenalty
from optics.deconvolution.restored_image import RestoredImage
from optics.deconvolution.splitting import SplittingSettings, restored_image, solve_by_splitting
from optics.demosaicing.mosaic_observation import MosaicObservation
from optics.progress import Progress
from optics.threads import single_threaded


@dataclass(frozen=True)
class DemosaicingSettings:
    """Tune the prior and the splitting of the demosaicing of all bands together.

    All values are chosen.

    Attributes
    ----------
    brightness : float
        Weight of the brightness' curvature relative to that of the colour differences.
    curvature_threshold : float
        Curvature that one iteration sets to zero, relative to the standard deviation of the light.
    noiseless_weight : float
        Regularisation weight of a picture without noise, relative to the scale of the light.
    noise_weight : float
        Factor of the squared relative noise, which is added to `noiseless_weight`.
    """

    brightness: float = 0.4
    curvature_threshold: float = 1.0
    noiseless_weight: float = 1e-3
    noise_weight: float = 1.8


_SETTINGS = DemosaicingSettings()


@single_threaded
@torch.no_grad()
def demosaic_with_prior(
    observation: MosaicObservation,
    weight: float | None = None,
    *,
    iterations: int = 30,
    progress: Progress | None = None,
) -> RestoredImage:
    """Demosaic an observation with the curvature prior.

    The result x minimises |S G x - y|² / 2 + weight * (|w ∇²L| + |∇²C|), summed over the pixels,
    where S are the filters, G is the blur, and the first term counts trusted pixels only. |∇²L| is
    the length of the second derivatives of the brightness, with the weight w, and |∇²C| is the
    joint length of those of all colour differences.
    """
    used = weight or default_weight(observation.scene_noise, observation.scale)
    prior = DerivativePenalty(
        BandCoupling.luminance_chrominance(observation.bands, _SETTINGS.brightness),
        observation.period_shape, _SETTINGS.curvature_threshold * observation.scale,
        observation.image.dtype, derivative=CURVATURE,
    )  # fmt: skip
    step = frequency_step(observation, iterations)
    settings = SplittingSettings(iterations, used)
    solution = solve_by_splitting(step, [prior], settings, "demosaicing", progress or Progress())
    return restored_image(step, solution, "demosaicing")


def default_weight(noise: float, scale: float) -> float:
    """Return the demosaicing prior's default weight for a noise and a scale of the light."""
    return scale * (_SETTINGS.noiseless_weight + _SETTINGS.noise_weight * (noise / scale) ** 2)
