"""Richardson-Lucy deconvolution (thesis Eq. 2.30), with an unknown border."""

from __future__ import annotations

import torch

from optics.deconvolution.blurred import require_psf
from optics.edge import floating, require_finite, tensors_inside
from optics.fourier import irfft2, rfft2
from optics.operators.blur import blur_shape, transfer_function
from optics.plane import centred_crop, centred_pad
from optics.progress import Progress
from optics.threads import single_threaded


@tensors_inside
@single_threaded
def richardson_lucy(
    image: torch.Tensor,
    psf: torch.Tensor,
    iterations: int,
    *,
    progress: Progress | None = None,
) -> torch.Tensor:
    """The picture with its blur undone by Poisson maximum likelihood, (rows, columns).

    image: light per pixel; negative values, which dark subtraction leaves, count as none.
    psf: origin at n // 2, negative values count as none; its sum is the share of light
    that arrives. The unmeasured surroundings within half a PSF are restored with the
    picture (Bertero and Boccacci 2005, doi 10.1051/0004-6361:20052717), so that they
    leave no rings. Raises ValueError for a picture or PSF that isn't finite.
    """
    if iterations < 1:
        raise ValueError(f"iterations is {iterations}; at least 1 is needed")
    require_finite("image", image)
    require_psf(psf)
    progress = progress or Progress()
    image = floating(image)
    shape = blur_shape(image.shape[-2:], psf.shape[-2:])
    transfer = transfer_function(psf.to(image).clamp(min=0), shape)

    def blur(x: torch.Tensor) -> torch.Tensor:
        return irfft2(rfft2(x) * transfer, shape)

    def blur_back(x: torch.Tensor) -> torch.Tensor:
        return irfft2(rfft2(x) * transfer.conj(), shape)

    data = image.clamp(min=0)
    measured = centred_pad(torch.ones_like(data), shape)
    data = centred_pad(data, shape)
    weight = blur_back(measured)
    # Where almost no light comes from into the picture, nothing is known: leave it be.
    least = 0.01 * float(weight.detach().max())
    known = weight > least
    step = torch.where(known, 1 / weight.clamp(min=least), 0.0)
    level = image.clamp(min=0).mean() / transfer[0, 0].real
    estimate = level.clamp(min=torch.finfo(data.dtype).tiny).expand(shape).clone()
    floor = 1e-6 * float(level.detach()) + torch.finfo(data.dtype).tiny
    for iteration in range(iterations):
        progress.report(iteration / iterations, f"Richardson-Lucy {iteration + 1}/{iterations}")
        ratio = measured * data / blur(estimate).clamp(min=floor)
        estimate = torch.where(known, estimate * (blur_back(ratio) * step).clamp(min=0), estimate)
    return centred_crop(estimate, image.shape[-2:])
