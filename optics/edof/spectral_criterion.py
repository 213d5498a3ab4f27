"""Compute the error expected of linear restoration, from transfer functions and a power spectrum.

A picture with the power spectrum S, drawn at a depth with the transfer function H, is captured as
H x + n with white noise of variance sigma². A linear filter G restores it. As picture and noise are
uncorrelated, the expected squared error at one frequency is

    E(G) = mean over depth of S |1 - G H|² + sigma² |G|².

Without the depth, one filter must do for all of them. E is quadratic in G, and zero derivative
gives the linear filter of least mean squared error (LMMSE, a Wiener filter) and its error:

    G = S mean(H)* / (S mean(|H|²) + sigma²),   E = S (1 - S |mean(H)|² / (S mean(|H|²) + sigma²)).

If the depth is known, each depth has its own Wiener filter, and

    E = mean over depth of S sigma² / (S |H|² + sigma²).

The mean of E over all frequencies is the expected squared error per pixel. The mean of a picture
isn't counted: S is zero at zero frequency (see `optics.edof.picture_spectrum`).

Sums are in double precision.

Thesis section 5.4; N. Wiener, Extrapolation, Interpolation, and Smoothing of Stationary Time
Series, 1949; A. Levin et al., ACM Trans. Graph. 28(3), 97, 2009, doi 10.1145/1531326.1531403.
"""

from __future__ import annotations

import math

import torch

from optics.validation import accepts_numpy, as_number, require_positive, require_share

LEAST_NOISE = 1e-4
"""Least standard deviation of the noise, as a share of white; keeps 0 / 0 out of the filters.

Chosen: the quantisation of 12 bits alone makes 7e-5.
"""


@accepts_numpy
def blind_error(
    transfer: torch.Tensor,
    spectrum: torch.Tensor,
    shares: torch.Tensor,
    noise: float,
) -> torch.Tensor:
    """Compute the expected squared error per pixel of one linear filter for all depths.

    The error is a float64 scalar, differentiable in `transfer`. Raises ValueError if shapes don't
    fit, or the noise isn't a finite number of 0 or more.

    transfer: transfer function at each depth, (depths, rows, columns), real or complex.
    spectrum: power spectrum of the pictures, (rows, columns), whose mean over all frequencies is
        their variance.
    shares: share of all frequencies that each one stands for, (rows, columns); see
        `FrequencyGrid.shares`.
    noise: standard deviation of a pixel's noise, where white is 1; at least `LEAST_NOISE` is used.
    """
    _require_shapes(transfer, spectrum, shares)
    mean, power = mean_transfer(transfer)
    spectrum = spectrum.double()
    captured = spectrum * power + noise_variance(noise)
    lost = spectrum * (1 - spectrum * _squared_modulus(mean) / captured)
    return (shares * lost).sum()


@accepts_numpy
def known_depth_error(
    transfer: torch.Tensor,
    spectrum: torch.Tensor,
    shares: torch.Tensor,
    noise: float,
) -> torch.Tensor:
    """Compute the expected squared error per pixel of a linear filter that knows the depth.

    Arguments and errors are those of `blind_error`. The result is a float64 scalar, differentiable
    in `transfer`.
    """
    _require_shapes(transfer, spectrum, shares)
    variance, spectrum = noise_variance(noise), spectrum.double()
    error = spectrum.new_zeros(())
    weight = 1 / len(transfer)
    for one in transfer:
        lost = spectrum * variance / (spectrum * _squared_modulus(one) + variance)
        error = error + weight * (shares * lost).sum()
    return error


@accepts_numpy
def blind_filter(
    transfer: torch.Tensor,
    spectrum: torch.Tensor,
    noise: float,
) -> torch.Tensor:
    """Compute the linear filter of least expected squared error for pictures at all depths.

    Arguments and errors are those of `blind_error`. The filter by frequency is (rows, columns),
    real or complex as `transfer`, in double precision. At zero frequency it is 1 over the mean
    transfer function, so that the picture's mean is kept.
    """
    _require_shapes(transfer, spectrum, spectrum)
    mean, power = mean_transfer(transfer)
    spectrum = spectrum.double()
    built = spectrum * mean.conj() / (spectrum * power + noise_variance(noise))
    kept = torch.zeros_like(spectrum, dtype=torch.bool)
    kept[0, 0] = bool(_squared_modulus(mean[0, 0]) > 0)
    inverse = 1 / torch.where(kept, mean, torch.ones_like(mean))
    return torch.where(kept, inverse, built)


