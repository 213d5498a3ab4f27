"""Judge a deblurred picture: whether photograph, PSF and noise fit together, and what doesn't."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import scipy.ndimage
import torch

from optics.inverse.noise import PhotographSpectrum
from optics.inverse.observation import LEAST_NOISE, Observation
from optics.inverse.restored_image import RestoredImage, residual_map
from optics.progress import Progress
from optics.threads import single_threaded
from optics.validation import require_positive

# Largest deviation of the scale from 1 that is looked for, the step of the first scales, and the
# number of halvings of that step.
_RANGE, _STEP, _REFINEMENTS = 0.15, 0.025, 3

# Logarithm of the likelihood ratio, alone and added per frequency, and deviation from 1, from
# which a scale is believed to be wrong. Pictures depart from a power law, which looks like
# evidence and grows with their number of frequencies.
_LEAST_EVIDENCE, _EVIDENCE_SHARE, _LEAST_DEVIATION = 20.0, 0.002, 0.01


@dataclass(frozen=True)
class PSFScale:
    """The likeliest scale of a PSF in a photograph.

    scale: the true PSF's size over that of the given one, 0.85 to 1.15.
    evidence: logarithm of the likelihood of this scale over that of 1, not negative.
    frequencies: number of frequencies of the photograph's spectrum.
    """

    scale: float
    evidence: float
    frequencies: float

    @property
    def is_wrong(self) -> bool:
        """Whether the photograph shows that the PSF has another scale."""
        # A likelihood that still grows at the end of the range doesn't show it: what grows is then
        # the picture's departure from a power law.
        least = _LEAST_EVIDENCE + _EVIDENCE_SHARE * self.frequencies
        return self.evidence >= least and _LEAST_DEVIATION <= abs(self.scale - 1) < _RANGE - 1e-9


@single_threaded
@torch.no_grad()
def find_psf_scale(observation: Observation, progress: Progress | None = None) -> PSFScale:
    """Find the scale of the PSF that the photograph's spectrum shows.

    Each trial scale is given the power law and noise that fit best: see fit_power_law().

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
    spectrum = PhotographSpectrum.of(observation.centre)
    if spectrum is None or observation.psf_radius == 0:
        return PSFScale(1.0, 0.0, 0)
    likelihoods = dict[float, float]()

    def look_at(scale: float) -> None:
        if scale not in likelihoods and abs(scale - 1) <= _RANGE + 1e-9:
            psf = scaled_psf(observation.psf, scale)
            likelihoods[scale] = spectrum.log_likelihood(psf / psf.sum())

    count = round(_RANGE / _STEP)
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
    return PSFScale(best, likelihoods[best] - likelihoods[1.0], spectrum.count)


def scaled_psf(psf: torch.Tensor, scale: float) -> torch.Tensor:
    """Enlarge or shrink a PSF about its origin at n // 2, with the same sum.

    The result may be larger than `psf`, (rows, columns). Negative values of the cubic interpolation
    are 0.

    scale: size of the result over that of `psf`, above 0.
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
    """Give an observation's PSF the scale that was found."""
    return replace(observation, psf=scaled_psf(observation.psf, found.scale))


# Residuals, relative to the noise, between which the rest of the photograph looks like noise.
_LEAST_RESIDUAL, _MOST_RESIDUAL = 0.55, 1.25

# Told noise over estimated noise, or the inverse, from which the told noise is doubted.
_NOISE_RATIO = 1.6

# Deviation of the PSF's scale from 1, or evidence per frequency, that is likely to cost more than
# 1 dB.
_GRAVE_SCALE, _GRAVE_EVIDENCE = 0.03, 0.05

# Residual around clipped pixels, over that of all, that is likely to cost more than 1 dB.
_GRAVE_CLIPPING = 1.3

# Number of pixels that share the highest level, and their number over that of the next lower
# level, from which they count as clipped.
_CLIPPED_PIXELS, _CLIPPED_RATIO = 10, 2.0


# Depth of a photograph's light below 0, over the noise, and the share of such pixels from which
# the light is too low. Chosen: white noise has 3e-5 of them where nothing shines.
_NEGATIVE_DEPTH, _NEGATIVE_SHARE = 4.0, 1e-3

# Share of a PSF's light that is negative from which it may make light negative. Chosen: a
# measured PSF has less, by its noise.
_NEGATIVE_PSF = 0.01

