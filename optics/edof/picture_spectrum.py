"""Measure and model the mean power spectrum of natural pictures.

The power spectrum S(f) of pictures with N pixels is the mean of |DFT|² / N over the pictures, each
without its mean. Its mean over all frequencies is the pictures' mean variance. S is a density: the
same scene with more pixels of the same angular size has the same S at the same frequency in cycles
per pixel.

`measure_picture_spectrum` measures S, and `fit_spectrum_model` describes it by few numbers.
`NATURAL_SPECTRUM` is such a description, of 200 photographs.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import torch

from optics.edof.frequency_grid import FrequencyGrid
from optics.validation import accepts_numpy, require_count, require_finite

_HARMONICS = (0, 2, 4, 6, 8)
"""Multiples m of the direction angle in the terms cos(m angle) of a model of a spectrum. Pictures
have more power along the axes than between them, within narrow angles. Measured: with 0 to 4 alone,
a criterion at low noise is .1 dB off."""

_DEGREE = 4
"""Highest power of log |f| in a model of a spectrum. Measured on the photographs of
`NATURAL_SPECTRUM`, for noise of .008 to .035: with 4, the bound differs from that with the measured
spectrum by .03 to .06 dB, with 3 by up to .1 dB."""

_LOWEST_FREQUENCY = 1 / 512
"""Frequency in cycles per pixel below which a model is constant: one cycle over 512 pixels, the
longest side of the photographs of `NATURAL_SPECTRUM`."""

_FIT_STEPS = 30
"""Steps of iterated least squares of a model's fit; they converge in about ten."""


@dataclass(frozen=True)
class SpectrumModel:
    """Describe the power spectrum of pictures by a polynomial in log frequency and direction.

    ln S = sum over m of cos(m angle) sum over k of c[m][k] x^k, where x = ln(|f| / 0.5) with f in
    cycles per pixel, and the angle is that of f from the x axis. S is zero at zero frequency, as
    the pictures' mean isn't counted, and constant in |f| below one cycle over 512 pixels.

    Parameters
    ----------
    coefficients : tuple of tuple of float
        c[m][k] for the multiples 0, 2, 4 ... of the angle.
    source : str, optional
        The pictures that the spectrum is of.

    Raises
    ------
    ValueError
        If there are no coefficients, more than five rows of them, or rows of different lengths.
    """

    coefficients: tuple[tuple[float, ...], ...]
    source: str = ""

    def __post_init__(self) -> None:
        lengths = {len(row) for row in self.coefficients}
        if not 1 <= len(self.coefficients) <= len(_HARMONICS) or len(lengths) != 1 or 0 in lengths:
            raise ValueError(
                f"coefficients has rows of {[len(row) for row in self.coefficients]} numbers; give "
                f"1 to {len(_HARMONICS)} rows of the same length"
            )

    def on_grid(self, grid: FrequencyGrid) -> torch.Tensor:
        """Compute the modelled power spectrum of pictures on a frequency grid.

        The pictures may have any number of pixels, but must show the scene at the same scale: one
        pixel must cover the same part of a typical object as in the pictures of the model.

        Returns
        -------
        torch.Tensor, (rows, columns), float64
        """
        return self.at(*grid.frequencies())

    def at(self, fy: torch.Tensor, fx: torch.Tensor) -> torch.Tensor:
        """Compute the modelled power spectrum of pictures at frequencies in cycles per pixel.

        Parameters
        ----------
        fy, fx : torch.Tensor
            Cycles per pixel along y and x; they broadcast.

        Returns
        -------
        torch.Tensor, float64
        """
        rows = len(self.coefficients), len(self.coefficients[0])
        terms = _model_terms(fy.double(), fx.double(), *rows)
        flat = torch.tensor(self.coefficients, dtype=torch.float64).flatten()
        spectrum = torch.exp(torch.einsum("t...,t->...", terms, flat))
        return torch.where(torch.hypot(fy, fx) > 0, spectrum, 0.0)

    def binned_on_grid(self, grid: FrequencyGrid, binning: int) -> torch.Tensor:
        """Compute the power spectrum of modelled pictures whose pixels are averaged in squares.

        Binning averages binning x binning pixels into one, so that the same scene has fewer,
        larger pixels. It multiplies by the transfer function of a square and folds all frequencies
        that are whole cycles per new pixel apart onto one another.

        Parameters
        ----------
        grid : FrequencyGrid
            The frequencies of the binned pictures.
        binning : int
            Old pixels along each side of a new pixel, 1 or more.

        Returns
        -------
        torch.Tensor, (rows, columns), float64
            The spectrum; zero at zero frequency.
        """
        require_count("binning", binning)
        fy, fx = grid.frequencies()
        total = torch.zeros(grid.shape, dtype=torch.float64)
        for my in range(binning):
            for mx in range(binning):
                oy, ox = (_fold_frequency((f + m) / binning) for f, m in ((fy, my), (fx, mx)))
                box = averaging_transfer(oy, binning) * averaging_transfer(ox, binning)
                total += box**2 * self.at(oy, ox) / binning**2
        total[0, 0] = 0.0
        return total


