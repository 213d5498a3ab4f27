"""The restoration that serves best in the time given."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import torch

from optics.accuracy import MachineSpeed, Setting, best_within, named
from optics.deconvolution.blurred import Blurred
from optics.deconvolution.bounded import bounded
from optics.deconvolution.hyper_laplacian import hyper_laplacian
from optics.deconvolution.plug_and_play import Denoise, plug_and_play
from optics.deconvolution.restored import Restored
from optics.deconvolution.richardson_lucy import richardson_lucy
from optics.deconvolution.total_variation import total_variation
from optics.deconvolution.wiener import wiener
from optics.edge import require_positive
from optics.fourier.fft import fft_operations
from optics.progress import Progress

USUAL = "total-variation"
"""What restores where nothing else is asked for."""

_MASKED_STEPS = 10
"""Of the linear filter where pixels within the frame are missing; an unknown border alone is
continued smoothly, which costs a tenth of a decibel and no iteration."""

_WEIGHTS = 4.4e4
"""Multiplications and additions of the denoiser, a pixel."""


@dataclass(frozen=True)
class Work:
    """What a restoration does with the photograph, in the order of its time.

    transforms: two-dimensional FFTs of the whole period; passes: over all of its numbers.
    multiply_adds: a pixel of it. middle: passes over the photograph's middle, for its spectrum.
    """

    transforms: float
    passes: float
    multiply_adds: float = 0.0
    middle: float = 0.0

    def seconds(self, seen: Blurred, speed: MachineSpeed) -> float:
        """Of one thread."""
        pixels = math.prod(seen.whole)
        number = 0.5 * fft_operations(pixels) * self.transforms * speed.fft
        number += pixels * (self.passes * speed.touch + self.multiply_adds * speed.multiply_add)
        if seen.image.dtype == torch.float64:
            number *= speed.double
        return 10 * speed.call + number + self.middle * min(pixels, 1 << 18) * speed.touch

    def plus(self, other: Work, times: float = 1.0) -> Work:
        return Work(
            self.transforms + times * other.transforms,
            self.passes + times * other.passes,
            self.multiply_adds + times * other.multiply_adds,
            self.middle + times * other.middle,
        )


@dataclass(frozen=True)
class Wanted:
    """How to restore. count: of iterations or rounds. weight: by itself if None."""

    count: int
    weight: float | None
    denoise: Denoise | None
    progress: Progress


@dataclass(frozen=True)
class Method:
    """A way to restore a photograph.

    what: in a few words. gains: by its count of iterations or rounds, decibels that it gains over
    the blurred photograph. usual: the count where nothing else is asked for. before, each: work
    once, and in each iteration.
    """

    what: str
    solve: Callable[[Blurred, Wanted], Restored]
    gains: Mapping[int, float]
    usual: int
    before: Work
    each: Callable[[Blurred], Work]
    learned: bool = False

    def seconds(self, seen: Blurred, count: int, speed: MachineSpeed) -> float:
        """Predicted processor time."""
        return self.before.plus(self.each(seen), count).seconds(seen, speed)


def _wiener(seen: Blurred, wanted: Wanted) -> Restored:
    return wiener(seen, wanted.weight, steps=0 if seen.trust is None else _MASKED_STEPS)


def _richardson_lucy(seen: Blurred, wanted: Wanted) -> Restored:
    weight = wanted.weight or 0.0
    return richardson_lucy(seen, wanted.count, total_variation=weight, progress=wanted.progress)


def _total_variation(seen: Blurred, wanted: Wanted) -> Restored:
    return total_variation(seen, wanted.weight, iterations=wanted.count, progress=wanted.progress)


def _hyper_laplacian(seen: Blurred, wanted: Wanted) -> Restored:
    return hyper_laplacian(
        seen, weight=wanted.weight, rounds=wanted.count, progress=wanted.progress
    )


def _bounded(seen: Blurred, wanted: Wanted) -> Restored:
    return bounded(seen, wanted.weight, iterations=wanted.count, progress=wanted.progress)


def _plug_and_play(seen: Blurred, wanted: Wanted) -> Restored:
    if wanted.denoise is None:
        raise ValueError("method is plug-and-play, and no denoiser is given; give one")
    chosen = {} if wanted.weight is None else {"strength": wanted.weight}
    return plug_and_play(
        seen, wanted.denoise, rounds=wanted.count, progress=wanted.progress, **chosen
    )


_PREPARED = Work(5, 60, middle=250)
"""The photograph's spectrum, noise and transfer function."""


