"""Speckle of partly coherent light that a rough surface scatters, in the image of a camera.

The light on a place of the image comes from many places of the surface in random phase. Its
variance over its mean squared, the contrast squared, is 1/M with M degrees of freedom. Those of
spectrum, polarisation, exposure and pixel multiply (Goodman 2020, Speckle Phenomena in Optics,
chapters 4 to 6).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import erf

Array = NDArray[np.float64]

_MOST_AVERAGED = 8  # independent patterns; more are hardly told from a normal one; chosen
_BINS = 4096  # of a spectrum, evenly lit; chosen: more than its curves have points


@dataclass(frozen=True)
class RoughSurface:
    """Describe a surface that scatters light in random phase.

    Parameters
    ----------
    roughness : float
        Root mean square of its height in metres; of what scatters within its depth, too.
    depolarises : bool, optional
        Whether it scatters both polarisations independently, as paint and paper do, and metal
        doesn't.
    patterns : float, optional
        Independent patterns of equal light that every exposure averages, of a lamp's modes, or of a
        diffuser that turns in its light; 1 or more.
    """

    roughness: float
    depolarises: bool = True
    patterns: float = 1.0

    def __post_init__(self) -> None:
        if not 0 < self.roughness <= 1:
            raise ValueError(
                f"roughness is {self.roughness:g} m; give metres, more than 0, as 2e-6 for 2 µm"
            )
        if not 1 <= self.patterns < math.inf:
            raise ValueError(f"patterns is {self.patterns:g}; it is 1 or more, and finite")

    def surface_variance(self, unmodulated: float) -> float:
        """Return 1/M of polarisations, of which a share is unmodulated, and of patterns."""
        mixed = unmodulated**2 + (1 - unmodulated) ** 2 if self.depolarises else 1.0
        return mixed / self.patterns


def spectral_variance(wavelengths: Array, weights: Array, roughness: float) -> float:
    """Return 1/M of a spectrum on a rough surface seen at right angles.

    Fields of two wavelengths are correlated by exp(-(Δq σ)²/2) with q = 4π/λ, for heights that are
    normally distributed with rms σ. A smooth surface reflects exp(-(q σ)²) of its light evenly,
    which doesn't speckle; the lens is taken to see it, and all that is scattered. A Gaussian line
    of rms width w has 1/M = 1/√(1 + (8π σ w/λ²)²).
    Goodman 2020, sections 3.6.2 and 6.1.
    """
    total = float(weights.sum())
    if not total > 0:
        return 0.0
    turn = 4 * math.pi * roughness
    smooth = float((weights * np.exp(-((turn / wavelengths) ** 2))).sum() / total) ** 2
    if len(wavelengths) == 1:
        return 1 - smooth
    shares, step = _even_bins(1 / wavelengths, weights / total)
    pairs = np.fft.irfft(np.abs(np.fft.rfft(shares, 2 * len(shares))) ** 2)[: len(shares)]
    common = _mean_over_bins(np.arange(len(shares), dtype=np.float64), turn * step)
    return max(float(2 * (pairs * common).sum() - pairs[0] * common[0]) - smooth, 0.0)


def _even_bins(places: Array, shares: Array) -> tuple[Array, float]:
    """Return the shares in even bins over the places that they belong to, and a bin's width."""
    order = np.argsort(places)
    places, shares = places[order], shares[order]
    between = (places[1:] + places[:-1]) / 2
    edges = np.concatenate([[places[0]], between, [places[-1]]])
    found = np.linspace(edges[0], edges[-1], _BINS + 1)
    below = np.interp(found, edges, np.concatenate([[0.0], np.cumsum(shares)]))
    return np.diff(below), float(found[1] - found[0])


def _mean_over_bins(apart: Array, width: float) -> Array:
    """Return the mean of exp(-(a - b)²) over bins of a width that lie so many bins apart."""
    if width < 0.01:  # Differences of the exact integral would lose their digits.
        return np.asarray(np.exp(-((width * apart) ** 2)))

    def twice_integrated(x: Array) -> Array:
        return np.asarray(x * math.sqrt(math.pi) / 2 * erf(x) + np.exp(-(x**2)) / 2)

    ends = [twice_integrated(width * (apart + one)) for one in (-1, 0, 1)]
    return np.asarray((ends[0] - 2 * ends[1] + ends[2]) / width**2)


