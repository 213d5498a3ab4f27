"""FFTs by whichever library is faster, scipy or torch, their lengths and what they cost."""

from __future__ import annotations

import functools
import math
import os
from collections.abc import Sequence
from typing import Any, Literal

import scipy.fft
import torch
from numpy.typing import NDArray

# Cost of each prime factor of an FFT's length, relative to that of a factor of 2.
_FACTOR_COSTS = {2: 1.0, 3: 1.9, 5: 3.0, 7: 4.4, 11: 8.0}


# Cost of a prime factor beyond those, over its size and in costs of a factor of 2; measured.
_LARGE_FACTOR_COST = 0.3

# Time of an FFT by convolution, for lengths with large prime factors, over that of one without;
# measured for lengths of 307 to 4099.
_CONVOLUTION_COST = 3.6


def fft(
    x: torch.Tensor,
    length: int,
    dim: int,
    *,
    inverse: bool = False,
    scaled: bool = True,
    overwrite: bool = False,
) -> torch.Tensor:
    """Compute a one-dimensional FFT, zero-padded to a length, with scipy or torch.

    scipy is faster than torch on the CPU but has no gradients. Therefore torch is used on other
    devices and where gradients are needed.

    Parameters
    ----------
    x : torch.Tensor
        Real or complex samples.
    length : int
        The length of the FFT; x is padded with zeros or cut to it.
    dim : int
        The axis of x along which the FFT is computed.
    inverse : bool, optional
        Whether to compute the inverse transform.
    scaled : bool, optional
        Whether the inverse is divided by `length` (the default). Without the division, the inverse
        is the adjoint of the forward transform.
    overwrite : bool, optional
        Whether the result may overwrite the memory of x.

    Returns
    -------
    torch.Tensor
        The transform, complex, of `length` along `dim`.
    """
    norm: Literal["backward", "forward"] = "backward" if scaled or not inverse else "forward"
    if _needs_torch(x):
        transform = torch.fft.ifft if inverse else torch.fft.fft
        return transform(x, n=length, dim=dim, norm=norm)
    function = scipy.fft.ifft if inverse else scipy.fft.fft
    answer = function(
        _array(x), n=length, axis=dim, workers=_workers(x), norm=norm, overwrite_x=overwrite
    )
    return torch.from_numpy(answer)


def rfft(x: torch.Tensor) -> torch.Tensor:
    """Compute the FFT of real samples along the last axis, with scipy or torch.

    Parameters
    ----------
    x : torch.Tensor
        Real, (..., n).

    Returns
    -------
    torch.Tensor
        Complex, (..., n // 2 + 1): the non-negative frequencies.
    """
    if _needs_torch(x):
        return torch.fft.rfft(x)
    return torch.from_numpy(scipy.fft.rfft(_array(x), workers=_workers(x)))


def rfft2(x: torch.Tensor) -> torch.Tensor:
    """Compute the two-dimensional FFT of a real picture, with scipy or torch.

    Parameters
    ----------
    x : torch.Tensor
        Real, (..., rows, columns), with the origin in the corner.

    Returns
    -------
    torch.Tensor
        Complex, (..., rows, columns // 2 + 1).
    """
    if _needs_torch(x):
        return torch.fft.rfft2(x)
    return torch.from_numpy(scipy.fft.rfft2(_array(x), workers=_workers(x)))


def irfft2(x: torch.Tensor, shape: Sequence[int]) -> torch.Tensor:
    """Compute the inverse two-dimensional FFT to a real picture, from its `rfft2`.

    Parameters
    ----------
    x : torch.Tensor
        Complex, (..., rows, columns // 2 + 1).
    shape : sequence of int
        The picture's (rows, columns).

    Returns
    -------
    torch.Tensor
        Real, (..., rows, columns).
    """
    if _needs_torch(x):
        return torch.fft.irfft2(x, s=tuple(shape))
    return torch.from_numpy(scipy.fft.irfft2(_array(x), s=tuple(shape), workers=_workers(x)))


@functools.cache
def fast_fft_length(least: int) -> int:
    """Find the length of at least `least` samples for which real FFTs are fastest.

    A slightly longer transform is often faster; powers of 2 are the fastest. The result minimises
    the predicted time of a real FFT and of the passes over its samples that go with it. The costs
    of prime factors were fitted to pocketfft, relative to the cost of a factor of 2.

    Parameters
    ----------
    least : int
        The number of samples that must fit.

    Returns
    -------
    int
        A length from `least` to about an eighth more.
    """
    # The passes over the samples that go with a transform cost as much as six factors of 2.
    passes = 6.0
    lengths = range(least, least + max(1, least // 8) + 1)
    return min(lengths, key=lambda length: length * (passes + _factors_cost(length)))


def _factors_cost(length: int) -> float:
    """Return the cost per sample of an FFT of a length, relative to that of a factor of 2."""
    cost = 0.0
    for factor, price in _FACTOR_COSTS.items():
        while length % factor == 0:
            length, cost = length // factor, cost + price
    return cost if length == 1 else cost + length


def rfft_column_weights(columns: int) -> torch.Tensor:
    """Count how many columns of a picture's full spectrum each column of its `rfft2` stands for.

    A column between the first and the last also represents its complex conjugate at the negative
    frequency.

    Parameters
    ----------
    columns : int
        The number of the picture's columns.

    Returns
    -------
    torch.Tensor
        1 or 2 for each column of the spectrum, (columns // 2 + 1,) float32.
    """
    counts = torch.full((columns // 2 + 1,), 2.0)
    counts[0] = 1
    if columns % 2 == 0:
        counts[-1] = 1
    return counts


def _needs_torch(x: torch.Tensor) -> bool:
    """Tell whether samples are on another device than the CPU, or need gradients."""
    return x.device.type != "cpu" or (x.requires_grad and torch.is_grad_enabled())


def _array(x: torch.Tensor) -> NDArray[Any]:
    """Convert samples from torch to NumPy, without a copy if possible."""
    return x.detach().resolve_conj().numpy()


def _workers(x: torch.Tensor) -> int:
    """Return the number of threads: several only for more than 2^20 samples, fewer gain nothing."""
    many = x.numel() > (1 << 20) and torch.get_num_threads() > 1
    return (os.cpu_count() or 1) if many else 1


@functools.lru_cache(maxsize=4096)
def fft_operations(length: int) -> float:
    """Count the floating-point operations of one complex FFT, to predict its time.

    They are 5 n log2 n where the length has small prime factors. Each larger one takes about n
    times its own size, up to what the convolution of Bluestein's algorithm takes instead.
    """
    rest, digits = length, math.log2(max(length, 2))
    for factor in _FACTOR_COSTS:
        while rest % factor == 0:
            rest //= factor
    excess = _LARGE_FACTOR_COST * _sum_of_factors(rest)
    return 5 * length * min(digits + excess, _CONVOLUTION_COST * digits)


def _sum_of_factors(length: int) -> int:
    """Return the sum of a length's prime factors."""
    total, factor = 0, 2
    while factor * factor <= length:
        while length % factor == 0:
            length, total = length // factor, total + factor
        factor += 1
    return total + length if length > 1 else total
