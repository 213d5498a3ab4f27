"""Fresh chains: which are refused, whether a sum by hand answers them, and what advice is worth."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path

import numpy as np
from judges.chain_by_hand import sum_by_hand
from numpy.typing import NDArray

from figures import Figure
from figures.problems import log_uniform
from labapp.common.speed import machine_speed
from optics.accuracy import Budget, ToleranceError
from optics.camera import Camera, Lens, Panel
from optics.camera.pupil import pupil_amplitude
from optics.camera.stop import Circle, Stop, rectangle, regular_polygon
from optics.plane import Plane
from optics.psf import PSFOperator
from optics.threads import single_threaded

_SEED, _CHAINS, _ADVICE = 20260711, 80, 40
_PRODUCTS = 3e9
"""Of a sum by hand: some ten seconds of processor time."""

_SHORT_SECONDS = 1.0
"""Of a call, predicted, up to which one is made."""

_POSSIBLE = 1e-11
"""Tolerance that a sum by hand must reach to show that a refusal is false."""

_MOST_DRAWN = 1500


@dataclass(frozen=True)
class _Question:
    """A PSF: all that PSFOperator is given, and the panel's phase."""

    optics: Camera | Lens
    distance: float
    wavelength: float
    pixels: Plane
    field: tuple[float, float]
    tol: float
    phase: NDArray[np.float64] | None
    budget: Budget

    def operator(self) -> PSFOperator:
        return PSFOperator(
            self.optics,
            self.distance,
            self.wavelength,
            self.pixels,
            integrate=False,
            tol=self.tol,
            budget=self.budget,
            field=self.field if isinstance(self.optics, Camera) else (0.0, 0.0),
        )

    def refusal(self) -> str:
        """What a refusal says, of the plan or of a short call; "" where there is none."""
        try:
            operator = self.operator()
            if operator.cpu_seconds(self.budget.speed) < _SHORT_SECONDS:
                operator(self.phase)
        except ToleranceError as error:
            return str(error)
        return ""


def fresh_chains(seed: int, separations: tuple[float, float] = (1e-6, 1.0)) -> Iterator[_Question]:
    """Without end: panels of 8 to 300 pixels a side, 4 to 40 µm; windows of 1 to 128 pixels, a
    half of them beside the light; tol 1e-1 to 1e-9."""
    rng, budget = np.random.default_rng(seed), Budget(4 << 30, machine_speed())
    while True:
        shape = int(log_uniform(rng, 8, 300)), int(log_uniform(rng, 8, 300))
        panel = Panel(shape, log_uniform(rng, 4e-6, 4e-5), rng.uniform(0.6, 1.0), unmodulated=0.0)
        separation = log_uniform(rng, *separations)
        distance = math.inf if rng.random() < 0.15 else log_uniform(rng, 0.1, 100.0)
        diameter = max(shape) * panel.pitch * log_uniform(rng, 0.4, 4.0)
        focal = min(max(diameter * log_uniform(rng, 1.4, 32.0), 5e-3), 0.5)
        focus = [math.inf, max(distance + separation, 1.05 * focal), log_uniform(rng, 0.7, 20.0)]
        lens = Lens(focal, focal / diameter, focus[rng.integers(3)], _random_stop(rng))
        camera = Camera(panel, lens, separation=separation)
        if not pupil_amplitude(camera).any():
            continue
        wavelength, away = rng.uniform(350e-9, 1700e-9), rng.uniform(-0.1, 0.1, 2)
        field = away * lens.image_distance * (rng.random() < 0.25)
        pixels = _random_window(rng, wavelength * lens.image_distance / diameter)
        phase = rng.uniform(0, 2 * np.pi, shape)
        tol = log_uniform(rng, 1e-9, 1e-1)
        where = float(field[0]), float(field[1])
        yield _Question(camera, distance, wavelength, pixels, where, tol, phase, budget)


def _random_stop(rng: np.random.Generator) -> Stop:
    kinds = (
        lambda: Stop(),
        lambda: Stop(Circle(), (Circle(rng.uniform(0.1, 0.7)),)),
        lambda: Stop(regular_polygon(int(rng.integers(3, 10)), turn=rng.uniform(0, 1))),
        lambda: Stop(rectangle(rng.uniform(0.3, 1.4), rng.uniform(0.3, 1.4))),
    )
    return kinds[rng.integers(len(kinds))]()


