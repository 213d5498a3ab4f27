"""Deconvolution and figures of merit where there is nothing to divide by."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from judges import gaussian_psf, natural_image
from numpy.typing import NDArray

from hard_cases.table import Case, Holds, require_finite, require_finite_gradient
from labapp.pictures.networks import bundled_denoiser
from optics.inverse.bounded import restore_within_bounds
from optics.inverse.hyper_laplacian import hyper_laplacian
from optics.inverse.observation_builder import build_observation
from optics.inverse.plug_and_play import plug_and_play
from optics.inverse.poisson import poisson_total_variation
from optics.inverse.richardson_lucy import richardson_lucy
from optics.inverse.total_variation import total_variation
from optics.inverse.wiener import wiener
from optics.metrics import psnr, ssim

BITS = (1e-3, 1e-8)
Restore = Callable[[Any, Any], Any]


def filtered(image: Any, psf: Any, weight: float = 1e-3) -> Any:
    """By Wiener's flat filter; arrays for arrays."""
    return _as_given(image, wiener(build_observation(image, psf, 0.0), weight, "flat").image)


def likeliest(image: Any, psf: Any, iterations: int = 30) -> Any:
    """By Richardson and Lucy's plain algorithm."""
    seen = build_observation(image, psf, 0.0)
    done = richardson_lucy(seen, iterations, accelerate=False, continue_past_noise=True)
    return _as_given(image, done.image)


def edged(image: Any, psf: Any) -> Any:
    """By total variation, noise and weight estimated."""
    return _as_given(image, total_variation(build_observation(image, psf)).image)


def edged_photons(image: Any, psf: Any) -> Any:
    """By total variation under Poisson's likelihood, noise and weight estimated."""
    return _as_given(image, poisson_total_variation(build_observation(image, psf)).image)


def heavy_tailed(image: Any, psf: Any) -> Any:
    """By gradients to the power 2/3, noise and weight estimated."""
    return _as_given(image, hyper_laplacian(build_observation(image, psf)).image)


def within_bounds(image: Any, psf: Any) -> Any:
    """By L-BFGS-B, light never negative, noise and weight estimated."""
    return _as_given(image, restore_within_bounds(build_observation(image, psf)).image)


def by_a_denoiser(image: Any, psf: Any) -> Any:
    """By plug-and-play with the packaged network, noise estimated."""
    return _as_given(image, plug_and_play(build_observation(image, psf), bundled_denoiser()).image)


def _as_given(image: Any, restored: torch.Tensor) -> Any:
    return restored if isinstance(image, torch.Tensor) else restored.numpy()


DIFFERENTIABLE: dict[str, Restore] = {
    "Wiener's filter": filtered,
    "Richardson-Lucy": likeliest,
}

EXPLICIT: dict[str, Restore] = {
    **DIFFERENTIABLE,
    "total variation": edged,
    "Poisson total variation": edged_photons,
    "hyper-Laplacian": heavy_tailed,
    "L-BFGS-B": within_bounds,
}
"""Their priors are formulas, which leave a constant be."""

RESTORATIONS: dict[str, Restore] = {**EXPLICIT, "plug-and-play": by_a_denoiser}


def numbers(value: Any, tol: float) -> NDArray[Any]:
    return np.asarray(value, dtype=np.float32 if tol > 1e-7 else np.float64)


def zeros_of_the_transfer_function(tol: float) -> None:
    """0 / (0 + K) is 0 even where K underflows."""
    image = numbers(natural_image(31, 32, 1), tol)
    for k in (1e-30, 1e-12, 1e-3):
        restored = filtered(image, numbers([[0.5, 0.5]], tol), k)
        require_finite(restored)
    assert np.abs(restored).max() < 10


def almost_nothing(restore: Restore, tol: float) -> None:
    """One bright pixel stays where it is, and the dark beyond the PSF stays dark."""
    image = numbers(np.zeros((40, 41)), tol)
    image[20, 20] = 1e6
    restored = restore(image, numbers(gaussian_psf(5, 1.0), tol))
    require_finite(restored)
    assert restored.argmax() == 20 * 41 + 20
    assert np.abs(restored[:5, :5]).max() <= 1e-2 * restored.max()


def constants(restore: Restore, tol: float) -> None:
    """The constant, to rounding."""
    for level in (0.0, 1e-30, 1.0, 1e6):
        flat = numbers(np.full((20, 23), level), tol)
        restored = restore(flat, numbers(gaussian_psf(7, 1.5), tol))
        require_finite(restored)
        assert np.allclose(restored, level, rtol=1e-4, atol=1e-35)


def a_psf_larger_than_the_picture(restore: Restore, tol: float) -> None:
    """The right level, though most of the light comes from outside."""
    for shape in ((1, 1), (1, 9), (8, 9)):
        restored = restore(numbers(np.full(shape, 3.0), tol), numbers(gaussian_psf(33, 5.0), tol))
        assert restored.shape == shape
        assert np.allclose(restored, 3.0, rtol=1e-3)


