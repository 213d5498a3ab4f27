"""Describe the frequencies of a periodic square picture, whole or a quarter of them."""

from __future__ import annotations

from dataclasses import dataclass

import torch

from optics.fourier.fft import rfft_column_weights


@dataclass(frozen=True)
class FrequencyGrid:
    """Describe the frequencies of a periodic picture of size x size pixels.

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
        """The (rows, columns) of the frequency grid."""
        columns = self.size // 2 + 1
        return (columns if self.quarter else self.size), columns

    def frequencies(self) -> tuple[torch.Tensor, torch.Tensor]:
        """Return the frequencies (y, x) of a picture's grid as a column and a row.

        They are in cycles per pixel, float64, and broadcast to the grid's shape.
        """
        columns = torch.fft.rfftfreq(self.size, dtype=torch.float64)
        rows = columns if self.quarter else torch.fft.fftfreq(self.size, dtype=torch.float64)
        return rows[:, None], columns[None, :]

    def shares(self) -> torch.Tensor:
        """Return the share of all of a picture's frequencies that each one on the grid stands for.

        A frequency also stands for those of the other sign that the grid leaves out. The shares
        sum to 1, so that the sum of shares times a power spectrum is a mean over all frequencies,
        which is a variance per pixel.

        Returns
        -------
        torch.Tensor, (rows, columns), float64
        """
        columns = rfft_column_weights(self.size).double()
        rows = columns if self.quarter else torch.ones(self.size, dtype=torch.float64)
        return rows[:, None] * columns[None, :] / self.size**2

    def select_quarter(self, values: torch.Tensor) -> torch.Tensor:
        """Return the quarter of a picture's values (..., size, size // 2 + 1) by frequency.

        The values at positive and negative frequencies along y are averaged.
        """
        count = self.size // 2 + 1
        mirrored = (-torch.arange(count)) % self.size
        return (values[..., :count, :] + values[..., mirrored, :]) / 2
