"""Estimation of a blurred photograph's noise and of the power law of its spectrum.

The noise shows best at frequencies that the blur suppresses.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch

from optics.formation import rfft2_frequencies
from optics.fourier import rfft2
from optics.operators.blur import transfer_function
from optics.plane import Plane


@dataclass(frozen=True)
class SpectrumFitSettings:
    """Tune the fit of a power law and noise to a photograph's spectrum.

    All values are chosen.

    Attributes
    ----------
    min_periods : int
        Lowest frequency that is used, in periods per frame. The window and slow trends of the
        picture dominate the frequencies below.
    radius_bins : int
        Number of bins of the frequency's modulus.
    mtf_bins : int
        Number of bins of the squared MTF.
    min_squared_mtf : float
        Squared MTF below which all frequencies are in one bin.
    steps : int
        Largest number of scoring steps of the fit.
    max_signal_to_noise : float
        Ratio of signal to noise power below which a frequency shows the noise alone.
    min_noise_frequencies : int
        Number of such frequencies from which the noise is taken from them alone.
    """

    min_periods: int = 3
    radius_bins: int = 24
    mtf_bins: int = 16
    min_squared_mtf: float = 1e-8
    steps: int = 40
    max_signal_to_noise: float = 0.1
    min_noise_frequencies: int = 300


_SETTINGS = SpectrumFitSettings()


@dataclass(frozen=True)
class WienerPrediction:
    """A prediction of what the Wiener filter restores of a photograph.

    `explained_share` is the share of the data that the filter explains. `gradient` is the rms
    length of the restored picture's gradient, in light per pixel, times the sum of the PSF.
    """

    explained_share: float
    gradient: float


@dataclass(frozen=True)
class PowerLaw:
    """A model of a photograph's power spectrum: |H|² strength / frequency^slope + noise_variance.

    `strength` and `noise_variance` are variances per pixel of the photograph; the frequency is in
    cycles per pixel.
    """

    strength: float
    slope: float
    noise_variance: float

    def wiener_prediction(
        self, squared_mtf: torch.Tensor, shape: tuple[int, int]
    ) -> WienerPrediction:
        """Predict what Wiener deconvolution restores of a photograph with this power spectrum.

        The Wiener filter has the least mean square error for the spectrum (Wiener 1949).
        `squared_mtf` is |H|² on the rfft2 grid of a period of `shape`.
        """
        squares = squared_frequencies(shape).to(squared_mtf)
        squares[0, 0] = max(shape) ** -2
        scene = self.strength * squares ** (-self.slope / 2)
        share = scene * squared_mtf / (scene * squared_mtf + max(self.noise_variance, 1e-30))
        # The squared transfer function of differences between neighbours is 4 sin²(π f) per axis,
        # which is about (2 π f)² at low frequencies and no more than 8 for both axes.
        steep = (4 * math.pi**2 * squares).clamp(max=8)
        return WienerPrediction(
            float(share.mean()), math.sqrt(float((scene * share * steep).mean()))
        )


@torch.no_grad()
def fit_power_law(image: torch.Tensor, psf: torch.Tensor) -> PowerLaw:
    """Fit a power law and white noise to a blurred photograph's spectrum, for deconvolution.

    The photograph is (rows, columns). `psf` has a sum of 1. The spectrum of the frame, with a Hann
    window, is modelled as the sum of white noise and of a scene blurred by the PSF, whose power
    falls as a power of the frequency. Strength, slope and noise maximise the likelihood of
    independent, exponentially distributed powers (Whittle 1953). Frequencies that the PSF
    suppresses show the noise. In a photograph without blur, the finest detail of the scene counts
    as noise.
    """
    transfer = transfer_function(psf.to(image), (image.shape[0], image.shape[1]))
    return fit_power_law_with_mtf(image, squared_modulus(transfer))


@torch.no_grad()
def fit_power_law_with_mtf(
    image: torch.Tensor, squared_mtf: torch.Tensor, region: torch.Tensor | None = None
) -> PowerLaw:
    """Fit a power law and noise to a blurred photograph's spectrum for deconvolution, given an MTF.

    `squared_mtf` is the squared MTF on the photograph's rfft2 grid; for several PSFs it is the mean
    of their squared MTFs. `region` is a smooth window, (rows, columns), around the part of the
    photograph that is used.
    """
    shape = int(image.shape[0]), int(image.shape[1])
    if min(shape) < 2 * _SETTINGS.min_periods + 2 or float(image.std()) == 0:
        return PowerLaw(0.0, 2.0, float(image.var(correction=0)) if image.numel() > 1 else 0.0)
    power, squares = _windowed_periodogram(image, region), squared_frequencies(shape).to(image)
    used = (squares > (_SETTINGS.min_periods / min(shape)) ** 2).flatten().nonzero()[:, 0]
    return _fit_binned_spectrum(
        *(each.flatten()[used] for each in (power, squares, squared_mtf.to(image)))
    )


def _windowed_periodogram(image: torch.Tensor, region: torch.Tensor | None) -> torch.Tensor:
    """Compute the power spectrum of a photograph to be deconvolved, with a Hann window.

    The scale is chosen so that the mean power of white noise is its variance.
    """
    rows, columns = (torch.hann_window(n + 2, False, dtype=image.dtype)[1:-1] for n in image.shape)
    window = rows[:, None] * columns
    if region is not None:
        window = window * region.to(window)
    square = window.square()
    detail = (image - (image * square).sum() / square.sum()) * window
    spectrum = rfft2(detail)
    return squared_modulus(spectrum) / square.sum()


def squared_frequencies(shape: tuple[int, int]) -> torch.Tensor:
    """Return the squared spatial frequencies of a deconvolution's rfft2 grid, in (cycles/pixel)².

    The result is float64.
    """
    fy, fx = rfft2_frequencies(Plane(shape, (1.0, 1.0)))
    return fy.square() + fx.square()


def squared_modulus(spectrum: torch.Tensor) -> torch.Tensor:
    """Return the squared modulus of a complex spectrum or OTF in a deconvolution."""
    return spectrum.real.square().addcmul_(spectrum.imag, spectrum.imag)


def _fit_binned_spectrum(
    power: torch.Tensor, squares: torch.Tensor, squared_mtf: torch.Tensor
) -> PowerLaw:
    """Fit a power law and noise to the binned spectrum of a photograph to be deconvolved.

    The likelihood is maximised from two initial noise levels, and the likelier fit is kept. Its
    noise is then replaced by the mean power above the signal at frequencies where the signal is
    weak.
    """
    pools = _SpectrumBins.of(power, squares, squared_mtf)
    lowest = float(pools.power.min())
    fits = [pools.fit(lowest * share) for share in (1.0, 0.03)]
    strength, slope, noise = min(fits, key=pools.negative_log_likelihood)
    signal = pools.signal_power(strength, slope)
    for _ in range(3):
        quiet = signal < _SETTINGS.max_signal_to_noise * noise
        share = pools.share[quiet]
        if float(share.sum()) * len(power) < _SETTINGS.min_noise_frequencies:
            break
        left = share * (pools.power[quiet] - signal[quiet])
        noise = max(float(left.sum() / share.sum()), 0.1 * noise)
    return PowerLaw(strength, slope, noise)


@dataclass(frozen=True)
class _SpectrumBins:
    """A photograph's power spectrum, averaged over frequencies of similar modulus and MTF.

    `share` is the share of all frequencies in each bin; `radius` is the mean logarithm of the
    frequency's modulus. All values are float64.
    """

    share: torch.Tensor
    power: torch.Tensor
    radius: torch.Tensor
    squared_mtf: torch.Tensor

    @classmethod
    def of(
        cls, power: torch.Tensor, squares: torch.Tensor, squared_mtf: torch.Tensor
    ) -> _SpectrumBins:
        """Average a power spectrum over frequency and MTF bins, for a deconvolution's noise fit.

        Frequencies are binned by their modulus.
        """
        radius_bins, mtf_bins = _SETTINGS.radius_bins, _SETTINGS.mtf_bins
        radius = 0.5 * squares.log()
        ring = _bin_index(radius, radius_bins)
        kind = _bin_index(squared_mtf.clamp(min=_SETTINGS.min_squared_mtf).log(), mtf_bins)
        pool = ring * mtf_bins + kind
        count = torch.bincount(pool, minlength=radius_bins * mtf_bins)
        full = count > 0
        number = count[full].to(torch.float64)

        def mean(of: torch.Tensor) -> torch.Tensor:
            sums = torch.bincount(pool, of, minlength=radius_bins * mtf_bins)
            return sums[full].to(torch.float64) / number

        return cls(number / number.sum(), mean(power), mean(radius), mean(squared_mtf))

    def signal_power(self, strength: float, slope: float) -> torch.Tensor:
        """Return the blurred scene's power in each bin of the spectrum, for deconvolution.

        The noise isn't included.
        """
        return strength * self.squared_mtf * torch.exp(-slope * self.radius)

    def negative_log_likelihood(self, fit: tuple[float, float, float]) -> float:
        """Return Whittle's negative log-likelihood of a photograph's power law, for deconvolution.

        `fit` is the strength, the slope and the noise variance.
        """
        model = self.signal_power(*fit[:2]) + fit[2]
        return float((self.share * (model.log() + self.power / model)).sum())

    def fit(self, noise: float) -> tuple[float, float, float]:
        """Fit strength, slope and noise of the power law of a photograph to be deconvolved.

        The likelihood is maximised by Fisher scoring. The search starts from the noise variance
        `noise`. Strength and noise are fitted as logarithms. A step that doesn't raise the
        likelihood is repeated with more damping. Returns the strength, the slope and the noise
        variance.
        """
        above = (self.share * (self.power - noise).clamp(min=0)).sum()
        signal = (self.share * self.signal_power(1.0, 2.4)).sum()
        now = (max(float(above / signal), 1e-30), 2.4, max(noise, 1e-30))
        best, damping = self.negative_log_likelihood(now), 1e-3
        for _ in range(_SETTINGS.steps):
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
        """Do one damped Fisher-scoring step in the fit of a power law for deconvolution.

        Returns the strength, the slope and the noise variance.
        """
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
    """Return the index of each spectrum value's bin, for the noise fit of a deconvolution.

    The `count` bins have equal width over the range of the values.
    """
    low, high = value.min(), value.max()
    place = (value - low) / (high - low).clamp(min=1e-12) * count
    return place.long().clamp(0, count - 1)