NATURAL_SPECTRUM = SpectrumModel(
    coefficients=(
        (-6.9240, -3.8122, -1.3165, -0.4072, -0.0405),
        (-0.1418, -0.0295, -0.0391, -0.0158, -0.0020),
        (0.4538, 0.2625, 0.2533, 0.0751, 0.0067),
        (-0.0154, -0.0101, 0.0003, 0.0034, 0.0004),
        (0.1435, -0.0345, 0.0314, 0.0243, 0.0037),
    ),
    source="BSDS500, 200 training photographs: Rec. 709 luminance, linear light, 481 x 321",
)
"""Power spectrum of natural photographs, fitted by `fit_spectrum_model`.

It was measured by `measure_picture_spectrum` with a size of 512 on the training photographs of
P. Arbelaez et al., IEEE Trans. Pattern Anal. Mach. Intell. 33, 898, 2011,
doi 10.1109/TPAMI.2010.161: JPEG files of 481 x 321 or 321 x 481 pixels, converted from sRGB to
linear light.
"""


@accepts_numpy
def measure_picture_spectrum(pictures: torch.Tensor, size: int) -> torch.Tensor:
    """Measure the mean power spectrum of pictures, without their means, on a periodic grid.

    The spectrum of a picture is ``|DFT|²`` over its number of pixels. A smaller picture is padded
    with zeros, after its mean is subtracted, so that its spectrum is interpolated. A larger one is
    cut into tiles. No window is applied: the step between opposite borders counts, as it does where
    a cropped picture is taken to be periodic. Measured on the photographs of `NATURAL_SPECTRUM`:
    the bound of `optics.edof.depth_bound` is .06 dB higher than with Hann windows of 160 pixels.

    Parameters
    ----------
    pictures : torch.Tensor, (pictures, rows, columns), or a sequence of (rows, columns)
        Brightness in linear light, where white is 1.
    size : int
        Pixels along each side of the grid.

    Returns
    -------
    torch.Tensor, (size, size // 2 + 1), float64
        The spectrum, in the layout of ``FrequencyGrid(size)``; zero at zero frequency.

    Raises
    ------
    ValueError
        If there is no picture, or one isn't finite or not (rows, columns).
    """
    return mean_spectrum(pictures, size)


def mean_spectrum(pictures: Iterable[torch.Tensor], size: int) -> torch.Tensor:
    """Measure the mean power spectrum of pictures that come one by one, for large collections.

    Parameters and result are those of `measure_picture_spectrum`.
    """
    grid = FrequencyGrid(size)
    total, count = torch.zeros(grid.shape, dtype=torch.float64), 0
    for picture in pictures:
        if picture.ndim != 2:
            raise ValueError(f"a picture is {tuple(picture.shape)}; give (rows, columns) each")
        require_finite("pictures", picture)
        centred = picture.double() - picture.double().mean()
        total += _tiled_periodogram(centred, size)
        count += 1
    if not count:
        raise ValueError("pictures is empty; give at least one")
    total[0, 0] = 0.0
    return total / count


