"""Random scenes of disks that occlude each other, each with a typical spectrum (dead leaves)."""

from __future__ import annotations

import torch

from optics.validation import require_count, require_finite

_LEAST_RADIUS = 2.0
"""Radius of the smallest disk in pixels; chosen."""

_LARGEST_SHARE = 1 / 3
"""Radius of the largest disk relative to the scene's side; chosen."""

_DARKEST = 0.2
"""Least brightness of a disk relative to its typical spectrum, for shading; chosen."""

_UNCOVERED = 1e-3
"""Share of the pixels that may be left for the last disk."""


def draw_dead_leaves(spectra: torch.Tensor, side: int, generator: torch.Generator) -> torch.Tensor:
    """Draw a scene of random disks with typical spectra, of which nearer ones cover others.

    As in photographs, edges are sharp and of all sizes: the number of disks falls as the third
    power of their radius, so that the scene looks alike at all scales. Its opposite edges fit.

    Parameters
    ----------
    spectra : torch.Tensor, (samples, bands)
        Typical spectra.
    side : int
        Rows and columns of the scene.
    generator : torch.Generator
        Source of random numbers.

    Returns
    -------
    torch.Tensor, (bands, rows, columns), float64
        The scene, on the scale of the spectra.

    Raises
    ------
    ValueError
        For spectra of another shape, or without a sample, or a side below 1.

    References
    ----------
    Lee, Mumford and Huang 2001, Occlusion models for natural images, doi 10.1023/A:1011109015675.
    """
    require_count("side", side)
    require_finite("spectra", spectra)
    if spectra.ndim != 2 or not spectra.numel():
        raise ValueError(f"spectra is {tuple(spectra.shape)}; give (samples, bands)")

    def random(*shape: int) -> torch.Tensor:
        return torch.rand(shape, generator=generator, dtype=torch.float64)

    samples = spectra.to(torch.float64)
    scene = torch.zeros(samples.shape[1], side, side, dtype=torch.float64)
    bare = torch.ones(side, side, dtype=torch.bool)
    smallest, largest = 1 / _LEAST_RADIUS**2, 1 / max(_LARGEST_SHARE * side, _LEAST_RADIUS) ** 2
    while float(bare.sum()) > _UNCOVERED * bare.numel():
        squared_radius = 1 / (smallest + random() * (largest - smallest))
        down, along = (_squared_distances(side, random()) for _ in range(2))
        seen = bare & (down[:, None] + along < squared_radius)
        scene[:, seen] = _random_colour(samples, random(2))[:, None]
        bare &= ~seen
    scene[:, bare] = _random_colour(samples, random(2))[:, None]
    return scene


def _random_colour(samples: torch.Tensor, chance: torch.Tensor) -> torch.Tensor:
    """Return one of the typical spectra with a random brightness, from two numbers in 0 to 1."""
    chosen = samples[int(chance[0] * len(samples))]
    return chosen * (_DARKEST + (1 - _DARKEST) * chance[1])


def _squared_distances(side: int, place: torch.Tensor) -> torch.Tensor:
    """Return the squared distance of each row of a repeated scene from a place, in pixels²."""
    away = (torch.arange(side, dtype=torch.float64) - place * side).abs()
    return torch.minimum(away, side - away).square()