@accepts_numpy
def filter_error(
    restoring: torch.Tensor,
    transfer: torch.Tensor,
    spectrum: torch.Tensor,
    shares: torch.Tensor,
    noise: float,
) -> torch.Tensor:
    """Compute the expected squared error per pixel of a given linear filter at some depths.

    The error is a float64 scalar, at least that of `blind_error` at the same depths. Other
    arguments are as there; the depths may be others than those that the filter was made for.

    restoring: the filter by frequency, (rows, columns), for instance of `blind_filter`. Gradients
        go through it too.
    """
    _require_shapes(transfer, spectrum, shares)
    spectrum, error = spectrum.double(), shares.new_zeros((), dtype=torch.float64)
    weight = 1 / len(transfer)
    for one in transfer:
        missed = spectrum * _squared_modulus(1 - restoring * one)
        error = error + weight * (shares * missed).sum()
    return error + noise_variance(noise) * (shares * _squared_modulus(restoring)).sum()


def mean_transfer(transfer: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Compute the means over depth of transfer functions H, (depths, rows, columns), and of |H|².

    Each is (rows, columns), in double precision.
    """
    kind = torch.complex128 if transfer.is_complex() else torch.float64
    mean = transfer.new_zeros(transfer.shape[1:], dtype=kind)
    power = transfer.new_zeros(transfer.shape[1:], dtype=torch.float64)
    weight = 1 / len(transfer)
    for one in transfer:
        mean = mean + weight * one
        power = power + weight * _squared_modulus(one)
    return mean, power


def noise_variance(noise: float) -> float:
    """Return the variance of a pixel's noise that restoration counts on, floored.

    Raises ValueError for a negative noise, or one that isn't finite.
    """
    noise = as_number(noise)
    if not 0 <= noise < math.inf:
        raise ValueError(f"noise is {noise:g}; give its standard deviation, where white is 1")
    return max(noise, LEAST_NOISE) ** 2


def noise_at_light(noise: float, light: float, photon_share: float = 0.0) -> float:
    """Compute a pixel's noise relative to white, for a camera that collects less light.

    A stop or an absorbing pattern lowers the signal. Scaled back to white at 1, the noise of the
    electronics grows as 1 / light and that of the photons as 1 / sqrt(light). The result is a
    standard deviation where white is 1, for transfer functions that are 1 at zero frequency. Raises
    ValueError if a share is out of range.

    noise: standard deviation where white is 1, with the light of the full aperture.
    light: share of that light that is collected, above 0 and up to 1.
    photon_share: share of the variance that is photon noise, at the full aperture's light.
    """
    require_positive("light", light, "")
    require_share("light", light)
    require_share("photon_share", photon_share)
    return noise * math.sqrt((1 - photon_share) / light**2 + photon_share / light)


def error_level(error: float | torch.Tensor) -> float:
    """Convert an expected squared error per pixel to dB, the PSNR of a picture whose white is 1.

    Raises ValueError for an error that isn't positive and finite.
    """
    require_positive("error", error, "")
    return -10 * math.log10(as_number(error))


def _squared_modulus(values: torch.Tensor) -> torch.Tensor:
    """Return |values|² in double precision."""
    if values.is_complex():
        return values.real.double() ** 2 + values.imag.double() ** 2
    return values.double() ** 2


def _require_shapes(transfer: torch.Tensor, spectrum: torch.Tensor, shares: torch.Tensor) -> None:
    """Raise ValueError if transfer functions, spectrum and shares have different frequencies."""
    if transfer.ndim != 3 or not len(transfer):
        raise ValueError(f"transfer is {tuple(transfer.shape)}; give (depths, rows, columns)")
    for name, given in (("spectrum", spectrum), ("shares", shares)):
        if given.shape != transfer.shape[1:]:
            raise ValueError(
                f"{name} is {tuple(given.shape)} and transfer {tuple(transfer.shape)}; they must "
                "be on the same frequencies"
            )