@dataclass(frozen=True, eq=False)
class SpeckleGrain:
    """How speckle is correlated over the image: by the light in the pupil, whatever its phase is.

    The field's correlation is the Fourier transform of the pupil's light (Van Cittert and Zernike),
    as wide as the sharpest PSF: about wavelength times f-number.
    """

    light: Array  # the pupil's, on cells, (rows, columns), the axis at n // 2
    cell: float  # side of a cell, metres
    lever: float  # wavelength times image distance, m²

    def pixel_variance(self, pitch: float, path: tuple[float, float] = (0.0, 0.0)) -> float:
        """Return 1/M of a square pixel that integrates speckle, which moves (y, x) metres.

        By frequency it is the mean of the pixel's MTF squared over the autocorrelation of the
        pupil's light.
        """
        rows, columns = (2 * n for n in self.light.shape)
        spectrum = np.fft.rfft2(self.light, s=(rows, columns))
        pairs = np.fft.irfft2(np.abs(spectrum) ** 2, s=(rows, columns))
        if not pairs.sum() > 0:
            return 0.0
        fy, fx = (np.fft.fftfreq(n, 1 / n) * self.cell / self.lever for n in (rows, columns))
        seen = _cell_mean(fy, pitch)[:, None] * _cell_mean(fx, pitch)
        if any(path):
            seen = seen * np.sinc(fy[:, None] * path[0] + fx * path[1]) ** 2
        return float((pairs * seen).sum() / pairs.sum())

    def samples_per_pixel(self, pitch: float) -> int:
        """Return the samples along a pixel that resolve the grain of the light."""
        lit = np.nonzero(self.light)
        widest = max((float(np.ptp(one)) + 1 for one in lit if one.size), default=1.0)
        return max(1, math.ceil(2 * pitch * widest * self.cell / self.lever))

    def draw(self, generator: np.random.Generator, shape: tuple[int, int], pitch: float) -> Array:
        """Draw fully developed speckle of one polarisation and wavelength on pixels, of mean 1."""
        finer = self.samples_per_pixel(pitch)
        rows, columns = (n * finer for n in shape)
        step = pitch / finer
        places = [np.fft.fftfreq(n, step) * self.lever / self.cell for n in (rows, columns)]
        index = [
            np.round(at).astype(np.int64) + n // 2
            for at, n in zip(places, self.light.shape, strict=True)
        ]
        inside = [(one >= 0) & (one < n) for one, n in zip(index, self.light.shape, strict=True)]
        light = np.zeros((rows, columns))
        chosen = (one[k] for one, k in zip(index, inside, strict=True))
        light[np.ix_(*inside)] = self.light[np.ix_(*chosen)]
        noise = generator.standard_normal((2, rows, columns))
        field = np.fft.ifft2(np.sqrt(light / 2) * (noise[0] + 1j * noise[1]))
        found = np.abs(field) ** 2 * ((rows * columns) ** 2 / light.sum())
        # The samples resolve the light, so that its Fourier series is integrated over each pixel.
        fy, fx = np.fft.fftfreq(rows, step), np.fft.rfftfreq(columns, step)
        seen = np.sinc(pitch * fy)[:, None] * np.sinc(pitch * fx)
        on_pixels = np.fft.irfft2(np.fft.rfft2(found) * seen, s=(rows, columns))
        return np.asarray(on_pixels[::finer, ::finer].clip(min=0))


def _cell_mean(frequency: Array, pitch: float) -> Array:
    """Return a pixel's MTF squared along an axis, as a mean over each frequency's cell."""
    step = float(frequency[1] - frequency[0]) if len(frequency) > 1 else 0.0
    inner = (np.arange(5) + 0.5) / 5 - 0.5
    return np.asarray((np.sinc(pitch * (frequency[:, None] + step * inner)) ** 2).mean(1))


def draw_speckle(
    generator: np.random.Generator,
    shape: tuple[int, int],
    pitch: float,
    grain: SpeckleGrain,
    variance: float,
    still_variance: float,
    most_samples: int,
) -> Array:
    """Draw a factor on the light of each pixel: of mean 1 and of a variance, 0 or more everywhere.

    variance: 1/M of everything. still_variance: that of the pixel alone. Pixels that hold too many
    grains for `most_samples` along an axis hardly share any, and are drawn one by one, with a gamma
    distribution (Goodman 2020, section 4.7).
    """
    if variance <= 0:
        return np.ones(shape)
    if grain.samples_per_pixel(pitch) > most_samples:
        return np.asarray(generator.gamma(1 / variance, variance, shape))
    rest = variance / still_variance
    count = max(1, min(_MOST_AVERAGED, math.floor(1 / rest + 1e-9)))
    drawn = sum(grain.draw(generator, shape, pitch) for _ in range(count)) / count
    return np.asarray(1 + (drawn - 1) * math.sqrt(min(rest * count, 1.0)))
