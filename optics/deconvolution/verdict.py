"""The verdict on a restoration: whether photograph, PSF and noise fit together, and what doesn't.

A good restoration is within 1 dB of the one that the right PSF, noise and mask would give by the
same method. The limits were set on photographs of one collection and checked on others; `make
figures ONLY=verdicts` measures them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch

from optics.deconvolution.observation import LEAST_NOISE, Observation
from optics.deconvolution.psf_scale import PSFScale
from optics.deconvolution.residual_map import residual_map
from optics.deconvolution.restored_image import RestoredImage

LEAST_RESIDUAL, MOST_RESIDUAL = 0.55, 1.25
"""Residuals, relative to the noise, between which the rest of the photograph looks like noise."""

_NOISE_RATIO = 1.6
"""Told noise over estimated noise, or the inverse, from which the told noise is doubted."""

_GRAVE_SCALE, _GRAVE_EVIDENCE = 0.03, 0.05
"""Deviation of the PSF's scale from 1, or evidence per frequency, that is likely to cost more than
1 dB."""

_GRAVE_CLIPPING = 1.3
"""Residual around clipped pixels, over that of all, that is likely to cost more than 1 dB."""

_CLIPPED_PIXELS, _CLIPPED_RATIO = 10, 2.0
"""Number of pixels that share the highest level, and their number over that of the next lower
level, from which they count as clipped."""


_NEGATIVE_DEPTH, _NEGATIVE_SHARE = 4.0, 1e-3
"""Depth of a photograph's light below 0, over the noise, and the share of such pixels from which
the light is too low. Chosen: white noise has 3e-5 of them where nothing shines."""

_NEGATIVE_PSF = 0.01
"""Share of a PSF's light that is negative from which it may make light negative. Chosen: a measured
PSF has less, by its noise."""

_CUT_COST = 1.1
"""Residual of a picture whose negative light was cut, over that before, from which the cut is what
doesn't fit. Chosen."""


@dataclass(frozen=True)
class Finding:
    """Something that doesn't fit in a restoration, with the remedy.

    Attributes
    ----------
    cause : str
        "psf-scale", "noise", "clipping", "psf", "dark", "negative", "fit", "smoothing" or
        "iterations":
        What is wrong, in a word.
    words : str
        What the photograph shows.
    remedy : str
        What to do about it.
    is_grave : bool
        Whether it is likely to cost more than 1 dB.
    """

    cause: str
    words: str
    remedy: str
    is_grave: bool = True


@dataclass(frozen=True)
class Verdict:
    """The verdict on a restoration; it is good if nothing grave was found.

    `judges_psf` is False where the photograph doesn't show whether its PSF is right.
    """

    findings: tuple[Finding, ...] = ()
    judges_psf: bool = True

    @property
    def is_good(self) -> bool:
        """Whether nothing was found that makes the restoration much worse than it could be."""
        return self.judges_psf and not any(one.is_grave for one in self.findings)

    def __str__(self) -> str:
        """Return the verdict on a restoration in words, with what was found."""
        found = [f"{one.words}: {one.remedy}" for one in self.findings]
        if self.is_good:
            found = ["good: what is left looks like noise", *found]
        elif not any(one.is_grave for one in self.findings):
            found = ["no fault found, but through colour filters a wrong PSF doesn't show", *found]
        return "; ".join(found)


@torch.no_grad()
def judge_restoration(
    observation: Observation, restored: RestoredImage, scale: PSFScale | None = None
) -> Verdict:
    """Judge a restored photograph by its residual, its spectrum and its brightest pixels.

    A common shift of the PSF isn't seen: it only moves the restored picture. Nor is an error of the
    PSF seen through a mosaic of filters.

    Parameters
    ----------
    observation : Observation
        What was restored.
    restored : RestoredImage
        The restoration.
    scale : PSFScale, optional
        The PSF's scale from find_psf_scale(); not judged if None.

    Returns
    -------
    Verdict
        What was found, the causes that explain most first.
    """
    causes = [
        one
        for one in (
            _scale_finding(scale),
            _clipping_finding(observation, restored),
            _noise_finding(observation, restored),
            _dark_finding(observation, restored),
            _psf_finding(observation),
        )
        if one is not None
    ]
    if (
        not any(one.is_grave for one in causes)
        and (rest := _residual_finding(restored)) is not None
        # A mosaic leaves much freedom to its bands, so that they fit some of the noise.
        and not (observation.needs_filters and rest.cause == "smoothing")
    ):
        causes.append(rest)
    return Verdict(tuple(causes), judges_psf=not observation.needs_filters)


def _scale_finding(scale: PSFScale | None) -> Finding | None:
    """Return what a restoration's photograph shows of the PSF's scale."""
    if scale is None or not scale.is_wrong:
        return None
    size = "too small" if scale.scale > 1 else "too large"
    far = abs(scale.scale - 1) >= _GRAVE_SCALE
    return Finding(
        "psf-scale",
        f"the PSF is {abs(1 - 1 / scale.scale):.1%} {size} for this photograph",
        "let its scale be refined, or measure or compute it again",
        far or scale.evidence >= _GRAVE_EVIDENCE * scale.frequencies,
    )


