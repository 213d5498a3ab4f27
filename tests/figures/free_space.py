"""What textbooks know of free space in closed form, beside what every method computes.

Discs and opaque discs have soft edges here: a grid holds no sharp circle. A disc whose edge
falls as erfc is a Gaussian mean of sharp discs of all radii, so that its field on the axis is
the same mean of the textbooks' formula.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch
from judges import relative
from judges.fields import Complex, Real, panels, slit
from scipy.special import erfc, j0, roots_hermite

from figures import Figure
from optics.plane import Plane
from optics.propagation.free_space_operator import METHODS, FreeSpace
from optics.threads import single_threaded

_TOL = 1e-8
_GOAL = 1e-6
_GREEN = 532e-9
_MOST_SECONDS = 3.0

SOFT_DISCS = ((20e-6, 100e-6, 1.2e-6), (40e-6, 250e-6, 1.2e-6), (10e-6, 50e-6, 1.2e-6))
"""Radius, distance and softness of discs whose edges send light to the axis at 9 to 11 degrees:
there Fresnel's phase is wrong by a tenth to a quarter of a radian."""


@dataclass(frozen=True)
class Form:
    """Light on a plane, and its exact field on another in one of the models."""

    source: Plane
    light: Complex
    target: Plane
    distance: float
    wavelength: float
    truth: Complex
    settings: dict[str, Any] = field(default_factory=dict)

    def operator(self, tol: float = _TOL, **settings: Any) -> FreeSpace:
        return FreeSpace(
            self.source,
            self.target,
            self.distance,
            self.wavelength,
            tol=tol,
            **{**self.settings, **settings},
        )

    def error(self, operator: FreeSpace) -> float:
        """Relative L2 error of an answer."""
        value = np.asarray(
            operator(torch.from_numpy(self.light)).resolve_conj(), dtype=np.complex128
        )
        return relative(value, self.truth)

    def errors(
        self, tol: float = _TOL, most_seconds: float = _MOST_SECONDS
    ) -> Iterator[tuple[str, float]]:
        """Of every method that accepts the question, and isn't predicted to take longer."""
        for name in METHODS:
            try:
                operator = self.operator(tol, method=name)
                if operator.account.cpu_predicted > most_seconds:
                    continue
                error = self.error(operator)
            except ValueError:
                continue
            yield name, error


def positions(plane: Plane) -> tuple[Real, Real]:
    """(y, x) in metres, as a column and a row."""
    y, x = plane.mesh()
    return y.numpy(), x.numpy()


def rectangle(distance: float, centre: tuple[float, float], pitch: float = 3e-6) -> Form:
    """A clear rectangle of 96 x 80 cells of 4 µm, paraxial: its near field, or an edge's."""
    source, side = Plane((96, 80), (4e-6, 4e-6)), 4e-6
    target = Plane((25, 32), (2 * pitch, 2.2 * pitch), centre)
    scale = _GREEN * distance
    factors = []
    for axis, where in enumerate(positions(target)):
        inside = source.coordinates(axis).numpy()
        low, high = inside[0] - side / 2, inside[-1] + side / 2
        factors.append(slit(low - where, high - where, np.array(scale)))
    ones = np.ones(source.shape, dtype=np.complex128)
    settings = {"cells": (side, side), "paraxial": True}
    return Form(source, ones, target, distance, _GREEN, factors[0] * factors[1], settings)


def soft_disc(
    radius: float, distance: float, softness: float, *, opaque: bool, paraxial: bool
) -> Form:
    """The axis behind a soft disc, clear or opaque in a wide soft window.

    A sharp one has 1 - (z / r) exp(ik(r - z)) on its axis, r² = z² + radius² (Rayleigh and
    Sommerfeld; H. Osterberg and L. W. Smith, JOSA 51, 1050, 1961), or 1 - exp(i pi radius² /
    (wavelength z)) in Fresnel's model; behind an opaque one lies Arago's spot, 1 minus that.
    """
    pitch = 0.3 * softness
    # Beyond six softnesses an edge is over; beyond a few fringes of its light so is its field.
    outer = radius + 12 * softness + (_fringes(distance, softness) if opaque else 0.0)
    half = math.ceil((outer + 6 * softness) / pitch)
    source = Plane((2 * half, 2 * half), (pitch, pitch))
    y, x = positions(source)
    disc = erfc((np.hypot(y, x) - radius) / softness) / 2
    on_axis = 1 - _mean_edge_wave(radius, distance, softness, paraxial=paraxial)
    if opaque:
        disc, on_axis = erfc((np.hypot(y, x) - outer) / softness) / 2 - disc, 1 - on_axis
    return Form(
        source,
        disc.astype(np.complex128),
        Plane((1, 1), (pitch, pitch)),
        distance,
        _GREEN,
        np.full((1, 1), on_axis),
        {"paraxial": paraxial, "band": (1.5 / softness, 1.5 / softness)},
    )


