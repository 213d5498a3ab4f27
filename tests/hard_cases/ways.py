"""What is asked of free space, and the two kinds of rows that ask it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Protocol

import numpy as np
import torch
from judges import Beam, Edges, richardson
from judges.fields import Cells, Gaussians, Points, Pulse
from judges.view import WAVELENGTH
from numpy.typing import NDArray

from hard_cases.table import Case, require_close, require_finite_gradient
from optics.plane import Plane
from optics.propagation import METHODS, FreeSpace

Field = NDArray[np.complex128]

_BLINK = 0.05
"""Seconds of a call, as predicted, beyond which a method is left to other rows."""

_FINEST_DIFFERENCE = 1e-6
"""What finite differences of a judge can tell."""


class Light(Protocol):
    """A field on a plane that somebody knows everywhere else as well."""

    def samples(self, plane: Plane) -> Field: ...

    def field(self, points: Points, *, paraxial: bool) -> Field: ...


@dataclass(frozen=True)
class Way:
    """Light on one plane, asked for on another, of the library and of a judge alike.

    Lengths are tensors where derivatives are wanted. settings: others of FreeSpace.
    """

    light: Light
    source: Plane
    target: Plane
    distance: Any
    wavelength: Any = WAVELENGTH
    paraxial: bool = False
    tilt: tuple[float, float] = (0.0, 0.0)
    settings: dict[str, Any] = field(default_factory=dict)

    def operator(self, tol: float, method: str | None = None) -> FreeSpace:
        cells = self.light.sides if isinstance(self.light, Cells) else None
        return FreeSpace(
            self.source,
            self.target,
            self.distance,
            self.wavelength,
            cells=cells,
            tilt=self.tilt,
            paraxial=self.paraxial,
            tol=tol,
            method=method,
            **self.settings,
        )

    @property
    def field(self) -> torch.Tensor:
        return torch.from_numpy(self.light.samples(self.source))

    def truth(self) -> Field:
        """What the judge knows of it, on the target; of plain numbers."""
        (a, b), centre = self.tilt, self.target.centre
        own = replace(self.target, centre=(0.0, 0.0))
        y, x = (part.ravel() for part in np.broadcast_arrays(*(c.numpy() for c in own.mesh())))
        points = Points(
            centre[0] + y * math.cos(a),
            centre[1] + x * math.cos(b) + y * math.sin(a) * math.sin(b),
            y * math.sin(a) * math.cos(b) - x * math.sin(b),
            self.distance,
            self.wavelength,
        )
        return self.light.field(points, paraxial=self.paraxial).reshape(self.target.shape)

    def __str__(self) -> str:
        kind = "cells" if isinstance(self.light, Cells) else "samples"
        parts = [
            f"{kind}: {_plane(self.source)}",
            f"{float(self.distance):.3g} m on to {_plane(self.target)}",
            "paraxial" if self.paraxial else "scalar",
        ]
        if any(self.tilt):
            parts.append("tilted by ({:.3g}, {:.3g})".format(*self.tilt))
        return ", ".join(parts)


def _plane(plane: Plane) -> str:
    pitch = " x ".join(f"{p * 1e6:.3g}" for p in dict.fromkeys(plane.pitch))
    return "{}x{} of {} µm".format(*plane.shape, pitch)


def accepting(way: Way, tol: float) -> Iterator[FreeSpace]:
    """By each method that keeps a tolerance in little time; those that refuse do so in words."""
    for name in METHODS:
        try:
            operator = way.operator(tol, name)
            if operator.account.cpu_predicted > _BLINK:
                continue
            operator(way.field)
        except ValueError:
            continue
        yield operator


@dataclass(frozen=True)
class Arrives(Case):
    """A field that a judge knows as well; its derivative in the source's samples is finite.

    every: by all methods that accept it, of which there must be so many; 0: by the one chosen.
    """

    way: Way
    judge: str
    every: int = 0

    @cached_property
    def truth(self) -> Field:
        return self.way.truth()

    def check(self, tol: float) -> None:
        operators = [self.way.operator(tol)]
        if self.every:
            operators += accepting(self.way, tol)
            assert len(operators) > self.every
        for operator in operators:
            require_close(operator(self.way.field), self.truth, tol)
            assert operator.account.error <= tol
        require_finite_gradient(operators[0], self.way.field)

    def asked(self) -> str:
        return str(self.way) + (", by every method" if self.every else "")

    def judged(self) -> str:
        return self.judge


@dataclass(frozen=True)
class Rates(Case):
    """A field's derivatives in its lengths, by every method, against differences of a judge's.

    Of the distance, the wavelength and the target's place along x, all at once. share: of the
    distance and the wavelength, that changes the field a lot. Judged ten times more leniently
    than values.
    """

    way: Way
    judge: str
    share: float = 0.1

    def check(self, tol: float) -> None:
        weight = random(self.way.target.shape, 4)
        chosen = self._by(None, tol, weight)
        assert chosen is not None
        found = [chosen]
        for operator in accepting(self.way, tol):
            # A method may serve a field and not its derivatives; the choice has to.
            other = self._by(operator.method, tol, weight)
            found += [] if other is None else [other]
        for number, (change, size) in enumerate(self.truth):
            expected = float(np.sum(weight.conj() * change).real)
            allowed = max(10 * tol, _FINEST_DIFFERENCE) * size * float(np.linalg.norm(weight))
            assert all(abs(one[number] - expected) <= allowed for one in found)

    def _by(self, method: str | None, tol: float, weight: Field) -> list[float] | None:
        tensors = [torch.tensor(x, dtype=torch.float64, requires_grad=True) for x in self._at]
        try:
            answer = self._moved(*tensors).operator(tol, method)(self.way.field)
        except ValueError:
            return None
        (torch.from_numpy(weight).conj() * answer).real.sum().backward()
        return [float(torch.as_tensor(tensor.grad)) for tensor in tensors]

    @property
    def _at(self) -> tuple[float, float, float]:
        return self.way.distance, self.way.wavelength, self.way.target.centre[1]

    def _moved(self, distance: Any, wavelength: Any, place: Any) -> Way:
        target = replace(self.way.target, centre=(self.way.target.centre[0], place))
        return replace(self.way, distance=distance, wavelength=wavelength, target=target)

    @cached_property
    def truth(self) -> list[tuple[Field, float]]:
        """How the field changes with each, and how large a change is to be expected."""
        found = []
        distance, wavelength, _ = self._at
        units = self.share * abs(distance), self.share * wavelength, 4 * wavelength
        for number, unit in enumerate(units):

            def moved(x: float, number: int = number) -> Field:
                lengths = [*self._at[:number], x, *self._at[number + 1 :]]
                return self._moved(*lengths).truth()

            change = richardson(moved, self._at[number], unit / 6)
            usual = np.linalg.norm(self.way.truth()) / unit
            found.append((change, float(max(np.linalg.norm(change), usual))))
        return found

    def asked(self) -> str:
        return f"{self.way}; derivatives in distance, wavelength and place"

    def judged(self) -> str:
        return f"differences of {self.judge}"


BY_WAVES = "the integral over its known spectrum"
BY_SPACE = "Rayleigh and Sommerfeld's integral over the known field"
BY_FORM = "a Gaussian's closed form"
BY_FRESNEL = "Fresnel's integrals along each side of a cell"
BY_EDGES = "Rubinowicz's integral along every cell's edges"
BY_NODES = "Gauss-Legendre over every cell"
BY_HANKEL = "the Hankel integral of a round beam"

# Smooth light


def _pulses(
    plane: Plane, waists: Sequence[float], tilts: Sequence[float], lens: float = 0.0
) -> tuple[Pulse, Pulse]:
    """A Gaussian at the middle of a plane, tilted, and bent."""
    y, x = (
        Pulse(centre + 0.1 * waist, tilt, complex(waist**-2, lens))
        for centre, waist, tilt in zip(plane.centre, waists, tilts, strict=True)
    )
    return y, x


def beams(plane: Plane, waist: float, tilt: float) -> Gaussians:
    """Two that cross and interfere, without any symmetry."""
    one = _pulses(plane, (waist, 0.9 * waist), (tilt, -0.7 * tilt))
    other = _pulses(plane, (0.8 * waist, waist), (-0.5 * tilt, tilt), 0.7 * waist**-2)
    return Gaussians(((1.0, *one), (0.6j, *other)))


def whole(plane: Plane, share: float = 0.45) -> dict[str, Any]:
    """The band of fields that need nearly all that the samples resolve."""
    y, x = plane.pitch
    return {"band": (share / y, share / x)}


SOURCE = Plane((72, 75), (1e-6, 1.1e-6), (5e-6, -3e-6))
BEAMS = Way(
    beams(SOURCE, 6e-6, 3e4),
    SOURCE,
    Plane((9, 8), (2e-6, 2.3e-6), (6e-6, -5e-6)),
    1e-4,
    settings=whole(SOURCE),
)

FINE = Plane((96, 97), (0.2e-6, 0.2e-6))
BEAM = Way(Beam(2e-6), FINE, Plane((8, 7), (6e-6, 6e-6), (3e-6, 0.0)), 1e-4)


def spread(distance: float, waist: float = 6e-6) -> Plane:
    """Samples across a beam's width at a distance."""
    width = math.hypot(waist, WAVELENGTH * distance / (math.pi * waist))
    return Plane((3, 4), (0.6 * width, 0.5 * width), (0.2 * width, -0.3 * width))


