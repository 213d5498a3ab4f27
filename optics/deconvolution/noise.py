"""How much noise a blurred photograph has: read off where the blur lets nothing else through."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch

from optics.formation import rfft2_frequencies
from optics.fourier import rfft2
from optics.operators.blur import transfer_function
from optics.plane import Plane

_MIN_PERIODS = 3
"""Periods in the frame of the lowest frequency that is looked at: taper and trend lie below."""

_RADIUS_BINS, _MTF_BINS = 24, 16
"""Rings of frequencies, and classes of how much light gets through there, that are pooled."""

_MIN_SQUARED_MTF = 1e-8
"""Of the light's power, below which one class holds all."""

_STEPS = 40

_MAX_SIGNAL_TO_NOISE, _MIN_NOISE_FREQUENCIES = 0.1, 300
"""Frequencies with less signal than this share of the noise; how many of them tell it alone."""


@dataclass(frozen=True)
class WienerPrediction:
    """What a linear filter gets from a photograph.

    explained_share: share of the data that it explains. gradient: rms length of the restored
    picture's gradient, per pixel, times the PSF's sum.
    """

    explained_share: float
    gradient: float


@dataclass(frozen=True)
class PowerLaw:
    """What a photograph's spectrum shows: signal |H|² strength / frequency^slope, and noise.

    strength, noise_variance: variance a pixel, of the photograph; frequency in cycles per pixel.
    """

    strength: float
    slope: float
    noise_variance: float

    def wiener_prediction(
        self, squared_mtf: torch.Tensor, shape: tuple[int, int]
    ) -> WienerPrediction:
        """By the filter with the least mean square error for this spectrum (Wiener 1949).

        squared_mtf: |H|² on the rfft2 grid of a period of `shape`.
        """
        squares = squared_frequencies(shape).to(squared_mtf)
        squares[0, 0] = max(shape) ** -2
        scene = self.strength * squares ** (-self.slope / 2)
        share = scene * squared_mtf / (scene * squared_mtf + max(self.noise_variance, 1e-30))
        # Of differences between neighbours, both axes: 4 sin² of half the phase, about f² below.
        steep = (4 * math.pi**2 * squares).clamp(max=8)
        return WienerPrediction(
            float(share.mean()), math.sqrt(float((scene * share * steep).mean()))
        )


@torch.no_grad()
def fit_power_law(image: torch.Tensor, psf: torch.Tensor) -> PowerLaw:
    """Strength, slope and noise of a photograph, (rows, columns), that a PSF has blurred.

    psf: with a sum of 1. The spectrum of the frame, tapered by a Hann window, is taken for that of
    a picture whose power falls as a power of the frequency, through the PSF, and of white noise
    that nothing has smoothed; strength, slope and noise by the greatest likelihood of independent
    exponential powers (Whittle 1953). Where the PSF lets next to nothing through, the noise is what
    is there. A photograph that isn't blurred shows its noise badly: the answer then has what the
    picture's finest detail looks like.
    """
    transfer = transfer_function(psf.to(image), (image.shape[0], image.shape[1]))
    return fit_power_law_with_mtf(image, squared_modulus(transfer))


@torch.no_grad()
def fit_power_law_with_mtf(
    image: torch.Tensor, squared_mtf: torch.Tensor, region: torch.Tensor | None = None
) -> PowerLaw:
    """The same, of what lets a share of each frequency's power through.

    squared_mtf: that share, on the photograph's rfft2 grid: several PSFs let the mean of theirs.
    region: a smooth window, of which part of it."""
    shape = int(image.shape[0]), int(image.shape[1])
    if min(shape) < 2 * _MIN_PERIODS + 2 or float(image.std()) == 0:
        return PowerLaw(0.0, 2.0, float(image.var(correction=0)) if image.numel() > 1 else 0.0)
    power, squares = _windowed_periodogram(image, region), squared_frequencies(shape).to(image)
    used = (squares > (_MIN_PERIODS / min(shape)) ** 2).flatten().nonzero()[:, 0]
    return _fit_binned_spectrum(
        *(each.flatten()[used] for each in (power, squares, squared_mtf.to(image)))
    )


def _windowed_periodogram(image: torch.Tensor, region: torch.Tensor | None) -> torch.Tensor:
    """Power of the frame times a window that falls to 0 at its border; of white noise its
    variance."""
    rows, columns = (torch.hann_window(n + 2, False, dtype=image.dtype)[1:-1] for n in image.shape)
    window = rows[:, None] * columns
    if region is not None:
        window = window * region.to(window)
    square = window.square()
    detail = (image - (image * square).sum() / square.sum()) * window
    spectrum = rfft2(detail)
    return squared_modulus(spectrum) / square.sum()


