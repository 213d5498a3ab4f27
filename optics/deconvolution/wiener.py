"""Linear restoration: Wiener's filter (thesis Eq. 2.28), with an unknown border."""

from __future__ import annotations

from typing import Literal

import torch

from optics.deconvolution.blurred import Blurred
from optics.deconvolution.noise import PowerLaw, frequencies, spectrum_of
from optics.deconvolution.restored import Restored
from optics.edge import require_positive
from optics.fourier import irfft2, rfft2
from optics.operators.pixels import Window
from optics.threads import single_threaded

Smooth = Literal["spectrum", "gradient", "flat"]

SMOOTH: tuple[Smooth, ...] = ("gradient", "spectrum", "flat")

_STEPS = 30
"""Of conjugate gradients, after which what isn't measured hardly changes what lies inside."""

_SOLVED = 1e-5
"""Of the normal equations' right-hand side, in the preconditioner's norm, that may be left."""

_GRID = torch.logspace(-8, 2, 61, dtype=torch.float64)
"""Weights that are tried, relative to what a gradient of one period a pixel would be worth."""


@single_threaded
@torch.no_grad()
def wiener(
    seen: Blurred,
    weight: float | None = None,
    smooth: Smooth = "gradient",
    *,
    steps: int = _STEPS,
) -> Restored:
    """The picture of which H* O / (|H|² + K) is left, (rows, columns).

    smooth: what K is. "gradient", a weight times the frequency's square; "spectrum", the noise over
    the picture's power at each frequency, which the photograph tells: the least error that a
    linear filter can have, where PSF and noise are exact; "flat", a weight everywhere, as in Eq.
    2.28. weight: of K; the one with the least predicted error if None. The mean brightness is set
    apart: no K darkens it.

    steps: where not all of a period was measured, the filter for the measured pixels alone is the
    solution of (H* M H + K) x = H* M y, by conjugate gradients on frequencies, from what the filter
    makes of a smooth continuation; so many steps at most.
    Raises ValueError for a weight that isn't positive, or another name.
    """
    if smooth not in SMOOTH:
        raise ValueError(f"smooth is {smooth!r}; take one of {', '.join(SMOOTH)}")
    if weight is not None:
        require_positive("weight", weight, "")
    if steps < 0:
        raise ValueError(f"steps is {steps}; it can't be negative")
    power = seen.transfer.real.square() + seen.transfer.imag.square()
    penalty, used = _penalty(seen, weight, smooth, power)
    inverse = (power + penalty).clamp(min=1e-12).reciprocal()
    mean = seen.filled.mean()
    spectrum = rfft2(seen.continued - mean).mul_(seen.transfer.conj()).mul_(inverse)
    taken = 0
    if seen.border != "periodic" or seen.trust is not None:
        spectrum, taken = _of_measured(seen, mean, penalty, inverse, spectrum, steps)
    picture = seen.frame(irfft2(spectrum, seen.whole)) + mean
    left = seen.frame(irfft2(spectrum * seen.transfer, seen.whole)) + mean - seen.data
    squares = left.square() if seen.trust is None else left.square() * seen.trust
    count = left.numel() if seen.trust is None else int((seen.trust > 0).sum())
    residual = float(squares.sum() / count) ** 0.5 / seen.deviation
    name = f"Wiener, {smooth}"
    return Restored(picture.clamp(min=0), name, seen.noise, residual, used, 1 + taken)


def _of_measured(
    seen: Blurred,
    mean: torch.Tensor,
    penalty: torch.Tensor,
    inverse: torch.Tensor,
    spectrum: torch.Tensor,
    steps: int,
) -> tuple[torch.Tensor, int]:
    """Conjugate gradients, preconditioned by the filter for a whole period, from a spectrum on;
    and how many steps they took."""
    trust, back = seen.trust, seen.transfer.conj().resolve_conj()
    window = Window(seen.whole, seen.image.shape)
    half = torch.full((seen.whole[1] // 2 + 1,), 2.0)
    half[0] = 1
    if seen.whole[1] % 2 == 0:
        half[-1] = 1

    def measured(light: torch.Tensor) -> torch.Tensor:
        inside = seen.frame(light)
        return rfft2(window.adjoint(inside if trust is None else inside * trust)).mul_(back)

    def inner(a: torch.Tensor, b: torch.Tensor) -> float:
        return float(((a.real * b.real + a.imag * b.imag) * half).sum(dtype=torch.float64))

    def normal(x: torch.Tensor) -> torch.Tensor:
        return measured(irfft2(x * seen.transfer, seen.whole)).add_(x * penalty)

    wanted = measured(window.adjoint(seen.filled - mean))
    left = wanted - normal(spectrum)
    enough = _SOLVED**2 * inner(wanted, wanted * inverse)
    turned = left * inverse
    way, length = turned.clone(), inner(left, turned)
    taken = 0
    while taken < steps and length > enough:
        bent = normal(way)
        far = length / inner(way, bent)
        spectrum = spectrum.add(way, alpha=far)
        left = left.sub_(bent, alpha=far)
        turned = left * inverse
        before, length = length, inner(left, turned)
        way = way.mul_(length / before).add_(turned)
        taken += 1
    return spectrum, taken


def _penalty(
    seen: Blurred, weight: float | None, smooth: Smooth, power: torch.Tensor
) -> tuple[torch.Tensor, float]:
    frequency = frequencies(seen.whole)
    law = spectrum_of(seen) if weight is None or smooth == "spectrum" else None
    if smooth == "spectrum":
        assert law is not None
        used = 1.0 if weight is None else weight
        return (used * _noise_to_signal(seen, law, frequency)).to(power), used
    shape = torch.ones_like(frequency) if smooth == "flat" else frequency.square()
    if weight is not None:
        return (weight * shape).to(power), weight
    assert law is not None
    used = _best(_noise_to_signal(seen, law, frequency), shape, power.to(torch.float64))
    return (used * shape).to(power), used


def _noise_to_signal(seen: Blurred, law: PowerLaw, frequency: torch.Tensor) -> torch.Tensor:
    """Of each frequency; what lies below the lowest of the frame is as likely as that."""
    at = frequency.clamp(min=1 / max(seen.whole))
    noise = (seen.deviation * seen.gain) ** 2
    return noise / (max(law.strength, 1e-30) * at**-law.slope)


def _best(noise_to_signal: torch.Tensor, shape: torch.Tensor, power: torch.Tensor) -> float:
    """The weight with the least mean square error, relative to the picture's power."""
    signal = 1 / noise_to_signal

    def error(weight: torch.Tensor) -> torch.Tensor:
        k = weight * shape
        return ((k.square() * signal + power) / (power + k).square().clamp(min=1e-30)).mean()

    return float(_GRID[int(torch.stack([error(one) for one in _GRID]).argmin())])