def beams_at(distance: float, *, paraxial: bool) -> Way:
    target = spread(distance)
    centre = SOURCE.centre[0] + target.centre[0], SOURCE.centre[1] + target.centre[1]
    target = replace(target, centre=centre)
    return replace(BEAMS, target=target, distance=distance, paraxial=paraxial)


def reshaped(source: tuple[int, int], target: tuple[int, int]) -> Way:
    """Other numbers of samples of the same pitch on either side."""
    plane = replace(SOURCE, shape=source)
    return replace(
        BEAMS,
        light=beams(plane, 6e-6, 3e4),
        source=plane,
        target=Plane(target, plane.pitch, plane.centre),
    )


def fringes(pitch: float, carrier: float, band: float | None = None) -> Way:
    """A beam steeper than its samples resolve, said to be so, or not."""
    plane = Plane((96, 96), (pitch, pitch))
    light = Gaussians(((1.0, *_pulses(plane, (6 * pitch, 6 * pitch), (0.6 * carrier, carrier))),))
    shift = WAVELENGTH * 1e-4 * carrier
    settings: dict[str, Any] = {"carrier": (0.6 * carrier, carrier)}
    if band:
        settings["band"] = (band, band)
    target = Plane((8, 9), (4e-6, 4e-6), (0.6 * shift, shift))
    return Way(light, plane, target, 1e-4, settings=settings)


