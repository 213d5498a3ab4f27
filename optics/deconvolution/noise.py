"""Estimation of a blurred photograph's noise, of its PSF's error, and of its spectrum's power law.

The noise shows best at frequencies that the blur suppresses. What light is left there beyond white
noise is what the PSF's error makes of the scene.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from optics.formation import rfft2_frequencies
from optics.fourier import rfft2
from optics.operators.blur import transfer_function
from optics.plane import Plane

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SpectrumFitSettings:
    """Tune the fit of a power law and noise to a photograph's spectrum.

    Attributes
    ----------
    min_periods : int
        Lowest frequency that is used, in periods per frame. The window and slow trends of the
        picture dominate the frequencies below. Chosen, like all values without another origin.
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
    least_evidence : float
        Logarithm of the likelihood ratio, per frequency, from which the PSF's error is believed.
        With exact PSFs it is 0.003 at most, with measured ones 0.013 to 0.08.
    least_total_evidence : float
        The same for all frequencies together. Frames of 100 pixels, whose spectra leave the power
        law, reach 94 with exact PSFs; measured ones on frames of 255 pixels 411 and more.
    model_error_factor : float
        Factor on the noise if there is such an error. Measured: the best of 1 to 3 in the mean of
        33 photographs with PSFs that were disturbed by random errors.
    flat_share : float
        Share of the photograph's blocks that are taken to be flat.
    flat_block : int
        Pixels along a side of a block.
    flat_ratio : float
        Noise over that of flat blocks below which the spectrum's noise isn't believed: the power
        law has taken it for detail.
    """

    min_periods: int = 3
    radius_bins: int = 24
    mtf_bins: int = 16
    min_squared_mtf: float = 1e-8
    steps: int = 40
    max_signal_to_noise: float = 0.1
    min_noise_frequencies: int = 300
    least_evidence: float = 0.004
    least_total_evidence: float = 120.0
    model_error_factor: float = 1.5
    flat_share: float = 0.1
    flat_block: int = 16
    flat_ratio: float = 0.5


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
    cycles per pixel. `model_error_variance` is the variance that the PSF's error adds, expressed as
    white noise that harms a restoration as much.
    """

    strength: float
    slope: float
    noise_variance: float
    model_error_variance: float = 0.0

    @property
    def total_variance(self) -> float:
        """The variance against which a deconvolution weighs its prior: noise and model error."""
        return self.noise_variance + self.model_error_variance

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
        share = scene * squared_mtf / (scene * squared_mtf + max(self.total_variance, 1e-30))
        # The squared transfer function of differences between neighbours is 4 sin²(π f) per axis,
        # which is about (2 π f)² at low frequencies and no more than 8 for both axes.
        steep = (4 * math.pi**2 * squares).clamp(max=8)
        return WienerPrediction(
            float(share.mean()), math.sqrt(float((scene * share * steep).mean()))
        )


@torch.no_grad()
def fit_power_law(
    image: torch.Tensor, psf: torch.Tensor, *, finds_model_error: bool = True
) -> PowerLaw:
    """Fit a power law and white noise to a blurred photograph's spectrum, for deconvolution.

    The photograph is (rows, columns). `psf` has a sum of 1. `finds_model_error` is False where
    pixels were filled in, which the PSF doesn't explain either. The spectrum of the frame, with a
    Hann window, is modelled as the sum of white noise and of a scene blurred by the PSF, whose
    power falls as a power of the frequency. Strength, slope and noise maximise the likelihood of
    independent, exponentially distributed powers (Whittle 1953). Frequencies that the PSF
    suppresses show the noise. Power that is left there and falls with the frequency is the scene,
    blurred by the error of the PSF. In a photograph without blur, the finest detail of the scene
    counts as noise.
    """
    transfer = transfer_function(psf.to(image), (image.shape[0], image.shape[1]))
    law = fit_power_law_with_mtf(
        image, squared_modulus(transfer), finds_model_error=finds_model_error
    )
    flat = _flat_block_noise(image)
    if law.total_variance >= (_SETTINGS.flat_ratio * flat) ** 2:
        return law
    return PowerLaw(law.strength, law.slope, flat**2)