def _fringes(distance: float, softness: float) -> float:
    """How far sideways the light of a soft edge goes, metres.

    Its spectrum falls as exp(-(pi softness f)²), to 1e-9 where pi softness f is 4.6.
    """
    sine = min(0.9, _GREEN * 4.6 / (math.pi * softness))
    return distance * sine / math.sqrt(1 - sine**2)


def _mean_edge_wave(radius: float, distance: float, softness: float, *, paraxial: bool) -> complex:
    """The Gaussian mean over radii of the wave that a sharp edge sends to the axis."""
    nodes, weights = roots_hermite(80)
    squared = (radius + softness * nodes) ** 2
    if paraxial:
        wave = np.exp(1j * np.pi * squared / (_GREEN * distance))
    else:
        r = np.sqrt(distance**2 + squared)
        further = squared / (r + distance)
        wave = distance / r * np.exp(2j * np.pi * further / _GREEN)
    return complex(weights @ wave / math.sqrt(math.pi))


def talbot_distance(period: float, wavelength: float) -> float:
    """Where a cosine's fringes return, of a scalar wave; 2 period² / wavelength if paraxial."""
    sine = wavelength / period
    return wavelength * (1 + math.sqrt(1 - sine**2)) / sine**2


def talbot(*, paraxial: bool, distance: float | None = None, pitch: float = 0.8e-6) -> Form:
    """Fringes of 4 µm in a wide window with soft edges, far from them: after the Talbot
    distance they are what they were, and elsewhere their phase lags (Goodman 4.5.2)."""
    period, step, softness = 4e-6, 0.8e-6, 12e-6
    returns = 2 * period**2 / _GREEN if paraxial else talbot_distance(period, _GREEN)
    distance = returns if distance is None else distance
    source = Plane((300, 400), (step, step))
    target = Plane((9, 33), (pitch, pitch))
    y, x = positions(source)
    window = erfc((np.abs(y) - 60e-6) / softness) * erfc((np.abs(x) - 95e-6) / softness) / 4
    fringes = np.cos(2 * np.pi * positions(target)[1] / period)
    lag = np.exp(-2j * np.pi * distance / returns)
    truth = np.broadcast_to(1 + 0.7 * lag * fringes, target.shape)
    light = (window * (1 + 0.7 * np.cos(2 * np.pi * x / period))).astype(np.complex128)
    settings = {"paraxial": paraxial, "band": (0.45 / step, 0.45 / step)}
    return Form(source, light, target, distance, _GREEN, truth, settings)


def gaussian_beam(
    distance: float, *, paraxial: bool, waist: float = 2e-6, alike: bool = False
) -> Form:
    """A beam at its waist, exp(-r² / waist²), and away from it; on samples like the waist's, if
    they shall be alike."""
    pitch = waist / 4
    source = target = Plane((48, 51), (pitch, pitch))
    if not alike:
        spread = waist * math.hypot(1, _GREEN * distance / (math.pi * waist**2))
        target = Plane((17, 14), (spread / 5, spread / 4), (0.1 * spread, -0.2 * spread))
    y, x = positions(source)
    light = np.exp(-(y**2 + x**2) / waist**2).astype(np.complex128)
    radius = np.hypot(*positions(target))
    truth = _paraxial_beam if paraxial else _scalar_beam
    settings = {"paraxial": paraxial, "band": (0.45 / pitch, 0.45 / pitch)}
    return Form(source, light, target, distance, _GREEN, truth(radius, distance, waist), settings)