def fit_spectrum_model(spectrum: torch.Tensor, source: str = "") -> SpectrumModel:
    """Fit a model of few numbers to a measured power spectrum of pictures.

    The measured values scatter around the model as a gamma distribution, whose likelihood is
    maximised, as the mean of logarithms would be biased. A frequency's weight falls with the
    frequency, as there are many more of the high ones.

    Parameters
    ----------
    spectrum : torch.Tensor, (size, size // 2 + 1)
        From `measure_picture_spectrum`.
    source : str, optional
        The pictures that the spectrum is of.

    Returns
    -------
    SpectrumModel
        The model.

    Raises
    ------
    ValueError
        If the spectrum isn't positive beyond zero frequency.
    """
    grid = FrequencyGrid(len(spectrum))
    fy, fx = (f.expand(grid.shape) for f in grid.frequencies())
    radius = torch.hypot(fy, fx).flatten()
    used = radius > 0
    measured = spectrum.double().flatten()[used]
    if not bool((measured > 0).all()) or not bool(torch.isfinite(measured).all()):
        raise ValueError("spectrum has values that aren't positive; measure it on more pictures")
    terms = _model_terms(fy, fx, len(_HARMONICS), _DEGREE + 1).flatten(1)[:, used].T
    weight = (grid.shares().flatten()[used] / radius[used]).sqrt()
    found = torch.linalg.lstsq(terms * weight[:, None], measured.log() * weight).solution
    for _ in range(_FIT_STEPS):
        predicted = terms @ found
        # One step of Fisher scoring for a gamma distribution with a logarithmic link.
        target = predicted + measured * torch.exp(-predicted) - 1
        found = torch.linalg.lstsq(terms * weight[:, None], target * weight).solution
    rows = found.reshape(len(_HARMONICS), _DEGREE + 1).tolist()
    return SpectrumModel(tuple(tuple(row) for row in rows), source)


def _model_terms(fy: torch.Tensor, fx: torch.Tensor, harmonics: int, powers: int) -> torch.Tensor:
    """Return the terms of a spectrum's model at frequencies, (harmonics x powers, ...)."""
    radius = torch.hypot(fy, fx).clamp(min=_LOWEST_FREQUENCY)
    x, angle = torch.log(radius / 0.5), torch.atan2(fy, fx)
    return torch.stack(
        [torch.cos(m * angle) * x**k for m in _HARMONICS[:harmonics] for k in range(powers)]
    )


def _tiled_periodogram(centred: torch.Tensor, size: int) -> torch.Tensor:
    """Return |DFT|² per pixel of a picture without its mean, cut into tiles and padded."""
    rows, columns = centred.shape
    total = torch.zeros(FrequencyGrid(size).shape, dtype=torch.float64)
    for tile_row in torch.split(centred, math.ceil(rows / math.ceil(rows / size))):
        for tile in torch.split(tile_row, math.ceil(columns / math.ceil(columns / size)), 1):
            transform = torch.fft.rfft2(tile, s=(size, size))
            total += transform.real**2 + transform.imag**2
    return total / (rows * columns)


def _fold_frequency(frequency: torch.Tensor) -> torch.Tensor:
    """Return a picture's frequencies folded into -1/2 to 1/2 cycles per pixel."""
    return frequency - torch.round(frequency)


def averaging_transfer(frequency: torch.Tensor, binning: int) -> torch.Tensor:
    """Return the transfer function of a mean over a row of a picture's pixels."""
    below = torch.sinc(frequency)
    return torch.sinc(binning * frequency) / below