# Light that hardly travels

EVANESCENT = Plane((50, 50), (0.05e-6, 0.05e-6))

# Cells

PANEL = Plane((7, 8), (10e-6, 8e-6), (4e-6, -6e-6))
SIDES = (9e-6, 8e-6)


def random(shape: tuple[int, ...], seed: int = 0) -> Field:
    rng = np.random.default_rng(seed)
    return rng.normal(size=shape) + 1j * rng.normal(size=shape)


def cells(
    distance: Any,
    target: Plane | None = None,
    panel: Plane = PANEL,
    sides: tuple[float, float] = SIDES,
    values: Field | None = None,
    kind: type[Cells] = Edges,
    **way: Any,
) -> Way:
    """Random cells, and a window in front of them, unless others are given."""
    light = kind(panel, sides, random(panel.shape) if values is None else values)
    window = target or Plane((3, 4), (1.3e-5, 9e-6), (11e-6, -15e-6))
    return Way(light, panel, window, distance, **way)


def few_cells(**way: Any) -> Way:
    """Two by three, before two by two samples."""
    panel = replace(PANEL, shape=(2, 3))
    return cells(1e-3, Plane((2, 2), (2e-5, 3e-5), (11e-6, -15e-6)), panel, **way)


def orders(distance: float, number: float) -> Plane:
    """A window at an order of a panel of 10 and 8 µm."""
    y, x = (WAVELENGTH * distance / p for p in PANEL.pitch)
    return Plane((5, 6), (y / 9, x / 9), (number * y, number * x))


def corner(rows: int, columns: int) -> Field:
    """The last row's first sample is lit."""
    values = np.zeros((rows, columns), dtype=complex)
    values[-1, 0] = 1
    return values
