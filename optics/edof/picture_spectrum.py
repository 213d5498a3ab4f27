"""The mean power spectrum of natural pictures, measured and modelled on a grid of frequencies."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import torch

from optics.fourier.fft import rfft_column_weights
from optics.validation import accepts_numpy, require_finite


@dataclass(frozen=True)
class FrequencyGrid:
    """The frequencies of a periodic picture of size x size pixels.

    The half of the frequencies in the layout of ``torch.fft.rfft2`` suffices for every real
    picture. A quarter of them, none of them negative, suffices where everything is symmetric in
    both axes.

    Parameters
    ----------
    size : int
        Pixels along each side of the picture, even, 4 or more.
    quarter : bool, optional
        Whether the grid is the quarter without negative frequencies, (size // 2 + 1) in both axes.
        By default it is the half, (size, size // 2 + 1).

    Raises
    ------
    ValueError
        If the size is odd or less than 4.
    """

    size: int
    quarter: bool = False

    def __post_init__(self) -> None:
        if self.size < 4 or self.size % 2:
            raise ValueError(f"size is {self.size} pixels; choose an even number, 4 or more")

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of the grid."""
        columns = self.size // 2 + 1
        return (columns if self.quarter else self.size), columns

    def frequencies(self) -> tuple[torch.Tensor, torch.Tensor]:
        """Return the frequencies (y, x) as a column and a row.

        They are in cycles per pixel, float64, and broadcast to the grid's shape.
        """
        columns = torch.fft.rfftfreq(self.size, dtype=torch.float64)
        rows = columns if self.quarter else torch.fft.fftfreq(self.size, dtype=torch.float64)
        return rows[:, None], columns[None, :]

    def shares(self) -> torch.Tensor:
        """Return the share of all frequencies that each one on the grid stands for, float64.

        A frequency also stands for those of the other sign that the grid leaves out. The shares
        sum to 1, so that the sum of shares times a power spectrum is a mean over all frequencies,
        which is a variance per pixel.
        """
        columns = rfft_column_weights(self.size).double()
        rows = columns if self.quarter else torch.ones(self.size, dtype=torch.float64)
        return rows[:, None] * columns[None, :] / self.size**2

    def select_quarter(self, values: torch.Tensor) -> torch.Tensor:
        """Return the quarter of values (..., size, size // 2 + 1) by frequency.

        The values at positive and negative frequencies along y are averaged.
        """
        count = self.size // 2 + 1
        mirrored = (-torch.arange(count)) % self.size
        return (values[..., :count, :] + values[..., mirrored, :]) / 2


# Multiples m of the direction angle in the terms cos(m angle) of a model of a spectrum. Pictures
# have more power along the axes than between them, within narrow angles. Measured: with 0 to 4
# alone, a criterion at low noise is .1 dB off.
_HARMONICS = (0, 2, 4, 6, 8)

# Highest power of log |f| in a model of a spectrum. Measured on the photographs of
# `NATURAL_SPECTRUM`, for noise of .008 to .035: with 4, the bound differs from that with the
# measured spectrum by .03 to .06 dB, with 3 by up to .1 dB.
_DEGREE = 4

# Frequency in cycles per pixel below which a model is constant: one cycle over 512 pixels, the
# longest side of the photographs of `NATURAL_SPECTRUM`.
_LOWEST_FREQUENCY = 1 / 512

_FIT_STEPS = 30  # steps of iterated least squares of a model's fit; they converge in about ten


@dataclass(frozen=True)
class SpectrumModel:
    """The power spectrum of pictures as a polynomial in log frequency and direction.

    ln S = sum over m of cos(m angle) sum over k of c[m][k] x^k, where x = ln(|f| / 0.5) with f in
    cycles per pixel, and the angle is that of f from the x axis. S is zero at zero frequency, as
    the pictures' mean isn't counted, and constant in |f| below one cycle over 512 pixels.

    coefficients: c[m][k] for the multiples 0, 2, 4 ... of the angle: up to five rows of one length.
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
        """Compute the power spectrum on a grid of frequencies, (rows, columns), float64.

        The pictures may have any number of pixels, but must show the scene at the same scale: one
        pixel must cover the same part of a typical object as in the pictures of the model.
        """
        fy, fx = grid.frequencies()
        terms = _model_terms(fy, fx, len(self.coefficients), len(self.coefficients[0]))
        flat = torch.tensor(self.coefficients, dtype=torch.float64).flatten()
        spectrum = torch.exp(torch.einsum("t...,t->...", terms, flat))
        return torch.where(torch.hypot(fy, fx) > 0, spectrum, 0.0)


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
def measure_picture_spectrum(pictures: Iterable[torch.Tensor], size: int) -> torch.Tensor:
    """Measure the mean power spectrum of pictures, without their means, on a periodic grid.

    The spectrum of a picture is ``|DFT|²`` over its number of pixels. A smaller picture is padded
    with zeros, after its mean is subtracted, so that its spectrum is interpolated. A larger one is
    cut into tiles. No window is applied: the step between opposite borders counts, as it does where
    a cropped picture is taken to be periodic. Measured on the photographs of `NATURAL_SPECTRUM`:
    the bound of `optics.edof.depth_bound` is .06 dB higher than with Hann windows of 160 pixels.

    Parameters
    ----------
    pictures : torch.Tensor, (pictures, rows, columns), or iterable of (rows, columns)
        Brightness in linear light, where white is 1. They are taken one by one.
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
    """Fit a model of few numbers to a measured power spectrum.

    The measured values scatter around the model as a gamma distribution, whose likelihood is
    maximised, as the mean of logarithms would be biased. A frequency's weight falls with the
    frequency, as there are many more of the high ones. Raises ValueError if the spectrum isn't
    positive beyond zero frequency.

    spectrum: of `measure_picture_spectrum`, (size, size // 2 + 1).
    source: the pictures that the spectrum is of.
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
    """Return the terms of the model at frequencies, (harmonics x powers, ...)."""
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