def _random_window(rng: np.random.Generator, airy: float) -> Plane:
    side = int(rng.integers(1, 10)) if rng.random() < 0.4 else int(log_uniform(rng, 10, 128))
    pitch, angle = log_uniform(rng, 1e-6, 2e-5), rng.uniform(0, 2 * np.pi)
    away = [0.0, 0.0, log_uniform(rng, 0.5, 30) * side * pitch, log_uniform(rng, 3, 1000) * airy]
    place = away[rng.integers(4)]
    shape = side, max(1, int(side * rng.uniform(0.3, 1)))
    return Plane(shape, (pitch, pitch), (place * math.sin(angle), place * math.cos(angle)))


def _is_false(question: _Question) -> bool | None:
    """Whether a sum by hand answers a refused question; None where it takes too long."""
    camera, phase = question.optics, question.phase
    assert isinstance(camera, Camera)
    assert phase is not None
    sums = [
        sum_by_hand(
            camera,
            np.exp(1j * phase),
            question.distance,
            question.wavelength,
            question.pixels,
            question.field,
            finer,
            _PRODUCTS,
        )
        for finer in (1.0, 1.3)
    ]
    if sums[0] is None or sums[1] is None:
        return None
    error = np.linalg.norm(sums[0] - sums[1]) / np.linalg.norm(sums[1])
    return bool(error <= max(_POSSIBLE, 0.1 * question.tol))


def _hard_questions(seed: int) -> Iterator[_Question]:
    """Without end: lenses, panels and chains with little memory, far out of focus, or to the last
    digits, of which many are refused."""
    rng = np.random.default_rng(seed)
    for question in fresh_chains(seed + 1):
        optics = question.optics
        assert isinstance(optics, Camera)
        kind = int(rng.integers(3))
        memory = int(log_uniform(rng, 4e6, 2e8))
        tol, distance = question.tol, question.distance
        if rng.random() < 0.3:
            tol, memory = log_uniform(rng, 1e-11, 1e-9), 4 << 30
        elif rng.random() < 0.5:
            distance, memory = log_uniform(rng, 3e-6, 1e-3), 4 << 30
        hard = replace(
            question, tol=tol, distance=distance, budget=replace(question.budget, memory=memory)
        )
        if kind == 0:
            yield replace(hard, optics=optics.lens, phase=None)
        else:
            yield replace(hard, optics=replace(optics, separation=0.0) if kind == 1 else optics)


def take_advice(question: _Question, words: str) -> Iterator[tuple[str, _Question]]:
    """Each piece of advice in a refusal, and the question that follows it."""
    if found := re.search(r"ask for tol (\S+) or more", words):
        yield found[0], replace(question, tol=float(found[1]))
    if found := re.search(r"allow more memory: (\d+) MB", words):
        more = replace(question.budget, memory=int(found[1]) * 1_000_000)
        yield found[0], replace(question, budget=more)
    if found := re.search(r"in focus, to (\S+) m", words):
        yield found[0], replace(question, distance=float(found[1].rstrip(",")))
    if found := re.search(r"fewer pixels: (\d+) x (\d+) about", words):
        plane = question.pixels
        smaller = Plane((int(found[1]), int(found[2])), plane.pitch, plane.centre)
        yield found[0], replace(question, pixels=smaller)
    if "around the point's image" in words:
        plane = question.pixels
        yield "around the image", replace(question, pixels=Plane(plane.shape, plane.pitch))


@single_threaded
def chain_refusals_figure(folder: Path) -> list[Figure]:
    """Fresh chains, and what is refused of them; and advice of any PSF's refusals, followed."""
    refused: list[_Question] = []
    for question in islice(fresh_chains(_SEED), _CHAINS):
        if question.refusal():
            refused.append(question)
    judged = [_is_false(question) for question in refused]
    summed = [one for one in judged if one is not None]
    taken, failed = 0, []
    for question in islice(_hard_questions(_SEED + 2), _MOST_DRAWN):
        words = question.refusal()
        for advice, other in take_advice(question, words) if words else ():
            taken += 1
            again = other.refusal()
            failed += [f"{advice}: {again}"] if again else []
        if taken >= _ADVICE:
            break
    return [
        Figure(
            "fresh chains refused, 1 µm to 1 m from panel to lens, tol 1e-1 to 1e-9",
            "≤ 3 %",
            f"{len(refused)} of {_CHAINS}",
            len(refused) <= 0.03 * _CHAINS,
        ),
        Figure(
            "refused chains that a sum by hand answers",
            "none",
            f"{sum(summed)} of {len(summed)} summed ({len(refused)} refused)",
            not any(summed),
        ),
        Figure(
            "advice of refused PSFs that works",
            "all of 40",
            f"{taken - len(failed)} of {taken}" + "".join(f"; {one}" for one in failed[:2]),
            taken >= _ADVICE and not failed,
        ),
    ]


MEASUREMENTS = {"chain-refusals": chain_refusals_figure}
