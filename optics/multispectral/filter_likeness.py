"""Spectral bands that a sensor's filters see alike, so that only the PSFs can separate them."""

from __future__ import annotations

from collections.abc import Sequence

import torch

from optics.inverse.mosaics import MosaicObservation

_ALIKE = 0.95
"""Least cosine between what the filters transmit of two spectral bands that count as alike: a third
of a band's light, or less, then differs through the filters in more than brightness. Chosen."""

_SAME_PSFS = 0.99
"""Least cosine between the PSFs of two spectral bands that count as the same; chosen."""


def find_alike_bands(filters: torch.Tensor) -> list[tuple[int, ...]]:
    """Find the groups of spectral bands that the filters see alike, but for a factor.

    Parameters
    ----------
    filters : torch.Tensor, (bands, rows, columns)
        One period of the mosaic's pattern: the share of each band that each pixel transmits.

    Returns
    -------
    list of tuple of int
        Indices of two bands or more in each group, ascending. A band is in a group if it is like
        another of them, and in one group at most.
    """
    alike = cosines(filters) >= _ALIKE
    groups: list[set[int]] = []
    for band, row in enumerate(alike):
        joined = {band, *(int(other) for other in row.nonzero())}
        apart = [group for group in groups if not group & joined]
        for group in groups:
            joined |= group if group & joined else set()
        groups = [*apart, joined]
    return sorted(tuple(sorted(group)) for group in groups if len(group) > 1)


def cosines(pictures: torch.Tensor) -> torch.Tensor:
    """Compute how alike the filters, or the PSFs, of each two spectral bands are.

    `pictures` are those of each band, (bands, rows, columns). The result is (bands, bands),
    float64: the cosines of the angles between them, 1 for bands that differ by a factor only.
    """
    flat = pictures.flatten(1).to(torch.float64)
    directions = flat / flat.norm(dim=1, keepdim=True)
    return directions @ directions.mT


def filter_period(observation: MosaicObservation) -> torch.Tensor:
    """Return one period of a mosaic's spectral filters, (bands, rows, columns), float64."""
    rows, columns = observation.filter_period
    return observation.filters[:, :rows, :columns].to(torch.float64)


def describe_alike_bands(
    groups: Sequence[Sequence[int]], psfs: torch.Tensor, labels: Sequence[str]
) -> str:
    """Describe in words which spectral bands only the PSFs separate, or nothing at all.

    Parameters
    ----------
    groups : sequence of sequence of int
        Indices of the bands of each group that the filters see alike.
    psfs : torch.Tensor, (bands, rows, columns)
        PSF of each band.
    labels : sequence of str
        Name of each band.

    Returns
    -------
    str
        One sentence for each group; empty without any.
    """
    return " ".join(
        f"The filters see {_enumerate([labels[band] for band in group])} alike: "
        + _describe_separation(psfs[list(group)])
        for group in groups
    )


def _describe_separation(psfs: torch.Tensor) -> str:
    """Describe whether PSFs separate spectral bands that the filters see alike."""
    apart = cosines(psfs) - torch.eye(len(psfs), dtype=torch.float64)
    if float(apart.max()) >= _SAME_PSFS:
        return (
            "only the PSFs could separate these bands, and those of some don't differ either; how "
            "the light is divided among them is a guess from typical spectra."
        )
    return (
        "only the PSFs separate these bands, so that light may be restored in the wrong one of "
        "them."
    )


def _enumerate(words: Sequence[str]) -> str:
    """Join names of spectral bands to a list in plain English."""
    return " and ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)