def _flat_block_noise(image: torch.Tensor) -> float:
    """Estimate a blurred photograph's noise from second differences in its flattest blocks.

    Of white noise they keep 36 times the variance, and of a smooth picture hardly anything
    (Immerkaer 1996, doi 10.1006/cviu.1996.0060). Returns 0 for a photograph without blocks.
    """
    side = _SETTINGS.flat_block
    if min(image.shape) < 2 * side + 2:
        return 0.0
    down = image[2:] - 2 * image[1:-1] + image[:-2]
    both = down[:, 2:] - 2 * down[:, 1:-1] + down[:, :-2]
    rows, columns = (n // side for n in both.shape)
    blocks = both[: rows * side, : columns * side].reshape(rows, side, columns, side)
    power = blocks.square().mean((1, 3)).flatten() / 36
    return math.sqrt(float(torch.quantile(power.to(torch.float64), _SETTINGS.flat_share)))


@torch.no_grad()
def fit_power_law_with_mtf(
    image: torch.Tensor,
    squared_mtf: torch.Tensor,
    region: torch.Tensor | None = None,
    *,
    finds_model_error: bool = True,
) -> PowerLaw:
    """Fit a power law and noise to a blurred photograph's spectrum for deconvolution, given an MTF.

    `squared_mtf` is the squared MTF on the photograph's rfft2 grid; for several PSFs it is the mean
    of their squared MTFs. `region` is a smooth window, (rows, columns), around the part of the
    photograph that is used. `finds_model_error`: as for fit_power_law().
    """
    shape = int(image.shape[0]), int(image.shape[1])
    if min(shape) < 2 * _SETTINGS.min_periods + 2 or float(image.std()) == 0:
        return PowerLaw(0.0, 2.0, float(image.var(correction=0)) if image.numel() > 1 else 0.0)
    power, squares = _windowed_periodogram(image, region), squared_frequencies(shape).to(image)
    seen = _smooth_by_window(squared_mtf.to(image), shape[1])
    used = (squares > (_SETTINGS.min_periods / min(shape)) ** 2).flatten().nonzero()[:, 0]
    binned = (each.flatten()[used] for each in (power, squares, seen))
    return _fit_binned_spectrum(*binned, finds_model_error=finds_model_error)


def _smooth_by_window(squared_mtf: torch.Tensor, columns: int) -> torch.Tensor:
    """Smooth a squared MTF as the Hann window smooths a photograph's power spectrum.

    The window's spectrum has three samples along an axis, whose squares are as 1 : 4 : 1. Without
    this step, zeros of the MTF seem to let light through. squared_mtf: on the rfft2 grid of a frame
    with that many columns.
    """
    along_y = (squared_mtf.roll(1, 0) + squared_mtf.roll(-1, 0) + 4 * squared_mtf) / 6
    # Beyond the ends of the half spectrum, it continues with the rows in reverse.
    mirrored = torch.cat([along_y[:1], along_y[1:].flip(0)])
    last = mirrored[:, -1 if columns % 2 else -2]
    wide = torch.cat([mirrored[:, 1:2], along_y, last[:, None]], 1)
    return (wide[:, :-2] + wide[:, 2:] + 4 * along_y) / 6


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
    power: torch.Tensor,
    squares: torch.Tensor,
    squared_mtf: torch.Tensor,
    *,
    finds_model_error: bool,
) -> PowerLaw:
    """Fit a power law and noise to the binned spectrum of a photograph to be deconvolved.

    The likelihood is maximised from two initial noise levels, and the likelier fit is kept. Its
    noise is then replaced by the mean power above the signal at frequencies where the signal is
    weak. Another fit looks there for light that falls with the frequency, which the PSF's error
    leaves.
    """
    pools = _SpectrumBins.of(power, squares, squared_mtf)
    lowest = max(float(pools.power.min()), 1e-30)
    plain = min(
        (pools.fit(pools.initial_law(lowest * share)) for share in (1.0, 0.03)),
        key=pools.negative_log_likelihood,
    )
    noise = _noise_at_quiet_frequencies(pools, plain, len(power))
    if finds_model_error and (law := _law_with_model_error(pools, plain, len(power))):
        total = _SETTINGS.model_error_factor**2 * pools.harmful_variance(law)
        return PowerLaw(law.strength, law.slope, noise, max(total - noise, 0.0))
    return PowerLaw(plain.strength, plain.slope, noise)


def _noise_at_quiet_frequencies(pools: _SpectrumBins, law: _SpectrumLaw, count: int) -> float:
    """Return the mean power above the signal where a photograph's signal is weak.

    count: of all frequencies. Where too few are quiet, the result is the law's noise.
    """
    noise, signal = law.noise, pools.signal_power(law)
    for _ in range(3):
        quiet = signal < _SETTINGS.max_signal_to_noise * noise
        share = pools.share[quiet]
        if float(share.sum()) * count < _SETTINGS.min_noise_frequencies:
            break
        left = share * (pools.power[quiet] - signal[quiet])
        noise = max(float(left.sum() / share.sum()), 0.1 * noise)
    return noise


def _law_with_model_error(
    pools: _SpectrumBins, plain: _SpectrumLaw, count: int
) -> _SpectrumLaw | None:
    """Fit a photograph's law with the error of the PSF; None without evidence of such an error.

    count: of all frequencies.
    """
    law = min(
        (pools.fit(pools.with_model_error(plain, slope)) for slope in (1.0, 2.5)),
        key=pools.negative_log_likelihood,
    )
    evidence = pools.negative_log_likelihood(plain) - pools.negative_log_likelihood(law)
    least = max(_SETTINGS.least_evidence, _SETTINGS.least_total_evidence / count)
    return law if evidence > least else None


