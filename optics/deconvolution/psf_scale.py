"""The scale of a PSF, as the spectrum of the photograph that it has blurred shows it.

A PSF that is a few percent too large or small puts the zeros of its MTF at wrong frequencies. The
photograph's spectrum has its own zeros there, so that the spectrum alone tells the right scale,
without any restoration.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import scipy.ndimage
import torch

from optics.deconvolution.observation import Observation
from optics.progress import Progress
from optics.threads import single_threaded
from optics.validation import require_positive

RANGE, _STEP, _REFINEMENTS = 0.15, 0.025, 3
"""Largest deviation of the scale from 1 that is looked for, the step of the first scales, and the
number of halvings of that step."""

LEAST_EVIDENCE, EVIDENCE_SHARE, LEAST_DEVIATION = 20.0, 0.002, 0.01
"""Logarithm of the likelihood ratio, alone and added per frequency, and deviation from 1, from
which a scale is believed to be wrong. Pictures depart from a power law, which looks like evidence
and grows with their number of frequencies."""


@dataclass(frozen=True)
class PSFScale:
    """The likeliest scale of a PSF in a photograph, for deconvolution.

    Attributes
    ----------
    scale : float
        The true PSF's size over that of the given one, 0.85 to 1.15.
    evidence : float
        Logarithm of the likelihood of this scale over that of 1, not negative.
    frequencies : float
        Number of frequencies of the photograph's spectrum.
    """

    scale: float
    evidence: float
    frequencies: float

    @property
    def is_wrong(self) -> bool:
        """Whether the photograph shows that the PSF to deconvolve with has another scale.

        A likelihood that still grows at the end of the range doesn't show it: what grows is then
        the picture's departure from a power law.
        """
        least = LEAST_EVIDENCE + EVIDENCE_SHARE * self.frequencies
        return self.evidence >= least and LEAST_DEVIATION <= abs(self.scale - 1) < RANGE - 1e-9


@single_threaded
@torch.no_grad()
def find_psf_scale(observation: Observation, progress: Progress | None = None) -> PSFScale:
    """Find the scale of a deconvolution's PSF that the photograph's spectrum shows.

    Each trial scale is given the power law and noise that fit best: see fit_power_law(). The
    likeliest scale is found on a grid, and then between its neighbours.

    Parameters
    ----------
    observation : Observation
        Photograph and PSF.
    progress : Progress, optional
        Receives reports, and can cancel the work.

    Returns
    -------
    PSFScale
        The scale and its evidence; 1 without evidence for a point or an even photograph.
    """
    progress, observation = progress or Progress(), observation.in_own_unit
    spectrum = observation.centre_spectrum
    if spectrum is None or observation.psf_radius == 0:
        return PSFScale(1.0, 0.0, 0)
    likelihoods = dict[float, float]()

    def look_at(scale: float) -> None:
        if scale not in likelihoods and abs(scale - 1) <= RANGE + 1e-9:
            psf = scaled_psf(observation.psf, scale)
            likelihoods[scale] = spectrum.log_likelihood(psf / psf.sum())

    count = round(RANGE / _STEP)
    for number in range(-count, count + 1):
        progress.report((number + count) / (2 * count + 1 + 2 * _REFINEMENTS), "scale of the PSF")
        look_at(1 + number * _STEP)
    step = _STEP
    for _ in range(_REFINEMENTS):
        step /= 2
        best = max(likelihoods, key=likelihoods.__getitem__)
        look_at(best - step)
        look_at(best + step)
    best = max(likelihoods, key=likelihoods.__getitem__)
    evidence = likelihoods[best] - likelihoods[1.0]
    return PSFScale(best, evidence, spectrum.count)


def scaled_psf(psf: torch.Tensor, scale: float) -> torch.Tensor:
    """Enlarge or shrink a PSF about its origin, for a deconvolution that refines its scale.

    The sum stays the same.

    Parameters
    ----------
    psf : torch.Tensor, (rows, columns)
        Point spread function, with its origin at n // 2.
    scale : float
        Size of the result over that of `psf`, above 0.

    Returns
    -------
    torch.Tensor, (rows, columns)
        The scaled PSF, with its origin at n // 2. Negative values of the cubic interpolation are
        0. It may be larger than `psf`.
    """
    require_positive("scale", scale, "")
    if scale == 1:
        return psf
    old = psf.detach().to(torch.float64).numpy()
    sides = [2 * math.ceil(max(scale, 1.0) * (n // 2)) + 1 for n in old.shape]
    axes = [
        (np.arange(side) - side // 2) / scale + n // 2
        for side, n in zip(sides, old.shape, strict=True)
    ]
    at = np.meshgrid(*axes, indexing="ij")
    values = scipy.ndimage.map_coordinates(old, at, order=3, mode="grid-constant").clip(min=0)
    return torch.from_numpy(values * (old.sum() / values.sum())).to(psf)


def refine_psf_scale(observation: Observation, found: PSFScale) -> Observation:
    """Return an observation to deconvolve whose PSF has the scale that was found."""
    return replace(observation, psf=scaled_psf(observation.psf, found.scale))
