"""Laws of a blurred photograph's power spectrum, and their fit to the binned spectrum."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

Array = NDArray[np.float64]

_RADIUS_BINS, _MTF_BINS = 24, 16
"""Number of bins of the frequency's modulus, and of the squared MTF."""

_MIN_SQUARED_MTF = 1e-8
"""Squared MTF below which all frequencies are in one bin."""

_STEPS = 40
"""Largest number of scoring steps of a fit."""


@dataclass(frozen=True)
class SpectrumLaw:
    """A law of binned power, |H|² S / f^slope + noise + E / f^error_slope.

    `strength` is S and `error` is E; without a PSF error, E is 0.
    """

    strength: float
    slope: float
    noise: float
    error: float = 0.0
    error_slope: float = 2.0

    def add_step(self, step: Sequence[float]) -> SpectrumLaw:
        """Return the law after a step of its parameters, of which powers are logarithms."""
        first = (
            self.strength * math.exp(step[0]),
            min(max(self.slope + step[1], 0.0), 6.0),
            self.noise * math.exp(step[2]),
        )
        if len(step) == 3:
            return SpectrumLaw(*first)
        slope = min(max(self.error_slope + step[4], 0.0), 4.0)
        return SpectrumLaw(*first, self.error * math.exp(step[3]), slope)


@dataclass(frozen=True)
class SpectrumBins:
    """A power spectrum, averaged over frequencies of similar modulus and MTF.

    share: share of all frequencies in each bin.
    radius: mean logarithm of the frequency's modulus.
    """

    share: Array
    power: Array
    radius: Array
    squared_mtf: Array

    @classmethod
    def of(
        cls,
        power: torch.Tensor,
        squares: torch.Tensor,
        squared_mtf: torch.Tensor,
        weight: torch.Tensor,
    ) -> SpectrumBins:
        """Average a power spectrum over bins of modulus and MTF, by the frequencies' weight."""
        radius_bins, mtf_bins = _RADIUS_BINS, _MTF_BINS
        radius = 0.5 * squares.log()
        ring = _bin_index(radius, radius_bins)
        kind = _bin_index(squared_mtf.clamp(min=_MIN_SQUARED_MTF).log(), mtf_bins)
        pool = ring * mtf_bins + kind
        count = torch.bincount(pool, weight, minlength=radius_bins * mtf_bins)
        full = count > 0
        number = count[full].to(torch.float64)

        def mean(of: torch.Tensor) -> Array:
            sums = torch.bincount(pool, of * weight, minlength=radius_bins * mtf_bins)
            return np.asarray((sums[full].to(torch.float64) / number).numpy())

        share = np.asarray((number / number.sum()).numpy())
        return cls(share, mean(power), mean(radius), mean(squared_mtf))

    def signal_power(self, law: SpectrumLaw) -> Array:
        """Return the blurred scene's power in each bin, without noise or the PSF's error."""
        return np.asarray(law.strength * self.squared_mtf * np.exp(-law.slope * self.radius))

    def _error_power(self, law: SpectrumLaw) -> Array:
        return np.asarray(law.error * np.exp(-law.error_slope * self.radius))

    def negative_log_likelihood(self, law: SpectrumLaw) -> float:
        """Return Whittle's negative log-likelihood of a law."""
        model = self.signal_power(law) + law.noise + self._error_power(law)
        return float((self.share * (np.log(model) + self.power / model)).sum())

    def initial_law(self, noise: float) -> SpectrumLaw:
        """Return a first law for a noise variance."""
        above = (self.share * (self.power - noise).clip(min=0)).sum()
        signal = (self.share * self.signal_power(SpectrumLaw(1.0, 2.4, 0.0))).sum()
        return SpectrumLaw(max(float(above / signal), 1e-30), 2.4, max(noise, 1e-30))

    def with_model_error(self, law: SpectrumLaw, slope: float) -> SpectrumLaw:
        """Return a law with a first error of the PSF: a sixth of the noise at half a cycle."""
        error = law.noise / 6 * 0.5**slope
        return SpectrumLaw(law.strength, law.slope, law.noise, error, slope)

    def harmful_variance(self, law: SpectrumLaw) -> float:
        """Return the variance of white noise that does as much harm as noise and PSF error.

        It is the geometric mean over frequencies at which neither the scene nor the disturbance
        prevails: there, a restoration depends on how strong its prior is. An arithmetic mean
        follows the low frequencies, at which the error's law is steepest and known worst.
        """
        signal, disturbance = self.signal_power(law), law.noise + self._error_power(law)
        kept = signal / (signal + disturbance)
        weight = self.share * kept * (1 - kept) + 1e-30
        return math.exp(float((weight * np.log(disturbance)).sum() / weight.sum()))

    def fit(self, start: SpectrumLaw) -> SpectrumLaw:
        """Fit a law by Fisher scoring, from a first one.

        A step that doesn't raise the likelihood is repeated with more damping. The PSF's error is
        fitted if the first law has one.
        """
        now, best, damping = start, self.negative_log_likelihood(start), 1e-3
        for _ in range(_STEPS):
            tried = now.add_step(self._scoring_step(now, damping))
            score = self.negative_log_likelihood(tried)
            if score < best:
                settled = best - score < 1e-9
                now, best, damping = tried, score, damping / 5
                if settled:
                    break
            else:
                damping *= 10
        return now

    def _scoring_step(self, now: SpectrumLaw, damping: float) -> list[float]:
        """Return one damped step of Fisher scoring."""
        signal, error = self.signal_power(now), self._error_power(now)
        model = signal + now.noise + error
        slopes = [signal, -signal * self.radius, np.full_like(signal, now.noise)]
        if now.error:
            slopes += [error, -error * self.radius]
        rows = np.stack(slopes)
        weight = self.share / model**2
        normal = (rows * weight) @ rows.T
        normal += damping * np.diag(np.diag(normal) + 1e-30)
        wanted = (rows * weight) @ (self.power - model)
        step = np.linalg.lstsq(normal, wanted, rcond=1e-12)[0]
        return [float(one) for one in step.clip(-2, 2)]


def _bin_index(value: torch.Tensor, count: int) -> torch.Tensor:
    """Return the index of each value's bin, of `count` that divide the values' range evenly."""
    low, high = value.min(), value.max()
    place = (value - low) / (high - low).clamp(min=1e-12) * count
    return place.long().clamp(0, count - 1)