# Residual of a picture whose negative light was cut, over that before, from which the cut is what
# doesn't fit. Chosen.
_CUT_COST = 1.1


@dataclass(frozen=True)
class Finding:
    """Something that doesn't fit, with the remedy.

    cause: "psf-scale", "noise", "clipping", "psf", "dark", "negative", "fit", "smoothing" or
        "iterations": what is wrong, in a word.
    words: what the photograph shows.
    remedy: what to do about it.
    is_grave: whether it is likely to cost more than 1 dB.
    """

    cause: str
    words: str
    remedy: str
    is_grave: bool = True


@dataclass(frozen=True)
class Verdict:
    """What was found; `judges_psf` is False where the photograph doesn't show its PSF's errors."""

    findings: tuple[Finding, ...] = ()
    judges_psf: bool = True

    @property
    def is_good(self) -> bool:
        """Whether the PSF was judged, and nothing was found that makes the picture much worse."""
        return self.judges_psf and not any(one.is_grave for one in self.findings)

    def __str__(self) -> str:
        """Say in words what was found."""
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
    found = (
        _scale_finding(scale),
        _clipping_finding(observation, restored),
        _noise_finding(observation, restored),
        _dark_finding(observation, restored),
        _psf_finding(observation),
    )
    causes = [one for one in found if one is not None]
    has_filters = observation.relative_filters is not None
    rest = None if any(one.is_grave for one in causes) else _residual_finding(restored)
    # A mosaic leaves much freedom to its bands, so that they fit some of the noise.
    if rest is not None and not (has_filters and rest.cause == "smoothing"):
        causes.append(rest)
    return Verdict(tuple(causes), judges_psf=not has_filters)


def _scale_finding(scale: PSFScale | None) -> Finding | None:
    """Report a PSF whose scale doesn't fit the photograph."""
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
    """Report many pixels that share the highest level, as clipped ones do."""
    image, trust = observation.image, observation.effective_weights
    known = image.flatten() if trust is None else image[trust > 0]
    top = known.max()
    count, below = int((known == top).sum()), known[known < top]
    if count < _CLIPPED_PIXELS or not below.numel():
        return None
    if count < _CLIPPED_RATIO * int((below == below.max()).sum()):
        return None
    # The residual around such pixels, over that of all.
    left = residual_map(observation, restored).square()
    near = torch.nn.functional.max_pool2d((image == top)[None, None].float(), 5, 1, 2)[0, 0] > 0
    everywhere, there = float(left.nanmean()), float(left[near].nanmean())
    share = math.sqrt(there / everywhere) if everywhere > 0 and there > 0 else 0.0
    return Finding(
        "clipping",
        f"{count} pixels share the highest level, {float(top):.4g}",
        "if they are clipped, give that level, so that they are left out",
        share > _GRAVE_CLIPPING,
    )


def _noise_finding(observation: Observation, restored: RestoredImage) -> Finding | None:
    """Report a told noise that spectrum and residual contradict."""
    told, shown = observation.given_noise, math.sqrt(observation.power_law.noise_variance)
    # The spectrum is that of the middle, and a map's noise differs from place to place.
    if told is None or shown <= 0 or observation.variance is not None:
        return None
    ratio, residual = told / shown, restored.residual
    too_large = ratio > _NOISE_RATIO and residual < _MOST_RESIDUAL
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
    """Report negative light, which no scene explains."""
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
        is_grave=max(restored.residual, least) > _MOST_RESIDUAL,
    )


def _psf_finding(observation: Observation) -> Finding | None:
    """Report what the spectrum shows of the PSF's error."""
    ratio = observation.disturbance / observation.scene_noise
    if ratio <= 1.05:
        return None
    return Finding(
        "psf",
        f"the PSF's error harms {math.sqrt(ratio**2 - 1):.1f} times as much as the noise",
        "measure the PSF again, or with more light; the prior was strengthened meanwhile",
    )


def _residual_finding(restored: RestoredImage) -> Finding | None:
    """Report a residual that is too large or too small without a known cause."""
    if restored.residual > _MOST_RESIDUAL:
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
    if restored.residual < _LEAST_RESIDUAL:
        return Finding(
            "smoothing",
            f"the residual is only {restored.residual:.2f} times the noise",
            "the noise is less than it was taken for, or some became detail; give the noise",
        )
    return None