def _paraxial_beam(radius: Real, distance: float, waist: float) -> Complex:
    """Siegman, Lasers, 16.3, without exp(ikz)."""
    stretch = 1 + 1j * _GREEN * distance / (math.pi * waist**2)
    return np.asarray(np.exp(-(radius**2) / (waist**2 * stretch)) / stretch)


def _scalar_beam(radius: Real, distance: float, waist: float) -> Complex:
    """The Hankel integral of its angular spectrum, in panels.

    The spectrum, pi waist² exp(-(pi waist f)²), is below 1e-16 where pi waist f is 6.1.
    """
    highest = min(6.1 / (math.pi * waist), 1 / _GREEN)
    waves = highest * (radius.max() + 3 * abs(distance) * _GREEN * highest)
    f, step = panels(0.0, highest, waves)
    lag = (_GREEN * f) ** 2
    turn = distance / _GREEN * lag / (1 + np.sqrt(1 - lag))
    spectrum = math.pi * waist**2 * np.exp(-((math.pi * waist * f) ** 2))
    light = 2 * math.pi * step * f * spectrum * np.exp(-2j * math.pi * turn)
    radii, place = np.unique(radius.ravel(), return_inverse=True)
    field = j0(2 * math.pi * np.outer(radii, f)) @ light
    return np.asarray(field[place].reshape(radius.shape))


def model_errors() -> Iterator[tuple[float, float]]:
    """Beams by Fresnel's model: their error against the scalar wave, and the predicted one."""
    for waist, distance in ((2e-6, 100e-6), (3e-6, 1e-3), (6e-6, 10e-3)):
        form = gaussian_beam(distance, paraxial=False, waist=waist)
        operator = form.operator(paraxial=True)
        yield form.error(operator), operator.account.model.value


def _beams() -> Iterator[Form]:
    for distance, alike in ((30e-6, False), (200e-6, False), (-100e-6, False), (60e-6, True)):
        for paraxial in (False, True):
            yield gaussian_beam(distance, paraxial=paraxial, alike=alike)
    yield gaussian_beam(0.1, paraxial=True, waist=50e-6)


FORMS: dict[str, Callable[[], Iterator[Form]]] = {
    "rectangle": lambda: (rectangle(z, (0.0, 0.0)) for z in (1e-3, 10e-3, -4e-3)),
    "knife edge": lambda: (rectangle(z, (-90e-6, 10e-6), 1e-6) for z in (2e-3, 5e-3)),
    "disc": lambda: (
        soft_disc(*disc, opaque=False, paraxial=paraxial)
        for disc in SOFT_DISCS
        for paraxial in (False, True)
    ),
    "Arago's spot": lambda: (
        soft_disc(*SOFT_DISCS[0], opaque=True, paraxial=paraxial) for paraxial in (False, True)
    ),
    "Talbot": lambda: (
        talbot(paraxial=paraxial, distance=distance, pitch=pitch)
        for paraxial in (False, True)
        for distance, pitch in ((None, 0.8e-6), (47e-6, 0.7e-6))
    ),
    "Gaussian beam": _beams,
}


@single_threaded
def closed_forms(folder: Path) -> list[Figure]:
    """Every method that accepts, in its own model; and how wrong Fresnel's is said to be."""
    told, worst = [], 0.0
    for name, forms in FORMS.items():
        found = [one for form in forms() for one in form.errors()]
        largest = max(error for _, error in found)
        worst = max(worst, largest)
        told.append(f"{name} {largest:.0e} ({len({method for method, _ in found})} methods)")
    ratios = [predicted / error for error, predicted in model_errors()]
    return [
        Figure(
            "closed forms of free space, largest error of any method",
            "≤ 1e-6",
            ", ".join(told),
            worst <= _GOAL,
        ),
        Figure(
            "Fresnel's model error as predicted, over the one against scalar beams",
            "0.5 to 2",
            " / ".join(f"{ratio:.2f}" for ratio in ratios),
            all(0.5 <= ratio <= 2 for ratio in ratios),
        ),
    ]


MEASUREMENTS = {"free-space": closed_forms}
