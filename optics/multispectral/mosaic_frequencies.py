"""How blur and a mosaic of colour filters map a scene's frequencies to those of the raw picture.

A mosaic repeats, so that it mixes only frequencies that lie whole steps apart: as many as its
pattern has pixels. The model is small matrices, one for each group of such frequencies.
"""

from __future__ import annotations

from collections.abc import Sequence

import torch


def forward_matrices(psfs: torch.Tensor, filters: torch.Tensor, period: int) -> torch.Tensor:
    """Compute the matrices from a scene's spectral bands to the raw picture, on frequencies.

    Parameters
    ----------
    psfs : torch.Tensor, (bands, rows, columns)
        PSF of each band, or one for all, with its origin at n // 2; wrapped around the period.
    filters : torch.Tensor, (bands, rows, columns)
        One period of the mosaic's pattern: the share of each band that each pixel transmits.
    period : int
        Rows and columns of the repeated scene, a multiple of the pattern's.

    Returns
    -------
    torch.Tensor, (groups, measured frequencies, scene's frequencies, bands), complex
        The matrices of each group of frequencies that the mosaic mixes.
    """
    transfer = group_frequencies(_transfer(psfs, period), filters.shape[1:])
    return _mixing(filters)[None] * transfer[:, None]


def group_frequencies(values: torch.Tensor, pattern: Sequence[int]) -> torch.Tensor:
    """Group the frequencies that a mosaic of spectral filters mixes, which are whole steps apart.

    `values` is (bands, period, period). The result is (groups, frequencies, bands), where the
    frequency (i, j) is i times period / rows and j times period / columns above the group's first.
    """
    down, along = pattern
    bands, rows, columns = values.shape
    split = values.reshape(bands, down, rows // down, along, columns // along)
    return split.permute(2, 4, 1, 3, 0).reshape(-1, down * along, bands)


def squared_frequencies(period: int) -> torch.Tensor:
    """Return the squared frequency in (cycles/pixel)² on a square period, for spectral models."""
    squares = torch.fft.fftfreq(period, dtype=torch.float64).square()
    return squares[:, None] + squares


def _transfer(psfs: torch.Tensor, period: int) -> torch.Tensor:
    """Compute the PSFs' transfer functions on a square period, at all frequencies of the FFT."""
    rows = torch.arange(psfs.shape[-2]) - psfs.shape[-2] // 2
    columns = torch.arange(psfs.shape[-1]) - psfs.shape[-1] // 2
    wrapped = psfs.new_zeros(len(psfs), period, period)
    place = (
        (rows % period)[:, None].expand(psfs.shape[1:]),
        (columns % period).expand(psfs.shape[1:]),
    )
    for band, psf in zip(wrapped, psfs, strict=True):
        band.index_put_(place, psf, accumulate=True)
    return torch.fft.fft2(wrapped)


def _mixing(filters: torch.Tensor) -> torch.Tensor:
    """Compute how a mosaic of spectral filters mixes the frequencies of one group.

    `filters` is one period of the pattern, (bands, rows, columns). The result is (measured
    frequencies, the scene's frequencies, bands).
    """
    down, along = filters.shape[1:]
    series = torch.fft.fft2(filters) / (down * along)
    row, column = (one.flatten() for one in torch.meshgrid(
        torch.arange(down), torch.arange(along), indexing="ij"
    ))  # fmt: skip
    rows = (row[:, None] - row) % down
    columns = (column[:, None] - column) % along
    return series[:, rows, columns].permute(1, 2, 0)
