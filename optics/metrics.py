"""Figures of merit of PSFs and pictures, each defined once."""

from __future__ import annotations

import math

import torch

from optics.validation import accepts_numpy, require_finite, require_positive


def _require_same_shape_and_finite(**pictures: torch.Tensor) -> None:
    """Raise ValueError unless two pictures are finite and of one shape."""
    (first, a), (second, b) = pictures.items()
    if a.shape != b.shape:
        raise ValueError(
            f"{first} is {tuple(a.shape)} and {second} is {tuple(b.shape)}; "
            "only pictures of one shape can be compared"
        )
    require_finite(first, a)
    require_finite(second, b)


def _require_bright_target(target: torch.Tensor) -> None:
    """Raise ValueError for a target without light, to which no PSF can be compared."""
    if not float(target.max()) > 0:
        raise ValueError("target is dark; it must be positive somewhere")


@accepts_numpy
def efficiency(psf: torch.Tensor, target: torch.Tensor, total: float = 1.0) -> float:
    """Compute the share of a point's light that falls where the target isn't dark.

    The target isn't dark where it exceeds 2 % of its peak. total: all light of the point source.
    """
    _require_same_shape_and_finite(psf=psf, target=target)
    _require_bright_target(target)
    require_positive("total", total, "of light")
    return float(psf[target > 0.02 * target.max()].sum()) / total


@accepts_numpy
def speckle_contrast(
    psf: torch.Tensor, target: torch.Tensor, noise: torch.Tensor | None = None
) -> float:
    """Compute the speckle contrast of a PSF: standard deviation over mean of PSF / target.

    Only samples at which the target exceeds half its peak count. noise: variance of a measured
    PSF's samples by the camera's noise, which is taken out of the measured variance.
    """
    _require_same_shape_and_finite(psf=psf, target=target)
    _require_bright_target(target)
    bright = target > 0.5 * target.max()
    ratio = psf[bright].to(torch.float64) / target[bright].to(torch.float64)
    if not float(ratio.mean()) > 0:
        raise ValueError("psf sends no light where the target is bright; contrast is 0 / 0")
    variance = float(ratio.var(correction=0))
    if noise is not None:
        if noise.shape != psf.shape:
            raise ValueError(f"noise is {tuple(noise.shape)}; give one of psf's shape")
        of_camera = noise[bright].to(torch.float64) / target[bright].to(torch.float64).square()
        variance -= float(of_camera.mean())
    return math.sqrt(max(variance, 0.0)) / float(ratio.mean())


@accepts_numpy
def scaled_nrmse(psf: torch.Tensor, target: torch.Tensor) -> float:
    """Compute the NRMSE, ``|PSF - c target| / |c target|`` with the best factor c."""
    _require_same_shape_and_finite(psf=psf, target=target)
    _require_bright_target(target)
    seen, wanted = psf.to(torch.float64), target.to(torch.float64)
    best = float((seen * wanted).sum() / wanted.square().sum())
    if not best > 0:
        raise ValueError("psf sends no light where the target is bright; its error is 0 / 0")
    return float((seen - best * wanted).norm() / (best * wanted.norm()))


@accepts_numpy
def relative_error(value: torch.Tensor, reference: torch.Tensor) -> float:
    """Compute ``|value - reference| / |reference|``, a relative L2 error without a fitted scale."""
    _require_same_shape_and_finite(value=value, reference=reference)
    if not reference.any():
        raise ValueError(
            "reference is zero everywhere; a relative error needs something to divide by"
        )
    difference = value.to(torch.float64) - reference.to(torch.float64)
    return float(difference.norm() / reference.to(torch.float64).norm())


@accepts_numpy
def psnr(image: torch.Tensor, reference: torch.Tensor, peak: float = 1.0) -> float:
    """Compute the peak signal-to-noise ratio in dB; infinite for equal images."""
    _require_same_shape_and_finite(image=image, reference=reference)
    require_positive("peak", peak, "")
    error = float(((image.to(torch.float64) - reference.to(torch.float64)) ** 2).mean())
    return math.inf if error == 0 else 10 * math.log10(peak**2 / error)


@accepts_numpy
def ssim(image: torch.Tensor, reference: torch.Tensor, data_range: float = 1.0) -> float:
    """Compute the mean SSIM of two images (Wang et al. 2004, doi 10.1109/TIP.2003.819861).

    The window is a Gaussian of sigma 1.5, cut at 3.5 sigma. K1 is 0.01 and K2 is 0.03. The
    statistics are those of a population, averaged where the window lies inside the picture. Raises
    ValueError for pictures smaller than the window, 11 x 11.
    """
    _require_same_shape_and_finite(image=image, reference=reference)
    require_positive("data_range", data_range, "")
    if min(image.shape[-2:]) < 11:
        raise ValueError(f"image is {tuple(image.shape)}; the window needs 11 x 11 samples")
    wide = (image.to(torch.float64), reference.to(torch.float64))
    return float(structural_similarity(wide[0][None], wide[1][None], data_range)[0])