def squared_frequencies(shape: tuple[int, int]) -> torch.Tensor:
    """Squares of the frequencies of the rfft2 grid, cycles per pixel, float64."""
    fy, fx = rfft2_frequencies(Plane(shape, (1.0, 1.0)))
    return fy.square() + fx.square()


def squared_modulus(spectrum: torch.Tensor) -> torch.Tensor:
    """Of the modulus."""
    return spectrum.real.square().addcmul_(spectrum.imag, spectrum.imag)


def _fit_binned_spectrum(
    power: torch.Tensor, squares: torch.Tensor, squared_mtf: torch.Tensor
) -> PowerLaw:
    pools = _SpectrumBins.of(power, squares, squared_mtf)
    lowest = float(pools.power.min())
    fits = [pools.fit(lowest * share) for share in (1.0, 0.03)]
    strength, slope, noise = min(fits, key=pools.negative_log_likelihood)
    signal = pools.signal_power(strength, slope)
    for _ in range(3):
        quiet = signal < _MAX_SIGNAL_TO_NOISE * noise
        share = pools.share[quiet]
        if float(share.sum()) * len(power) < _MIN_NOISE_FREQUENCIES:
            break
        left = share * (pools.power[quiet] - signal[quiet])
        noise = max(float(left.sum() / share.sum()), 0.1 * noise)
    return PowerLaw(strength, slope, noise)


@dataclass(frozen=True)
class _SpectrumBins:
    """Means over frequencies of about the same radius and transfer, in float64; share: of all
    frequencies that each pool has."""

    share: torch.Tensor
    power: torch.Tensor
    radius: torch.Tensor
    squared_mtf: torch.Tensor

    @classmethod
    def of(
        cls, power: torch.Tensor, squares: torch.Tensor, squared_mtf: torch.Tensor
    ) -> _SpectrumBins:
        radius = 0.5 * squares.log()
        ring = _bin_index(radius, _RADIUS_BINS)
        kind = _bin_index(squared_mtf.clamp(min=_MIN_SQUARED_MTF).log(), _MTF_BINS)
        pool = ring * _MTF_BINS + kind
        count = torch.bincount(pool, minlength=_RADIUS_BINS * _MTF_BINS)
        full = count > 0
        number = count[full].to(torch.float64)

        def mean(of: torch.Tensor) -> torch.Tensor:
            sums = torch.bincount(pool, of, minlength=_RADIUS_BINS * _MTF_BINS)
            return sums[full].to(torch.float64) / number

        return cls(number / number.sum(), mean(power), mean(radius), mean(squared_mtf))

    def signal_power(self, strength: float, slope: float) -> torch.Tensor:
        """The signal's power."""
        return strength * self.squared_mtf * torch.exp(-slope * self.radius)

    def negative_log_likelihood(self, fit: tuple[float, float, float]) -> float:
        """Whittle's, of a strength, slope and noise."""
        model = self.signal_power(*fit[:2]) + fit[2]
        return float((self.share * (model.log() + self.power / model)).sum())

    def fit(self, noise: float) -> tuple[float, float, float]:
        """By Fisher's scoring in logarithms, from a noise on; steps that don't help get shorter."""
        above = (self.share * (self.power - noise).clamp(min=0)).sum()
        signal = (self.share * self.signal_power(1.0, 2.4)).sum()
        now = (max(float(above / signal), 1e-30), 2.4, max(noise, 1e-30))
        best, damping = self.negative_log_likelihood(now), 1e-3
        for _ in range(_STEPS):
            tried = self._scoring_step(now, damping)
            score = self.negative_log_likelihood(tried)
            if score < best:
                settled = best - score < 1e-9
                now, best, damping = tried, score, damping / 5
                if settled:
                    break
            else:
                damping *= 10
        return now

    def _scoring_step(
        self, now: tuple[float, float, float], damping: float
    ) -> tuple[float, float, float]:
        strength, slope, noise = now
        signal = self.signal_power(strength, slope)
        model = signal + noise
        slopes = torch.stack([signal, -signal * self.radius, torch.full_like(signal, noise)])
        weight = self.share / model**2
        normal = (slopes * weight) @ slopes.T
        normal = normal + damping * torch.diag(normal.diag() + 1e-30)
        wanted = (slopes * weight) @ (self.power - model)
        step = torch.linalg.solve(normal, wanted).clamp(-2, 2)
        return (
            strength * math.exp(float(step[0])),
            min(max(slope + float(step[1]), 0.0), 6.0),
            noise * math.exp(float(step[2])),
        )


def _bin_index(value: torch.Tensor, count: int) -> torch.Tensor:
    """Which of so many even parts of its range each value is in."""
    low, high = value.min(), value.max()
    place = (value - low) / (high - low).clamp(min=1e-12) * count
    return place.long().clamp(0, count - 1)
