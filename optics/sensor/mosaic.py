"""Define the mosaic of colour filters on a sensor's pixels."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import torch

if TYPE_CHECKING:
    from optics.light.spectrum import Spectrum


@dataclass(frozen=True, eq=False)
class Mosaic:
    """A pattern of colour filters that repeats over the sensor, from its first pixel on.

    Parameters
    ----------
    pattern : tuple of str
        Rows of one letter per pixel, as ``("RG", "GB")`` for Bayer's pattern.
    efficiencies : mapping of str to Spectrum
        For each letter, electrons per photon at each wavelength, filter and pixel together.

    Raises
    ------
    ValueError
        If rows differ in length, or a letter has no curve.
    """

    pattern: tuple[str, ...]
    efficiencies: Mapping[str, Spectrum] = field(repr=False)

    def __post_init__(self) -> None:
        pattern = tuple(self.pattern)
        if not pattern or not pattern[0] or len({len(row) for row in pattern}) > 1:
            raise ValueError(
                f"pattern is {pattern}; give rows of one letter a pixel, all as long, as in "
                "('RG', 'GB')"
            )
        missing = {letter for row in pattern for letter in row} - set(self.efficiencies)
        if missing:
            raise ValueError(
                f"pattern has {', '.join(sorted(missing))}, which efficiencies don't say; give a "
                "curve for each letter"
            )
        object.__setattr__(self, "pattern", pattern)
        object.__setattr__(self, "efficiencies", dict(self.efficiencies))

    def _content(self) -> tuple[object, ...]:
        return (self.pattern, *((name, self.efficiencies[name]) for name in self.channels))

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Mosaic):
            return NotImplemented
        return self._content() == other._content()

    def __hash__(self) -> int:
        return hash(self._content())

    @property
    def channels(self) -> tuple[str, ...]:
        """The letters of the sensor's colour filters, each once, in their order of appearance."""
        return tuple(dict.fromkeys("".join(self.pattern)))

    def channel_map(self, shape: tuple[int, int]) -> torch.Tensor:
        """Return each sensor pixel's colour filter as an index into `channels`, (rows, columns).

        The indices are int64.
        """
        index = {name: i for i, name in enumerate(self.channels)}
        cell = torch.tensor([[index[letter] for letter in row] for row in self.pattern])
        rows = torch.arange(shape[0])[:, None] % cell.shape[0]
        columns = torch.arange(shape[1])[None, :] % cell.shape[1]
        return cell[rows, columns]

    def sample_channels(self, channels: torch.Tensor) -> torch.Tensor:
        """Sample pictures of all channels as a sensor with these colour filters does.

        channels: (channel, rows, columns). Returns (rows, columns). Raises ValueError if there
        isn't one picture for each of `channels`.
        """
        if channels.ndim != 3 or len(channels) != len(self.channels):
            raise ValueError(
                f"channels is {tuple(channels.shape)}; it must be {len(self.channels)} pictures, "
                f"of {', '.join(self.channels)}"
            )
        which = self.channel_map((channels.shape[1], channels.shape[2]))
        return channels.gather(0, which[None])[0]