@dataclass(frozen=True)
class _SpectrumLaw:
    """A law of a photograph's binned spectrum: |H|² S / f^slope + noise + E / f^error_slope.

    `strength` is S and `error` is E; without a PSF error, E is 0.
    """

    strength: float
    slope: float
    noise: float
    error: float = 0.0
    error_slope: float = 2.0

    def add_step(self, step: Sequence[float]) -> _SpectrumLaw:
        """Return the law after a step of its parameters, of which powers are logarithms."""
        first = (
            self.strength * math.exp(step[0]),
            min(max(self.slope + step[1], 0.0), 6.0),
            self.noise * math.exp(step[2]),
        )
        if len(step) == 3:
            return _SpectrumLaw(*first)
        slope = min(max(self.error_slope + step[4], 0.0), 4.0)
        return _SpectrumLaw(*first, self.error * math.exp(step[3]), slope)


@dataclass(frozen=True)
class _SpectrumBins:
    """A photograph's power spectrum, averaged over frequencies of similar modulus and MTF.

    `share` is the share of all frequencies in each bin; `radius` is the mean logarithm of the
    frequency's modulus.
    """

    share: Array
    power: Array
    radius: Array
    squared_mtf: Array

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

        def mean(of: torch.Tensor) -> Array:
            sums = torch.bincount(pool, of, minlength=radius_bins * mtf_bins)
            return np.asarray((sums[full].to(torch.float64) / number).numpy())

        share = np.asarray((number / number.sum()).numpy())
        return cls(share, mean(power), mean(radius), mean(squared_mtf))

    def signal_power(self, law: _SpectrumLaw) -> Array:
        """Return the blurred scene's power in each bin of the spectrum, for deconvolution.

        Neither noise nor the PSF's error is included.
        """
        return np.asarray(law.strength * self.squared_mtf * np.exp(-law.slope * self.radius))

    def _error_power(self, law: _SpectrumLaw) -> Array:
        return np.asarray(law.error * np.exp(-law.error_slope * self.radius))

    def negative_log_likelihood(self, law: _SpectrumLaw) -> float:
        """Return Whittle's negative log-likelihood of a photograph's law, for deconvolution."""
        model = self.signal_power(law) + law.noise + self._error_power(law)
        return float((self.share * (np.log(model) + self.power / model)).sum())

    def initial_law(self, noise: float) -> _SpectrumLaw:
        """Return a first law of a photograph's spectrum for a noise variance."""
        above = (self.share * (self.power - noise).clip(min=0)).sum()
        signal = (self.share * self.signal_power(_SpectrumLaw(1.0, 2.4, 0.0))).sum()
        return _SpectrumLaw(max(float(above / signal), 1e-30), 2.4, max(noise, 1e-30))

    def with_model_error(self, law: _SpectrumLaw, slope: float) -> _SpectrumLaw:
        """Return a law with a first error of the PSF: a sixth of the noise at half a cycle."""
        error = law.noise / 6 * 0.5**slope
        return _SpectrumLaw(law.strength, law.slope, law.noise, error, slope)

    def harmful_variance(self, law: _SpectrumLaw) -> float:
        """Return the white noise's variance that harms a restoration as noise and PSF error do.

        It is the geometric mean over frequencies at which neither the scene nor the disturbance
        prevails: there, a restoration depends on how strong its prior is. An arithmetic mean
        follows the low frequencies, at which the error's law is steepest and known worst.
        """
        signal, disturbance = self.signal_power(law), law.noise + self._error_power(law)
        kept = signal / (signal + disturbance)
        weight = self.share * kept * (1 - kept) + 1e-30
        return math.exp(float((weight * np.log(disturbance)).sum() / weight.sum()))

    def fit(self, start: _SpectrumLaw) -> _SpectrumLaw:
        """Fit a photograph's law from a first one, for deconvolution, by Fisher scoring.

        A step that doesn't raise the likelihood is repeated with more damping. The PSF's error is
        fitted if the first law has one.
        """
        now, best, damping = start, self.negative_log_likelihood(start), 1e-3
        for _ in range(_SETTINGS.steps):
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

    def _scoring_step(self, now: _SpectrumLaw, damping: float) -> list[float]:
        """Return one damped Fisher-scoring step in the fit of a law for deconvolution."""
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
    """Return the index of each spectrum value's bin, for the noise fit of a deconvolution.

    The `count` bins have equal width over the range of the values.
    """
    low, high = value.min(), value.max()
    place = (value - low) / (high - low).clamp(min=1e-12) * count
    return place.long().clamp(0, count - 1)