def negative_data(restore: Restore, tol: float) -> None:
    """No NaN, and no light made from nothing."""
    image = numbers(np.random.default_rng(3).normal(0, 1, (40, 40)), tol)
    restored = restore(image, numbers(gaussian_psf(5, 1.0), tol))
    require_finite(restored)
    assert abs(restored.mean()) <= np.abs(image).mean()


def negative_everywhere(tol: float) -> None:
    """Darkness, and no division by its sum."""
    restored = likeliest(numbers(np.full((9, 9), -2.0), tol), gaussian_psf(3, 1.0), 5)
    require_finite(restored)
    assert np.abs(restored).max() <= 1e-30


def many_passes(tol: float) -> None:
    """Stars of 1 to 1e8 keep their light."""
    sky = np.zeros((48, 48))
    rng = np.random.default_rng(4)
    sky[rng.integers(8, 40, 30), rng.integers(8, 40, 30)] = np.geomspace(1, 1e8, 30)
    psf = gaussian_psf(9, 1.2)
    transfer = np.fft.rfft2(np.fft.ifftshift(np.pad(psf, (20, 19))), (48, 48))
    image = np.abs(np.fft.irfft2(np.fft.rfft2(sky) * transfer, (48, 48)))
    restored = likeliest(numbers(image, tol), numbers(psf, tol), 500)
    require_finite(restored)
    assert restored.min() >= 0
    assert abs(restored.sum() / sky.sum() - 1) <= 1e-2


def far_units(restore: Restore, tol: float) -> None:
    """The same picture, to the bit, though its squares are no numbers any more."""
    image, psf = numbers(natural_image(24, 25, 7), tol), numbers(gaussian_psf(5, 1.0), tol)
    expected = restore(image, psf)
    for power in (-120, -60, 60, 120):
        unit = image.dtype.type(2.0**power)
        assert np.array_equal(image * unit / unit, image)
        # Dark restored pixels may be below the least normal number, and are rounded there.
        assert np.array_equal(restore(image * unit, psf), expected * unit)


def gradients(restore: Restore, tol: float) -> None:
    """Finite, and not zero."""
    image = torch.from_numpy(numbers(natural_image(12, 13, 5), tol))
    image[3, 3] = 0
    psf = torch.from_numpy(numbers(gaussian_psf(5, 1.0), tol))
    assert float(require_finite_gradient(lambda x: restore(x, psf), image).abs().max()) > 0


def constant_pictures_compare(tol: float) -> None:
    """Wang's constants alone stand in the denominator."""
    flat = numbers(np.full((12, 12), 0.5), tol)
    assert abs(ssim(flat, flat) - 1) <= 1e-6
    assert psnr(flat, flat) == math.inf
    expected = (2 * 0.5 * 0.25 + 1e-4) / (0.25 + 0.0625 + 1e-4)
    assert abs(ssim(flat, 0.5 * flat) / expected - 1) <= 1e-6


def for_each(
    name: str,
    why: str,
    given: str,
    law: Any,
    judge: str,
    kinds: dict[str, Restore] = RESTORATIONS,
) -> list[Case]:
    """A row for each kind of restoration."""
    return [
        Holds(f"{name}, {kind}", why, given, lambda tol, r=r: law(r, tol), judge, tols=BITS)
        for kind, r in kinds.items()
    ]


CASES: list[Case] = [
    Holds("zeros of the transfer function", "0 / (0 + K) with K below the smallest number",
          "two equal points", zeros_of_the_transfer_function, "finite, bounded", tols=BITS),
    *for_each("almost nothing", "beyond the reach of the PSF all is 0 / 0",
              "one bright pixel on black", almost_nothing, "the pixel itself", DIFFERENTIABLE),
    *for_each("constant pictures", "no detail to restore, no noise to measure",
              "0, 1e-30, 1, 1e6", constants, "the constant", EXPLICIT),
    *for_each("a PSF larger than the picture", "most of the light comes from outside",
              "33x33 on 1x1, 1x9, 8x9", a_psf_larger_than_the_picture, "the constant"),
    *for_each("negative data", "what is left after dark subtraction is noise around zero",
              "normal noise", negative_data, "its mean"),
    *for_each("units far from 1", "1e-18 squared is no number in single precision",
              "a picture times 2 to the power -120 to 120", far_units, "the same at 1"),
    *for_each("gradients of restorations", "clamps and zeros are on the path",
              "a zero in a picture", gradients, "finite, not zero", DIFFERENTIABLE),
    Holds("a picture that is negative everywhere", "nothing is left after clamping", "-2",
          negative_everywhere, "darkness", tols=BITS),
    Holds("hundreds of passes over fifteen stops", "sharpening runs away where precision ends",
          "500 passes, stars of 1 to 1e8", many_passes, "their light", tols=BITS),
    Holds("likeness of constant pictures", "variances of zero in a denominator", "0.5 and 0.25",
          constant_pictures_compare, "the luminance term", tols=BITS),
]  # fmt: skip
