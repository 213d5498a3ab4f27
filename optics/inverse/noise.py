"""Estimate a blurred photograph's noise, its PSF's error, and its spectrum's power law.

The noise shows best at frequencies that the blur suppresses. What light is left there beyond white
noise is what the PSF's error makes of the scene.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.special import gammaincinv

from optics.fourier import rfft2, rfft_column_weights
from optics.inverse.blur import transfer_function
from optics.inverse.operator import squared_modulus

Array = NDArray[np.float64]

# Lowest frequency that is used, in periods per frame. The window and slow trends of the picture
# dominate those below. Chosen.
_MIN_PERIODS = 3

# Ratio of signal to noise power below which a frequency shows the noise alone, and the number of
# such frequencies from which the noise is taken from them. Chosen.
_MAX_SIGNAL_TO_NOISE, _MIN_NOISE_FREQUENCIES = 0.1, 300

# Logarithm of the likelihood ratio, per frequency and of all, from which the PSF's error is
# believed. Of 480 photographs with exact PSFs, they are 0.008 and 345 at most. With measured PSFs
# they are 0.013 to 0.08, and on frames of 255 pixels 411 and more.
_LEAST_EVIDENCE, _LEAST_TOTAL_EVIDENCE = 0.008, 280.0

# Standard deviation of noise and error over that of the noise from which the error is believed.
# Where the evidence with an exact PSF is above 220, it is 1.05 at most; with measured ones it is
# 1.29 and more.
_LEAST_HARM = 1.15

# Factor on the noise if there is such an error. Measured: the best of 1 to 3 in the mean of 33
# photographs with PSFs that were disturbed by random errors.
_MODEL_ERROR_FACTOR = 1.5

# Share of the photograph's blocks that are taken to be flat, and a block's side. Chosen.
_FLAT_SHARE, _FLAT_BLOCK = 0.1, 16

# Noise over that of flat blocks below which the spectrum's noise isn't believed: the power law
# has taken it for detail. Chosen.
_FLAT_RATIO = 0.45

# Number of bins of the frequency's modulus, and of the squared MTF, which has one for all below
# this. Chosen.
_RADIUS_BINS, _MTF_BINS, _MIN_SQUARED_MTF = 24, 16, 1e-8

_STEPS = 40  # largest number of scoring steps of a fit


@dataclass(frozen=True)
class PowerLaw:
    """A photograph's modelled power spectrum, |H|² strength / frequency^slope + noise_variance.

    Strength and variances are per pixel of the photograph; the frequency is in cycles per pixel.
    `model_error_variance` is that of white noise that does as much harm as the PSF's error.
    """

    strength: float
    slope: float
    noise_variance: float
    model_error_variance: float = 0.0

    @property
    def total_variance(self) -> float:
        """The variance of noise and model error, against which a prior is weighed."""
        return self.noise_variance + self.model_error_variance

    def wiener_prediction(
        self, squared_mtf: torch.Tensor, shape: tuple[int, int]
    ) -> tuple[float, float]:
        """Predict what the filter of least mean square error finds (Wiener 1949).

        Returns the share of the data that it explains, and the rms length of the found picture's
        gradient, in light per pixel, times the sum of the PSF.

        squared_mtf: |H|² on the rfft2 grid of a period of `shape`.
        """
        squares = squared_frequencies(shape).to(squared_mtf)
        squares[0, 0] = max(shape) ** -2
        scene = self.strength * squares ** (-self.slope / 2)
        share = scene * squared_mtf / (scene * squared_mtf + max(self.total_variance, 1e-30))
        # The squared transfer function of differences between neighbours is 4 sin²(π f) per axis,
        # which is about (2 π f)² at low frequencies and no more than 8 for both axes.
        steep = (4 * math.pi**2 * squares).clamp(max=8)
        weight = rfft_column_weights(shape[1]).to(share) / math.prod(shape)
        gradient = math.sqrt(float((scene * share * steep * weight).sum()))
        return float((share * weight).sum()), gradient


def squared_frequencies(shape: tuple[int, int]) -> torch.Tensor:
    """Return the squared frequencies of an rfft2 grid, (cycles/pixel)², float64."""
    down = torch.fft.fftfreq(shape[0], dtype=torch.float64)
    along = torch.fft.rfftfreq(shape[1], dtype=torch.float64)
    return down.square()[:, None] + along.square()


@torch.no_grad()
def mend_flat_noise(law: PowerLaw, image: torch.Tensor) -> PowerLaw:
    """Return a law, with the noise of flat blocks instead if it has taken noise for detail."""
    is_small = min(image.shape) <= 2 * _FLAT_BLOCK + 1
    flat = 0.0 if is_small else flat_block_noise([image], _FLAT_SHARE)
    if law.total_variance >= (_FLAT_RATIO * flat) ** 2:
        return law
    return PowerLaw(law.strength, law.slope, flat**2)


@torch.no_grad()
def flat_block_noise(planes: Sequence[torch.Tensor], share: float) -> float:
    """Estimate noise from the flattest blocks; 0 for fewer than three rows or columns.

    Second differences tell it (Immerkaer 1996, doi 10.1006/cviu.1996.0060). The noise is the one
    for which white noise has the variance that is found at the low quantile `share` of all blocks.
    """
    powers = []
    for plane in planes:
        if min(plane.shape) < 3:
            continue
        image = plane.to(torch.float64)
        down = image[2:] - 2 * image[1:-1] + image[:-2]
        both = down[:, 2:] - 2 * down[:, 1:-1] + down[:, :-2]
        side = min(_FLAT_BLOCK, *both.shape)
        rows, columns = both.shape[0] // side, both.shape[1] // side
        blocks = both[: rows * side, : columns * side].reshape(rows, side, columns, side)
        # White noise of variance 1 has differences of variance 36.
        powers.append(blocks.square().mean((1, 3)).flatten() / 36)
    if not powers:
        return 0.0
    found = torch.cat(powers)
    # Neighbouring second differences of white noise are correlated. Along an axis, this number of
    # them counts as one independent sample: the sum of the squared correlation coefficients.
    count = (_FLAT_BLOCK / (1 + 2 * ((4 / 6) ** 2 + (1 / 6) ** 2))) ** 2
    # The quantile of the chi-squared distribution, which the powers of blocks of noise have.
    expected = 2 * float(gammaincinv(count / 2, share)) / count if len(found) * share > 1 else 1.0
    return math.sqrt(float(torch.quantile(found, share)) / expected)


@torch.no_grad()
def fit_power_law(
    image: torch.Tensor,
    squared_mtf: torch.Tensor,
    region: torch.Tensor | None = None,
    *,
    finds_model_error: bool = True,
) -> PowerLaw:
    """Fit a power law and white noise to a blurred photograph's spectrum.

    The spectrum of the frame, with a Hann window, is modelled as the sum of white noise and of a
    scene blurred by the PSF, whose power falls as a power of the frequency. Strength, slope and
    noise maximise the likelihood of independent, exponentially distributed powers (Whittle 1953).
    The noise is then replaced by the mean power above the signal at frequencies where the PSF
    suppresses it. Power that is left there and falls with the frequency is the scene, blurred by
    the error of the PSF: another fit looks for it. In a photograph without blur, the finest detail
    of the scene counts as noise.

    squared_mtf: on the photograph's rfft2 grid; for several PSFs the mean of their squared MTFs.
    region: smooth window, (rows, columns), around the part of the photograph that is used.
    finds_model_error: False where pixels were filled in, which the PSF doesn't explain either.
    """
    spectrum = PhotographSpectrum.of(image, region)
    if spectrum is None:
        return PowerLaw(0.0, 2.0, float(image.var(correction=0)) if image.numel() > 1 else 0.0)
    count, bins = spectrum.count, spectrum.bins(spectrum.seen_mtf(squared_mtf))
    law = bins.likeliest(bins.first_laws())
    noise, signal = law.noise, bins.signal_power(law)
    for _ in range(3):
        quiet = signal < _MAX_SIGNAL_TO_NOISE * noise
        share = bins.share[quiet]
        if float(share.sum()) * count < _MIN_NOISE_FREQUENCIES:
            break
        left = share * (bins.power[quiet] - signal[quiet])
        noise = max(float(left.sum() / share.sum()), 0.1 * noise)
    if not finds_model_error:
        return PowerLaw(law.strength, law.slope, noise)
    # The PSF's first error is a sixth of the noise at half a cycle.
    with_error = bins.likeliest(
        replace(law, error=law.noise / 6 * 0.5**slope, error_slope=slope) for slope in (1.0, 2.5)
    )
    evidence = bins.negative_log_likelihood(law) - bins.negative_log_likelihood(with_error)
    harm = bins.harmful_variance(with_error)
    is_evident = evidence > max(_LEAST_EVIDENCE, _LEAST_TOTAL_EVIDENCE / count)
    if not (is_evident and harm / law.noise > _LEAST_HARM**2):
        return PowerLaw(law.strength, law.slope, noise)
    error = max(_MODEL_ERROR_FACTOR**2 * harm - noise, 0.0)
    return PowerLaw(with_error.strength, with_error.slope, noise, error)


@dataclass(frozen=True, eq=False)
class PhotographSpectrum:
    """The power spectrum of a blurred photograph, to which laws are fitted.

    shape: (rows, columns) of the photograph.
    used: indices of the frequencies that are used, in the flattened rfft2 grid.
    power: power of these frequencies, of which white noise has its variance.
    squares: squares of these frequencies, (cycles/pixel)².
    weight: a half for frequencies whose conjugate is on the grid as well, and else 1. Without it, a
        picture that is turned would have another spectrum.
    """

    shape: tuple[int, int]
    used: torch.Tensor
    power: torch.Tensor
    squares: torch.Tensor
    weight: torch.Tensor

    @classmethod
    def of(
        cls, image: torch.Tensor, region: torch.Tensor | None = None
    ) -> PhotographSpectrum | None:
        """Compute the spectrum of a photograph; None for one without structure.

        region: as for fit_power_law().
        """
        shape = int(image.shape[0]), int(image.shape[1])
        rounding = 1e-7 * float(image.abs().max()) if image.numel() else 0.0
        if min(shape) < 2 * _MIN_PERIODS + 2 or float(image.std()) <= rounding:
            return None
        rows = torch.hann_window(shape[0] + 2, False, dtype=image.dtype)[1:-1]
        columns = torch.hann_window(shape[1] + 2, False, dtype=image.dtype)[1:-1]
        window = rows[:, None] * columns
        if region is not None:
            window = window * region.to(window)
        square = window.square()
        detail = (image - (image * square).sum() / square.sum()) * window
        power = (squared_modulus(rfft2(detail)) / square.sum()).flatten()
        squares = squared_frequencies(shape).to(image).flatten()
        used = (squares > (_MIN_PERIODS / min(shape)) ** 2).nonzero()[:, 0]
        weight = (rfft_column_weights(shape[1]).to(image) / 2).repeat(shape[0])
        return cls(shape, used, power[used], squares[used], weight[used])

    @property
    def count(self) -> float:
        """The number of different frequencies that are used."""
        return float(self.weight.sum())

    def seen_mtf(self, squared_mtf: torch.Tensor) -> torch.Tensor:
        """Return the squared MTF of the used frequencies, as the photograph's window smooths it.

        The Hann window's spectrum has three samples along an axis, whose squares are as 1 : 4 : 1.
        Without this step, zeros of the MTF seem to let light through.
        """
        power = squared_mtf.to(self.power)
        along_y = (power.roll(1, 0) + power.roll(-1, 0) + 4 * power) / 6
        # Beyond the ends of the half spectrum, it continues with the rows in reverse.
        mirrored = torch.cat([along_y[:1], along_y[1:].flip(0)])
        last = mirrored[:, -1 if self.shape[1] % 2 else -2]
        wide = torch.cat([mirrored[:, 1:2], along_y, last[:, None]], 1)
        return ((wide[:, :-2] + wide[:, 2:] + 4 * along_y) / 6).flatten()[self.used]

    def bins(self, seen_mtf: torch.Tensor) -> SpectrumBins:
        """Average the spectrum over bins of similar frequencies and MTFs, as they are seen."""
        radius = 0.5 * self.squares.log()
        ring = _bin_index(radius, _RADIUS_BINS)
        kind = _bin_index(seen_mtf.clamp(min=_MIN_SQUARED_MTF).log(), _MTF_BINS)
        pool, most = ring * _MTF_BINS + kind, _RADIUS_BINS * _MTF_BINS
        count = torch.bincount(pool, self.weight, minlength=most)
        full = count > 0
        number = count[full].to(torch.float64)

        def mean(of: torch.Tensor) -> Array:
            sums = torch.bincount(pool, of * self.weight, minlength=most)
            return np.asarray((sums[full].to(torch.float64) / number).numpy())

        share = np.asarray((number / number.sum()).numpy())
        return SpectrumBins(share, mean(self.power), mean(radius), mean(seen_mtf))

    def log_likelihood(self, psf: torch.Tensor) -> float:
        """Return the largest log-likelihood of the spectrum for a PSF with a sum of 1.

        The law is that of fit_power_law(), without an error of the PSF.
        """
        transfer = transfer_function(psf.to(self.power), self.shape)
        seen = self.seen_mtf(squared_modulus(transfer))
        bins = self.bins(seen)
        law = bins.likeliest(bins.first_laws())
        model = law.strength * seen * self.squares.pow(-law.slope / 2) + law.noise
        each = (model.log() + self.power / model) * self.weight
        return -float(each.sum(dtype=torch.float64))


def _bin_index(value: torch.Tensor, count: int) -> torch.Tensor:
    """Return the index of each value's bin, of `count` that divide the values' range evenly."""
    low, high = value.min(), value.max()
    place = (value - low) / (high - low).clamp(min=1e-12) * count
    return place.long().clamp(0, count - 1)


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

    def signal_power(self, law: SpectrumLaw) -> Array:
        """Return the blurred scene's power in each bin, without noise or the PSF's error."""
        return np.asarray(law.strength * self.squared_mtf * np.exp(-law.slope * self.radius))

    def _error_power(self, law: SpectrumLaw) -> Array:
        return np.asarray(law.error * np.exp(-law.error_slope * self.radius))

    def negative_log_likelihood(self, law: SpectrumLaw) -> float:
        """Return Whittle's negative log-likelihood of a law."""
        model = self.signal_power(law) + law.noise + self._error_power(law)
        return float((self.share * (np.log(model) + self.power / model)).sum())

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

    def first_laws(self) -> list[SpectrumLaw]:
        """Return laws without an error of the PSF, of two noise levels, from which a fit starts."""
        lowest = max(float(self.power.min()), 1e-30)
        signal = (self.share * self.signal_power(SpectrumLaw(1.0, 2.4, 0.0))).sum()
        starts = []
        for noise in (lowest * 1.0, lowest * 0.03):
            above = (self.share * (self.power - noise).clip(min=0)).sum()
            starts.append(SpectrumLaw(max(float(above / signal), 1e-30), 2.4, max(noise, 1e-30)))
        return starts

    def likeliest(self, starts: Iterable[SpectrumLaw]) -> SpectrumLaw:
        """Return the likeliest of the laws that are fitted from several first ones."""
        return min(map(self._fit, starts), key=self.negative_log_likelihood)

    def _fit(self, now: SpectrumLaw) -> SpectrumLaw:
        """Fit a law by Fisher scoring, from a first one.

        A step that doesn't raise the likelihood is repeated with more damping. The PSF's error is
        fitted if the first law has one.
        """
        best, damping = self.negative_log_likelihood(now), 1e-3
        for _ in range(_STEPS):
            tried = self._scored_law(now, damping)
            score = self.negative_log_likelihood(tried)
            if score < best:
                settled = best - score < 1e-9
                now, best, damping = tried, score, damping / 5
                if settled:
                    break
            else:
                damping *= 10
        return now

    def _scored_law(self, now: SpectrumLaw, damping: float) -> SpectrumLaw:
        """Return the law after one damped step of Fisher scoring, of the powers' logarithms."""
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
        step = np.linalg.lstsq(normal, wanted, rcond=1e-12)[0].clip(-2, 2).tolist()
        law = SpectrumLaw(
            now.strength * math.exp(step[0]),
            min(max(now.slope + step[1], 0.0), 6.0),
            now.noise * math.exp(step[2]),
        )
        if not now.error:
            return law
        error_slope = min(max(now.error_slope + step[4], 0.0), 4.0)
        return replace(law, error=now.error * math.exp(step[3]), error_slope=error_slope)
