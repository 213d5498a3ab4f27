"""Random problems of free space: whether tolerances are kept, how often one is refused, and
what the choice of a method costs."""

from __future__ import annotations

import math
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from judges.fields import (
    Cells,
    Complex,
    Gaussians,
    Points,
    Pulse,
    Real,
    drawn,
)

from figures import Figure
from figures.regret import median_and_high, regret
from figures.stopwatch import processor_seconds
from labapp.common.speed import machine_speed
from optics.accuracy import Budget, ToleranceError
from optics.plane import Plane
from optics.propagation.free_space_operator import METHODS, FreeSpace
from optics.threads import single_threaded

_PROBLEMS = 120
_SEED = 20240711
_SAMPLES = 64
_FEWEST = 8
JUDGED_COST = 3e7
"""Exponentials that the judge may take for one problem."""

_MOST_SECONDS = 8.0
"""Predicted processor time of answers that aren't waited for."""

_PATIENCE = 60.0
"""Processor seconds after which an answer isn't waited for any longer."""

_NOISE = 1e-8
"""A tolerance times the root of the share of light, below which a refusal is believed: it's ten
thousand times the arithmetic of a sum in float64, which the engine's margins come on top of."""

_TIMED, _SHORT, _LONG = 60, 0.003, 0.2
"""Problems that are timed, and the seconds of those that are worth it."""

_DARK = math.sqrt(math.log(1e10))
"""Widths of a Gaussian beyond which it is as good as gone, in space and in frequency."""

_RESOLVED = 62
"""Samples that hold a Gaussian which fills half of their band."""

_STEEP = 0.9
"""Sine of the angle that no Gaussian's light exceeds."""


@dataclass(frozen=True)
class Problem:
    """A field whose way is known, and where it is wanted."""

    source: Plane
    light: Gaussians | Cells
    target: Plane
    distance: float
    wavelength: float
    paraxial: bool
    tol: float
    carrier: tuple[float, float] = (0.0, 0.0)
    band: tuple[float, float] | None = None
    tilt: tuple[float, float] = (0.0, 0.0)

    def operator(self, tol: float | None = None, **settings: Any) -> FreeSpace:
        return FreeSpace(
            self.source,
            self.target,
            self.distance,
            self.wavelength,
            cells=self.light.sides if isinstance(self.light, Cells) else None,
            carrier=self.carrier,
            band=self.band,
            tilt=self.tilt,
            paraxial=self.paraxial,
            tol=self.tol if tol is None else tol,
            **settings,
        )

    @property
    def field(self) -> torch.Tensor:
        return torch.from_numpy(self.light.samples(self.source))

    def points(self, y: Real, x: Real) -> Points:
        """Where points of the target's own plane, (y, x) from its centre, lie (see Span.tilt)."""
        a, b = self.tilt
        return Points(
            self.target.centre[0] + y * math.cos(a),
            self.target.centre[1] + x * math.cos(b) + y * math.sin(a) * math.sin(b),
            y * math.sin(a) * math.cos(b) - x * math.sin(b),
            self.distance,
            self.wavelength,
        )


def problems(seed: int = _SEED, most: int = 600) -> Iterator[Problem]:
    """Without end: planes of 1 to `most` samples a side, 1 to 20 µm apart, 400 to 1000 nm, 0.1 mm
    to 2 m there or back, smooth fields and cells, both models, windows of any pitch and place,
    some tilted, tolerances of 1e-1 to 1e-6."""
    rng = np.random.default_rng(seed)
    while True:
        smooth = rng.random() < 0.6
        source = _plane(rng, most, min(_RESOLVED, most) if smooth else 1)
        if rng.random() < 0.15:
            source = replace(source, centre=tuple(rng.uniform(-1e-3, 1e-3, 2).tolist()))
        wavelength = float(rng.uniform(400e-9, 1000e-9))
        distance = _log(rng, 1e-4, 2.0) * (-1 if rng.random() < 0.25 else 1)
        start = Problem(
            source,
            Cells(source, source.pitch, np.ones(source.shape, dtype=np.complex128)),
            source,
            distance,
            wavelength,
            paraxial=bool(rng.random() < 0.5),
            tol=_log(rng, 1e-6, 1e-1),
        )
        lit = (_smooth(rng, start) if smooth else None) or _cells(rng, start)
        yield _watched(rng, lit, most)


def _log(rng: np.random.Generator, low: float, high: float) -> float:
    return float(math.exp(rng.uniform(math.log(low), math.log(high))))


