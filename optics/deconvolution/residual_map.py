"""The map of what a restoration leaves unexplained of its photograph."""

from __future__ import annotations

import torch

from optics.deconvolution.observation import Observation
from optics.deconvolution.restored_image import RestoredImage
from optics.fourier import irfft2, rfft2


@torch.no_grad()
def residual_map(observation: Observation, restored: RestoredImage) -> torch.Tensor:
    """Compute the photograph less the blurred restoration, over the noise, at each pixel.

    Parameters
    ----------
    observation : Observation
        What was restored.
    restored : RestoredImage
        The restoration. If it doesn't have the scene beyond the frame, pixels whose light comes
        from there aren't known.

    Returns
    -------
    torch.Tensor, (rows, columns)
        The residual; NaN where it isn't known, and where a pixel has no weight.
    """
    unit, observation = observation.unit, observation.in_own_unit
    known = restored.period_image
    if known is None:
        image = torch.as_tensor(restored.image)
        whole = torch.zeros(*image.shape[:-2], *observation.period_shape, dtype=image.dtype)
    else:
        whole = torch.as_tensor(known).clone()
    # Beyond the frame, the picture is as the restoration left it: what is negative wasn't cut.
    observation.crop_to_frame(whole).copy_(torch.as_tensor(restored.image))
    if known is not None and observation.support is not None:
        # The photograph's frame, beyond which all is dark, stands off that of the picture.
        whole *= observation.support.roll([-one for one in observation.psf_offset], (-2, -1))
    whole /= unit
    light = irfft2(rfft2(whole) * observation.otf, observation.period_shape)
    light = observation.sum_bands(observation.crop_to_frame(light))
    left = observation.normalised_image - light.reshape(observation.image.shape)
    if observation.variance is None:
        left = left / observation.scene_noise
    else:
        left = left * observation.psf_sum / observation.variance.sqrt().to(left)
    if observation.effective_weights is not None:
        left[observation.effective_weights <= 0] = torch.nan
    if known is None and not observation.is_fully_measured:
        top, side = (n // 2 for n in observation.psf.shape)
        inside = torch.zeros_like(left, dtype=torch.bool)
        inside[top : left.shape[0] - top, side : left.shape[1] - side] = True
        left[~inside] = torch.nan
    return left