def structural_similarity(
    images: torch.Tensor, references: torch.Tensor, data_range: float = 1.0
) -> torch.Tensor:
    """Compute the mean SSIM of each of many images, (images, rows, columns), 11 x 11 or more.

    The result, (images,), has the precision of the images, and is differentiable, as `ssim` isn't.
    """
    return similarity_map(images, references, data_range).mean((-2, -1))


def similarity_map(
    images: torch.Tensor, references: torch.Tensor, data_range: float = 1.0
) -> torch.Tensor:
    """Compute the SSIM of many images, (images, rows, columns), wherever its window lies inside.

    The result is (images, rows - 10, columns - 10), and NaN where the window has a NaN.
    """
    radius, sigma = 5, 1.5
    x = torch.arange(-radius, radius + 1, dtype=images.dtype, device=images.device)
    window = torch.exp(-(x**2) / (2 * sigma**2))
    window = window / window.sum()

    def smooth(pictures: torch.Tensor) -> torch.Tensor:
        rows = torch.nn.functional.conv2d(pictures[:, None], window[None, None, :, None])
        return torch.nn.functional.conv2d(rows, window[None, None, None, :])[:, 0]

    a, b = images, references
    mean_a, mean_b = smooth(a), smooth(b)
    var_a, var_b = smooth(a * a) - mean_a**2, smooth(b * b) - mean_b**2
    covariance = smooth(a * b) - mean_a * mean_b
    c1, c2 = (0.01 * data_range) ** 2, (0.03 * data_range) ** 2
    luminance = (2 * mean_a * mean_b + c1) / (mean_a**2 + mean_b**2 + c1)
    structure = (2 * covariance + c2) / (var_a + var_b + c2)
    return luminance * structure


@accepts_numpy
def spectral_angle(image: torch.Tensor, reference: torch.Tensor, least_norm: float = 0.1) -> float:
    """Compute the mean angle between the spectra of two pictures of many bands.

    The angle of a pixel is that between its two spectra as vectors, in degrees, 0 to 180, so that
    brightness doesn't matter. A pixel that `image` leaves dark in all bands has 90. It is computed
    without an arccosine, which would lose small angles (Kruse et al. 1993, "The spectral image
    processing system (SIPS)", Remote Sens. Environ. 44, 145, doi 10.1016/0034-4257(93)90013-N;
    Kahan 2006, "How futile are mindless assessments of roundoff"). Raises ValueError if the
    pictures aren't finite and alike, or no pixel of `reference` is bright enough.

    image, reference: light of each band, of any unit, (bands, rows, columns).
    least_norm: length of a pixel's spectrum in `reference` that must be exceeded for the pixel to
    count: the spectra of dark pixels are noise.
    """
    _require_same_shape_and_finite(image=image, reference=reference)
    if image.ndim != 3:
        raise ValueError(f"image is {tuple(image.shape)}; give (bands, rows, columns)")
    if not 0 <= least_norm < math.inf:
        raise ValueError(f"least_norm is {least_norm:g}; give 0 or more")
    seen, wanted = (one.to(torch.float64).flatten(1) for one in (image, reference))
    bright = wanted.norm(dim=0) > least_norm
    if not bool(bright.any()):
        raise ValueError(
            f"no pixel of reference has a spectrum longer than {least_norm:g}; give a brighter "
            "reference, or a smaller least_norm"
        )
    seen, wanted = seen[:, bright], wanted[:, bright]
    length = seen.norm(dim=0)
    seen, wanted = seen / length.where(length > 0, 1.0), wanted / wanted.norm(dim=0)
    angle = 2 * torch.atan2((seen - wanted).norm(dim=0), (seen + wanted).norm(dim=0))
    return math.degrees(float(angle.mean()))


def crop_central_share(image: torch.Tensor, share: float = 0.9) -> torch.Tensor:
    """Crop an image to its central part, whose sides are a share of the image's."""
    if not 0 < share <= 1:
        raise ValueError(f"share is {share:g}; it must lie within 0 to 1, and not be 0")
    rows, columns = image.shape[-2:]
    y, x = round(rows * (1 - share) / 2), round(columns * (1 - share) / 2)
    return image[..., y : rows - y, x : columns - x]