def _linear(seen: Blurred) -> Work:
    return Work(0, 0) if seen.trust is None else Work(2 * _MASKED_STEPS, 24 * _MASKED_STEPS)


def _splitting(seen: Blurred) -> Work:
    return Work(2, 40) if seen.complete else Work(4, 55)


def _multiplicative(_: Blurred) -> Work:
    return Work(4, 60)


def _rounds(seen: Blurred) -> Work:
    return Work(2, 60) if seen.complete else Work(14, 200)


def _evaluation(_: Blurred) -> Work:
    """Of an objective and its gradient, in double precision."""
    return Work(8, 300)


def _round(seen: Blurred) -> Work:
    """A denoised picture, and where part of the period was seen, conjugate gradients."""
    network = Work(2, 100, 1.4 * _WEIGHTS)
    return network if seen.complete else network.plus(Work(12, 150))


# Gains are medians of 12 photographs, each through one of 6 blurs, with noise of .005 to .02:
# `make figures ONLY=budget` measures them.
METHODS: dict[str, Method] = {
    "wiener": Method(
        "linear filter, gradients' power known (Eq. 2.28)",
        _wiener, {1: 1.7}, 1, _PREPARED, _linear,
    ),
    "richardson-lucy": Method(
        "likeliest under photon noise (Eq. 2.30), accelerated; stops at the noise",
        _richardson_lucy, {10: 2.3, 20: 2.5, 30: 2.5}, 30, _PREPARED, _multiplicative,
    ),
    "total-variation": Method(
        "few edges, sharp ones (Eq. 2.27)",
        _total_variation, {6: 4.0, 8: 4.1, 12: 4.4, 20: 4.7}, 12, _PREPARED, _splitting,
    ),
    "hyper-laplacian": Method(
        "gradients with the heavy tails of natural pictures",
        _hyper_laplacian, {5: 3.0, 10: 4.3}, 10, _PREPARED, _rounds,
    ),
    "l-bfgs-b": Method(
        "few edges, light never negative, by a general minimiser (Eq. 2.32)",
        _bounded, {50: 4.4, 100: 4.4}, 100, _PREPARED, _evaluation,
    ),
    "plug-and-play": Method(
        "a learned denoiser for a prior",
        _plug_and_play, {8: 4.6, 12: 5.0}, 12, _PREPARED.plus(Work(60, 800)), _round,
        learned=True,
    ),
}  # fmt: skip


def restore(
    seen: Blurred,
    budget: float | None = None,
    method: str | None = None,
    progress: Progress | None = None,
    *,
    weight: float | None = None,
    count: int | None = None,
    denoise: Denoise | None = None,
    speed: MachineSpeed | None = None,
) -> Restored:
    """The photograph with its blur undone, by the best method that a time allows.

    budget: seconds of processor time, by the machine's speed; None for the usual method. method:
    one of METHODS, at the most iterations that the budget has time for. weight: of the method's
    prior; count: of its iterations or rounds: both by themselves if None. denoise: for
    plug-and-play, which is left out without it.
    Raises ValueError for a budget in which nothing fits, another name, or a count below 1; and for
    what the method itself refuses.
    """
    speed, progress = speed or MachineSpeed(), progress or Progress()
    _require(budget, method, weight, count)
    name, number = _chosen(seen, budget, method, count, denoise, speed)
    progress.report(0, METHODS[name].what)
    restored = METHODS[name].solve(seen, Wanted(number, weight, denoise, progress))
    progress.report(1, restored.method)
    return restored


def _require(
    budget: float | None, method: str | None, weight: float | None, count: int | None
) -> None:
    if budget is not None:
        require_positive("budget", budget, "s")
    named(METHODS, method)
    if method is None and not weight is count is None:
        raise ValueError("weight and count are a method's; name the method as well")
    if budget is not None and count is not None:
        raise ValueError("budget and count are both given; give one of them")
    if count is not None and count < 1:
        raise ValueError(f"count is {count}; at least 1 is needed")


def _chosen(
    seen: Blurred,
    budget: float | None,
    method: str | None,
    count: int | None,
    denoise: Denoise | None,
    speed: MachineSpeed,
) -> tuple[str, int]:
    """Name and count of the one that gains most in the time."""
    if budget is None:
        name = method or USUAL
        return name, METHODS[name].usual if count is None else count
    best = best_within(
        budget,
        [
            Setting(name, number, METHODS[name].seconds(seen, number, speed), gain)
            for name in named(METHODS, method)
            if method or denoise is not None or not METHODS[name].learned
            for number, gain in METHODS[name].gains.items()
        ],
    )
    return best.method, best.count