def _plane(rng: np.random.Generator, most: int, fewest: int = 1) -> Plane:
    shape = (int(_log(rng, fewest, most + 1)), int(_log(rng, fewest, most + 1)))
    pitch = _log(rng, 1e-6, 20e-6)
    other = pitch if rng.random() < 0.7 else _log(rng, 1e-6, 20e-6)
    return Plane(shape, (pitch, other))


def _cells(rng: np.random.Generator, problem: Problem) -> Problem:
    """Rectangles with random phase, with a lens' phase or with none."""
    plane = problem.source
    y, x = plane.mesh()
    nyquist = [0.5 / p / max(n // 2, 1) / p for n, p in zip(plane.shape, plane.pitch, strict=True)]
    lens = rng.uniform(-1, 1) * np.pi * (nyquist[0] * y**2 + nyquist[1] * x**2).numpy()
    kinds = (rng.uniform(0, 2 * np.pi, plane.shape), lens, np.zeros(plane.shape))
    phase = kinds[rng.integers(len(kinds))]
    fill = 1.0 if rng.random() < 0.5 else float(math.sqrt(rng.uniform(0.6, 1.0)))
    sides = (fill * plane.pitch[0], fill * plane.pitch[1])
    return replace(problem, light=Cells(plane, sides, np.exp(1j * phase)))


def _smooth(rng: np.random.Generator, problem: Problem) -> Problem | None:
    """Up to four Gaussians with tilts and lenses; None if the samples hold none."""
    plane = problem.source
    stated = bool(rng.random() < 0.7)
    share = float(rng.uniform(0.5, 0.95)) if stated else 0.5
    band = (share * 0.5 / plane.pitch[0], share * 0.5 / plane.pitch[1])
    carrier = (0.0, 0.0)
    if rng.random() < 0.3:
        carrier = (float(rng.uniform(-1, 1) * band[0]), float(rng.uniform(-1, 1) * band[1]))
    steepest = math.hypot(*(abs(c) + b for c, b in zip(carrier, band, strict=True)))
    if problem.wavelength * steepest > _STEEP:
        return None
    terms = []
    for _ in range(rng.integers(1, 5)):
        y, x = (_pulse(rng, plane, axis, carrier[axis], band[axis]) for axis in (0, 1))
        if y is None or x is None:
            return None
        terms.append((complex(rng.uniform(0.3, 1.0) * np.exp(2j * np.pi * rng.uniform())), y, x))
    light = Gaussians(tuple(terms))
    return replace(problem, light=light, carrier=carrier, band=band if stated else None)


def _pulse(
    rng: np.random.Generator, plane: Plane, axis: int, carrier: float, band: float
) -> Pulse | None:
    """One that is gone at the plane's edges and at the ends of the band; None if none is."""
    where = plane.coordinates(axis).numpy()
    half, middle = (where[-1] - where[0]) / 2, (where[-1] + where[0]) / 2
    least, most = _DARK / (math.pi * band), half / _DARK
    if not least <= most:
        return None
    width = _log(rng, least, most)
    # What the band leaves is shared by a tilt and a lens.
    spare = rng.uniform(0, 1) * (band - _DARK / (math.pi * width))
    wide = band - spare
    lens = math.sqrt(max((math.pi * wide / (_DARK * width)) ** 2 - width**-4, 0.0))
    alpha = width**-2 + 1j * lens * rng.choice([-1, 0, 1])
    return Pulse(
        middle + float(rng.uniform(-1, 1)) * (half - _DARK * width),
        carrier + float(rng.uniform(-1, 1)) * spare,
        complex(alpha),
    )


def _watched(rng: np.random.Generator, problem: Problem, most: int) -> Problem:
    """A target: the source's own samples, or a window on some of the light; some of these lie
    off it, and get hardly any. Sometimes tilted."""
    source, like = problem.source, rng.random()
    target = _plane(rng, most)
    if like < 0.3:
        target = replace(source, shape=source.shape if like < 0.2 else target.shape)
    if like > 0.1:
        off = 1.0 if rng.random() < 0.93 else float(rng.uniform(1, 4))
        centre = []
        for axis, (middle, spread) in enumerate(_lit(rng, problem)):
            reach = spread + 0.5 * target.shape[axis] * target.pitch[axis]
            centre.append(middle + float(rng.uniform(-1, 1)) * off * reach)
        target = replace(target, centre=(centre[0], centre[1]))
    return replace(problem, target=target, tilt=_tilt(rng, target, problem.distance))


def _lit(rng: np.random.Generator, problem: Problem) -> list[tuple[float, float]]:
    """Where some of the light arrives, along y and x: its middle, and how far it spreads."""
    scale, light = problem.wavelength * problem.distance, problem.light
    if isinstance(light, Cells):
        centre = problem.source.centre
        return [(centre[axis], 0.5 * abs(scale) / light.sides[axis]) for axis in (0, 1)]
    _, *pulses = light.terms[rng.integers(len(light.terms))]
    found = []
    for pulse in pulses:
        focused = pulse.width * (1 - abs(scale) * abs(pulse.alpha.imag) / np.pi)
        spread = math.hypot(max(focused, 0.0), abs(scale) * pulse.fringes)
        found.append((pulse.middle + scale * pulse.frequency, spread))
    return found


def _tilt(rng: np.random.Generator, target: Plane, distance: float) -> tuple[float, float]:
    if rng.random() > 0.12:
        return (0.0, 0.0)
    a, b = rng.uniform(-0.6, 0.6, 2)
    half = math.hypot(*(n * p / 2 for n, p in zip(target.shape, target.pitch, strict=True)))
    steep = half / (0.5 * abs(distance))
    return float(a / max(steep, 1.0)), float(b / max(steep, 1.0))


class Judge:
    """The exact field on some of a problem's samples, and an error from it.

    field: a first answer, by whose light half of the samples are drawn. where, weight: the
    samples, and one over the chance of each.
    """

    def __init__(self, problem: Problem, field: Complex, most_cost: float = JUDGED_COST) -> None:
        self._problem = problem
        light = np.abs(field.ravel()) ** 2
        count = _SAMPLES
        while True:
            rng = np.random.default_rng(0)
            self.where, self.weight = drawn(rng, light, count)
            self._points = self._placed()
            if self.cost <= most_cost or count <= _FEWEST:
                break
            count //= 2

    def _placed(self) -> Points:
        target = self._problem.target
        rows, columns = np.divmod(self.where, target.shape[1])
        own = Plane(target.shape, target.pitch)
        y, x = own.coordinates(0).numpy()[rows], own.coordinates(1).numpy()[columns]
        return self._problem.points(y, x)

    @property
    def cost(self) -> float:
        """Exponentials of the exact answer."""
        return self._problem.light.cost(self._points, paraxial=self._problem.paraxial)

    def truth(self) -> Complex:
        return self._problem.light.field(self._points, paraxial=self._problem.paraxial)

    def error(self, field: Complex) -> float:
        """Relative L2 error of a field on the target; infinite where there is no light."""
        truth = self.truth()
        wrong = float((self.weight * np.abs(field.ravel()[self.where] - truth) ** 2).sum())
        size = float((self.weight * np.abs(truth) ** 2).sum())
        return math.sqrt(wrong / size) if size > 0 else math.inf

    def root_share(self) -> float:
        """Root of the share of the source's light that is on the target, by the exact field."""
        problem = self._problem
        field = np.abs(problem.light.samples(problem.source)) ** 2
        sides = problem.light.sides if isinstance(problem.light, Cells) else problem.source.pitch
        mean = (self.weight * np.abs(self.truth()) ** 2).sum() / self.weight.sum()
        (rows, columns), (py, px) = problem.target.shape, problem.target.pitch
        arrived = mean * rows * columns * py * px
        return float(np.sqrt(arrived / (field.sum() * sides[0] * sides[1])))


@dataclass(frozen=True)
class Outcome:
    """What became of a problem: "kept", "wrong", "unjudged", "refused" or "unreal", which is a
    refusal of what can be had. share: of the tolerance that the error takes, if judged."""

    kind: str
    words: str
    share: float = math.nan


def outcome(problem: Problem, budget: Budget, most_cost: float = JUDGED_COST) -> Outcome:
    """Ask the engine, and judge its answer or its refusal."""
    try:
        operator = problem.operator(budget=budget)
        if operator.account.cpu_predicted > _MOST_SECONDS:
            return Outcome("unjudged", f"{operator.account.cpu_predicted:.0f} s")
        with _patiently():
            answer = _answer(problem, operator)
    except _TooLong:
        return Outcome("unjudged", f"over {_PATIENCE:g} s by {operator.account.method}")
    except ValueError as refusal:
        reason = _unreal(problem, refusal, budget, most_cost)
        return Outcome("unreal" if reason else "refused", reason or str(refusal))
    judge = Judge(problem, answer, most_cost)
    if judge.cost > most_cost:
        return Outcome("unjudged", operator.method)
    share = judge.error(answer) / problem.tol
    # A NaN isn't below its tolerance.
    if share <= 1:
        return Outcome("kept", operator.account.method, share)
    light = f"light of root share {judge.root_share():.1e} on the target"
    return Outcome("wrong", f"{operator.account.method}, {light}", share)


class _TooLong(Exception):
    """An answer that took more processor time than was predicted, by far."""


@contextmanager
def _patiently() -> Iterator[None]:
    """Raise _TooLong in here after some processor time; in the main thread only."""

    def stop(number: int, frame: object) -> None:
        raise _TooLong

    before = signal.signal(signal.SIGPROF, stop)
    signal.setitimer(signal.ITIMER_PROF, _PATIENCE)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, before)


def _answer(problem: Problem, operator: FreeSpace) -> Complex:
    return np.asarray(operator(problem.field).resolve_conj(), dtype=np.complex128)


def _unreal(problem: Problem, refusal: ValueError, budget: Budget, most_cost: float) -> str:
    """What speaks against a refusal, in words: a method that keeps the tolerance all the same,
    or light that is there though none was found. Empty if nothing does."""
    if not isinstance(refusal, ToleranceError):
        return f"no question of tolerance: {refusal}"
    for method in METHODS:
        try:
            operator = problem.operator(method=method, budget=budget)
            if operator.account.cpu_predicted > _MOST_SECONDS:
                continue
            with _patiently():
                answer = _answer(problem, operator)
        except (ValueError, _TooLong):
            continue
        judge = Judge(problem, answer, most_cost)
        if judge.cost <= most_cost and judge.error(answer) <= problem.tol:
            return f"{method} keeps the tolerance, and this was said: {refusal}"
    if "MB" in str(refusal):
        return ""
    judge = Judge(problem, np.ones(problem.target.shape, dtype=np.complex128), most_cost)
    if judge.cost <= most_cost and problem.tol * judge.root_share() > _NOISE:
        return f"light of root share {judge.root_share():.1e} is there, but: {refusal}"
    return ""


@single_threaded
def tolerance_figure(folder: Path) -> list[Figure]:
    """Random problems; each answer is judged where the judge's own sum ends in some seconds."""
    budget, source = Budget(4 << 30, machine_speed()), problems()
    found = [outcome(next(source), budget) for _ in range(_PROBLEMS)]
    kinds = [one.kind for one in found]
    kept, wrong = kinds.count("kept"), kinds.count("wrong")
    refused, unreal = kinds.count("refused"), kinds.count("unreal")
    accepted = _PROBLEMS - refused - unreal
    worst = max(one.share for one in found if one.kind in ("kept", "wrong"))
    return [
        Figure(
            "random free-space problems, tol 1e-1 to 1e-6: answers that keep tol",
            "all",
            f"{kept} of {kept + wrong} judged ({accepted} accepted, {_PROBLEMS} drawn); "
            f"largest error {worst:.2f} tol",
            wrong == 0,
        ),
        Figure(
            "random free-space problems accepted, 4 GB",
            "≥ 90 %",
            f"{accepted / _PROBLEMS:.1%}".replace("%", " %"),
            accepted >= 0.9 * _PROBLEMS,
        ),
        Figure(
            "refused free-space problems that no method answers",
            "all",
            f"{refused} of {refused + unreal}",
            unreal == 0,
        ),
    ]


@single_threaded
def regret_figure(folder: Path) -> list[Figure]:
    """Every method that accepts, timed beside the chosen one; where one alone does, there is
    nothing to regret."""
    budget, source = Budget(1 << 29, machine_speed()), problems(_SEED + 1)
    regrets: list[float] = []
    while len(regrets) < _TIMED:
        times = _times(next(source), budget)
        if len(times) > 1 and min(times.values()) > _SHORT:
            regrets.append(regret(times))
    median, high = median_and_high(regrets)
    return [
        Figure(
            "time of the chosen method over the fastest that accepts, ways through free space",
            "≤ 1.5 median",
            f"{median:.2f}, 95th percentile {high:.2f} of {_TIMED} ways over {1e3 * _SHORT:g} ms",
            median <= 1.5,
        )
    ]


def _times(problem: Problem, budget: Budget) -> dict[str, float]:
    """Seconds of every method that serves a problem, the one that is chosen by itself first."""
    found: dict[str, FreeSpace] = {}
    field = problem.field
    for method in (None, *METHODS):
        try:
            operator = problem.operator(method=method, budget=budget)
            if method is None and not 0.5 * _SHORT < operator.account.cpu_predicted < _LONG:
                return {}
            chosen = next(iter(found.values()), operator)
            if operator.account.cpu_predicted > 4 * chosen.account.cpu_predicted:
                continue
            operator(field)
        except ValueError:
            if method is None:
                return {}
            continue
        found.setdefault(operator.method, operator)
    jobs = {name: partial(operator, field) for name, operator in found.items()}
    return processor_seconds(jobs, 4)


MEASUREMENTS = {"propagation": tolerance_figure, "propagation-regret": regret_figure}
