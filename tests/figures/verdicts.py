"""Verdicts on restorations of photographs that didn't make their limits."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np
import torch

from figures import Figure
from figures.photographs import collection_words
from figures.restoration_cases import CHECKED, random_cases
from labapp.accuracy.blurs import Array, SimulatedPhotograph
from optics.inverse.choice import restore
from optics.inverse.observation import Observation
from optics.inverse.observation_builder import build_observation
from optics.inverse.verdict import find_psf_scale, judge_restoration, refine_psf_scale, scaled_psf
from optics.threads import single_threaded

_CASES, _SEED = 48, 7
_METHODS = ("total-variation", "wiener", "richardson-lucy")
_SCALES = (0.95, 0.98, 1.02, 1.05)
_CLIPPED = 0.98
"""Quantile of a photograph at which its wells are taken to be full."""

_RIGHT = 1.0
"""Decibels that a right restoration may lose against that of the right model."""


@dataclass(frozen=True)
class _JudgedRestoration:
    """A restoration of a condition: what it lost in dB, its causes, and what refining leaves."""

    condition: str
    lost: float
    causes: tuple[str, ...]
    is_good: bool
    scale: float = 1.0
    refined_lost: float = 0.0

    @property
    def is_right(self) -> bool:
        return self.lost <= _RIGHT


@single_threaded
def verdict_figures(folder: Path) -> list[Figure]:
    """Right PSFs, PSFs of a wrong scale, noise told wrongly, and clipped pixels without a mask."""
    judged = [
        one
        for number, case in enumerate(islice(random_cases(_SEED, CHECKED), _CASES))
        for one in _judge_conditions(case, _METHODS[number % len(_METHODS)])
    ]
    good = [one for one in judged if one.is_good]
    right = [one for one in judged if one.is_right]
    sound = float(np.mean([one.is_right for one in good]))
    found = float(np.mean([one.is_good for one in right]))
    kinds = ", ".join(_by_condition(judged))
    return [
        Figure(
            "verdicts: of those called good, right; of the right, called good",
            "≥ 90 %; ≥ 70 %",
            f"{sound:.0%} of {len(good)}; {found:.0%} of {len(right)}; called good of right by "
            f"condition: {kinds}; {_CASES} cases {collection_words(CHECKED)} by "
            f"{', '.join(_METHODS)}",
            sound >= 0.9 and found >= 0.7,
        ),
        _scale_figure(judged),
    ]


def _by_condition(judged: list[_JudgedRestoration]) -> Iterator[str]:
    for condition in dict.fromkeys(one.condition for one in judged):
        own = [one for one in judged if one.condition == condition]
        right = [one for one in own if one.is_right]
        called = sum(one.is_good for one in right)
        wrong = sum(one.is_good for one in own) - called
        yield f"{condition} {called}/{len(right)} (and {wrong} of {len(own) - len(right)} wrong)"


def _scale_figure(judged: list[_JudgedRestoration]) -> Figure:
    """PSFs that are a twentieth too large or small, where that costs a decibel."""
    costly = [one for one in judged if one.scale in (0.95, 1.05) and one.lost >= 1]
    named = [
        any(cause == f"psf-scale {'+' if one.scale > 1 else '-'}" for cause in one.causes)
        for one in costly
    ]
    right = [one for one in judged if one.scale == 1]
    false = float(np.mean([any("psf-scale" in cause for cause in one.causes) for one in right]))
    left = [one.refined_lost for one in costly]
    share, within = float(np.mean(named)), float(np.mean([one <= 0.5 for one in left]))
    return Figure(
        "PSF scale 5 % wrong where it costs ≥ 1 dB: named with its sign; false alarms; refined",
        "≥ 85 %; ≤ 5 %; within 0.5 dB of the right PSF",
        f"{share:.0%} of {len(costly)}; {false:.1%} of {len(right)}; median {np.median(left):.2f} "
        f"dB, {within:.0%} within 0.5 dB",
        share >= 0.85 and false <= 0.05 and float(np.median(left)) <= 0.5,
    )


def _judge_conditions(case: SimulatedPhotograph, method: str) -> Iterator[_JudgedRestoration]:
    """All conditions of a case by one method; the noise is told in some."""

    def problem(psf: Array, noise: float | None = None, image: Array | None = None) -> Observation:
        frame = (case.observation if image is None else image).astype(np.float32)
        return build_observation(torch.from_numpy(frame), psf, noise, case.border)

    def level(observation: Observation) -> float:
        return case.quality(restore(observation, method=method).image)[0]

    best = level(problem(case.psf))
    yield _one("right", case, problem(case.psf), method, best)
    yield _one("noise told", case, problem(case.psf, case.noise), method, best)
    yield _one("noise x 3", case, problem(case.psf, 3 * case.noise), method, best)
    yield _one("noise / 3", case, problem(case.psf, case.noise / 3), method, best)
    for scale in _SCALES:
        given = scaled_psf(torch.from_numpy(case.psf), 1 / scale).numpy()
        yield _one(f"scale {scale:g}", case, problem(given), method, best, scale)
    full = float(np.quantile(case.observation, _CLIPPED))
    clipped = case.observation.clip(max=full)
    marked = build_observation(
        torch.from_numpy(clipped.astype(np.float32)), case.psf, None, case.border,
        clipped=torch.from_numpy(clipped >= full),
    )  # fmt: skip
    yield _one("clipped", case, problem(case.psf, image=clipped), method, level(marked))


def _one(
    condition: str,
    case: SimulatedPhotograph,
    observation: Observation,
    method: str,
    best: float,
    scale: float = 1.0,
) -> _JudgedRestoration:
    restored, found = restore(observation, method=method), find_psf_scale(observation)
    verdict = judge_restoration(observation, restored, found)
    sign = "+" if found.scale > 1 else "-"
    causes = tuple(
        f"{one.cause} {sign}" if one.cause == "psf-scale" else one.cause for one in verdict.findings
    )
    lost, refined_lost = best - case.quality(restored.image)[0], 0.0
    if scale != 1:
        refined = restore(refine_psf_scale(observation, found), method=method)
        refined_lost = best - case.quality(refined.image)[0]
    return _JudgedRestoration(condition, lost, causes, verdict.is_good, scale, refined_lost)


MEASUREMENTS = {"verdicts": verdict_figures}