def _clipping_finding(observation: Observation, restored: RestoredImage) -> Finding | None:
    """Return what the brightest pixels of a photograph to be restored show of clipping."""
    image, trust = observation.image, observation.effective_weights
    known = image.flatten() if trust is None else image[trust > 0]
    top = known.max()
    count, below = int((known == top).sum()), known[known < top]
    if count < _CLIPPED_PIXELS or not below.numel():
        return None
    if count < _CLIPPED_RATIO * int((below == below.max()).sum()):
        return None
    return Finding(
        "clipping",
        f"{count} pixels share the highest level, {float(top):.4g}",
        "if they are clipped, give that level, so that they are left out",
        _residual_around(image == top, observation, restored) > _GRAVE_CLIPPING,
    )


def _residual_around(
    pixels: torch.Tensor, observation: Observation, restored: RestoredImage
) -> float:
    """Return the rms residual of a restoration near some pixels, over that of all pixels."""
    left = residual_map(observation, restored).square()
    near = torch.nn.functional.max_pool2d(pixels[None, None].float(), 5, 1, 2)[0, 0] > 0
    everywhere, there = float(left.nanmean()), float(left[near].nanmean())
    return math.sqrt(there / everywhere) if everywhere > 0 and there > 0 else 0.0


def _noise_finding(observation: Observation, restored: RestoredImage) -> Finding | None:
    """Return what a photograph's spectrum and a restoration's residual show of the told noise."""
    told, shown = observation.given_noise, math.sqrt(observation.power_law.noise_variance)
    # The spectrum is that of the middle, and a map's noise differs from place to place.
    if told is None or shown <= 0 or observation.variance is not None:
        return None
    ratio, residual = told / shown, restored.residual
    too_large = ratio > _NOISE_RATIO and residual < MOST_RESIDUAL
    too_small = ratio < 1 / _NOISE_RATIO and residual > 1
    if not (too_large or too_small):
        return None
    return Finding(
        "noise",
        f"the noise was told as {told:.3g}, and the photograph shows {shown:.3g}",
        "leave it out, or give its standard deviation in the photograph's unit",
        # Without a weight, less noise only means more iterations.
        is_grave=too_large or restored.weight is not None,
    )


def _dark_finding(observation: Observation, restored: RestoredImage) -> Finding | None:
    """Return what a photograph's negative light shows; no scene to restore explains it."""
    seen, psf = observation.in_own_unit, observation.psf.detach()
    if float(psf.clamp(max=0).sum()) < -_NEGATIVE_PSF * float(psf.sum()):
        return None
    noise = torch.as_tensor(max(seen.noise, math.sqrt(seen.power_law.noise_variance)))
    if seen.variance is not None:
        noise = torch.maximum(noise, seen.variance.sqrt())
    missing = (seen.image.detach() / noise.clamp(min=LEAST_NOISE)).clamp(max=0)
    if seen.effective_weights is not None:
        missing = missing[seen.effective_weights > 0]
    share = float((missing < -_NEGATIVE_DEPTH).to(torch.float64).mean())
    if share < _NEGATIVE_SHARE:
        return None
    least = float(missing.square().mean().sqrt())
    return Finding(
        "dark",
        f"{share:.1%} of the pixels are negative by more than {_NEGATIVE_DEPTH:g} times the noise",
        "the dark level that was subtracted is too high; subtract less",
        is_grave=max(restored.residual, least) > MOST_RESIDUAL,
    )


def _psf_finding(observation: Observation) -> Finding | None:
    """Return what the spectrum of a photograph to be restored shows of the PSF's error."""
    ratio = observation.disturbance / observation.scene_noise
    if ratio <= 1.05:
        return None
    return Finding(
        "psf",
        f"the PSF's error harms {math.sqrt(ratio**2 - 1):.1f} times as much as the noise",
        "measure the PSF again, or with more light; the prior was strengthened meanwhile",
    )


def _residual_finding(restored: RestoredImage) -> Finding | None:
    """Return what a restoration's residual shows where no cause is known."""
    if restored.residual > MOST_RESIDUAL:
        uncut = restored.uncut_residual
        if uncut is not None and restored.residual > _CUT_COST * uncut:
            return Finding(
                "negative",
                f"the residual is {restored.residual:.2f} times the noise, and was {uncut:.2f} "
                "before negative light was cut",
                "take a method that keeps light from being negative, such as l-bfgs-b",
            )
        if not restored.converged:
            return Finding(
                "iterations",
                f"the residual is {restored.residual:.2f} times the noise, and still falling",
                "allow more iterations or time, or take another method",
                is_grave=False,
            )
        return Finding(
            "fit",
            f"the residual is {restored.residual:.2f} times the noise",
            "PSF, noise or model doesn't fit; measure the PSF again",
        )
    if restored.residual < LEAST_RESIDUAL:
        return Finding(
            "smoothing",
            f"the residual is only {restored.residual:.2f} times the noise",
            "the noise is less than it was taken for, or some became detail; give the noise",
        )
    return None
