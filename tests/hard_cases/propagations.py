"""Free space: distances, models, planes, light that misses, derivatives."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from typing import Any, Protocol

import numpy as np
import torch
from numpy.typing import NDArray

from hard_cases.judges import Beam, Edges, richardson
from hard_cases.table import (
    DOUBLE,
    ONCE,
    SINGLE,
    Agrees,
    Case,
    Holds,
    Refused,
    require_close,
    require_finite_gradient,
)
from hard_cases.view import WAVELENGTH
from labapp.figures.free_space import soft_disc
from labapp.figures.free_space_judge import Cells, Gaussians, Points, Pulse
from optics.accuracy import Budget
from optics.plane import Plane
from optics.propagation import METHODS, FreeSpace
from optics.propagation.transfer import transfer

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


def _beams(plane: Plane, waist: float, tilt: float) -> Gaussians:
    """Two that cross and interfere, without any symmetry."""
    one = _pulses(plane, (waist, 0.9 * waist), (tilt, -0.7 * tilt))
    other = _pulses(plane, (0.8 * waist, waist), (-0.5 * tilt, tilt), 0.7 * waist**-2)
    return Gaussians(((1.0, *one), (0.6j, *other)))


def _whole(plane: Plane, share: float = 0.45) -> dict[str, Any]:
    """The band of fields that need nearly all that the samples resolve."""
    y, x = plane.pitch
    return {"band": (share / y, share / x)}


SOURCE = Plane((72, 75), (1e-6, 1.1e-6), (5e-6, -3e-6))
BEAMS = Way(
    _beams(SOURCE, 6e-6, 3e4),
    SOURCE,
    Plane((9, 8), (2e-6, 2.3e-6), (6e-6, -5e-6)),
    1e-4,
    settings=_whole(SOURCE),
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
        light=_beams(plane, 6e-6, 3e4),
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


# Laws


def centred(tol: float) -> None:
    """The centroid of a symmetric beam is where it was, to a millionth of a sample."""
    for n in (64, 65):
        source = Plane((n, n + 1), (1e-6, 1e-6))
        light = Beam(5e-6).samples(source)
        for z in (1e-9, 1e-5, -1e-3, 10.0):
            width = math.hypot(5e-6, WAVELENGTH * z / (math.pi * 5e-6))
            target = Plane((n - 31, n - 32), (width / 3, width / 3))
            for paraxial in (False, True):
                way = FreeSpace(source, target, z, WAVELENGTH, paraxial=paraxial, tol=tol,
                                **_whole(source))  # fmt: skip
                shown = np.abs(way(light)).astype(float) ** 2
                for axis, count in enumerate(target.shape):
                    at = np.arange(count) - count // 2
                    middle = np.sum(shown.sum(1 - axis) * at) / shown.sum()
                    assert abs(middle) <= 1e-6


def turned_alike(tol: float) -> None:
    """A round beam is the same after a quarter turn and in every mirror."""
    source = Plane((65, 65), (0.3e-6, 0.3e-6))
    for z in (1e-6, 2e-5, -1e-3):
        width = math.hypot(2e-6, WAVELENGTH * z / (math.pi * 2e-6))
        way = Way(Beam(2e-6), source, Plane((13, 13), (width / 3, width / 3)), z,
                  settings=_whole(source))  # fmt: skip
        for operator in accepting(way, tol):
            shown = np.asarray(operator(way.light.samples(source)))
            for same in (shown.T, shown[::-1], shown[:, ::-1], np.rot90(shown)):
                assert np.abs(same - shown).max() <= 2 * tol * np.abs(shown).max()


def twice_as_fine(tol: float) -> None:
    """The same beam on half the pitch, and on a plane twice as wide."""
    answers = []
    for n, pitch in ((64, 1e-6), (128, 0.5e-6), (128, 1e-6)):
        source = Plane((n, n), (pitch, pitch))
        light = _beams(SOURCE, 5e-6, 3e4).samples(source)
        way = FreeSpace(source, BEAMS.target, 1e-4, WAVELENGTH, tol=tol, band=(4.2e5, 4.2e5))
        answers.append(way(light))
    for answer in answers[1:]:
        require_close(answer, answers[0], 2 * tol)


def there_and_back(tol: float) -> None:
    """Waves that travel come back as they left."""
    wide = Plane((220, 221), (1e-6, 1.1e-6), SOURCE.centre)
    there = replace(BEAMS, target=wide).operator(tol)
    back = FreeSpace(wide, SOURCE, -1e-4, WAVELENGTH, tol=tol, **_whole(SOURCE))
    require_close(back(there(BEAMS.field)), BEAMS.field, 2 * tol)


def in_two_steps(tol: float) -> None:
    """30 µm and 70 µm are 100 µm."""
    wide = Plane((160, 161), (1e-6, 1.1e-6), SOURCE.centre)
    first = replace(BEAMS, target=wide, distance=3e-5).operator(tol)
    second = FreeSpace(wide, BEAMS.target, 7e-5, WAVELENGTH, tol=tol, **_whole(SOURCE))
    require_close(second(first(BEAMS.field)), BEAMS.truth(), 3 * tol)


def adjoint(tol: float) -> None:
    """<A x, y> = <x, A* y>, by every method, of smooth light and cells, there and back."""
    ways = [replace(BEAMS, paraxial=p, distance=z) for p in (False, True) for z in (1e-4, -1e-4)]
    ways += [cells(z, paraxial=p) for p in (False, True) for z in (1e-3, -1e-3)]
    for way in ways:
        y = torch.from_numpy(random(way.target.shape, 3))
        for operator in accepting(way, tol):
            left = torch.sum(operator(way.field).to(torch.complex128).conj() * y)
            right = torch.sum(way.field.conj() * operator.adjoint(y).to(torch.complex128))
            size = float(operator(way.field).norm() * y.norm())
            assert abs(complex(left - right)) <= tol * size


EVANESCENT = Plane((50, 50), (0.05e-6, 0.05e-6))


def grows_not(distance: float) -> Callable[[float], None]:
    def law(tol: float) -> None:
        """Light that died on the way isn't made on the way back."""
        light = Beam(0.25e-6).samples(EVANESCENT)
        pitch = 0.1e-6 + abs(distance) / 20
        target = Plane((41, 41), (pitch, pitch))
        way = FreeSpace(EVANESCENT, target, distance, WAVELENGTH, tol=tol, **_whole(EVANESCENT))
        answer = np.asarray(way(light)).astype(complex)
        assert np.isfinite(answer).all()
        power = np.sum(np.abs(answer) ** 2) * pitch**2
        assert power <= np.sum(np.abs(light) ** 2) * 0.05e-6**2 * (1 + tol)

    return law


def no_more_light(tol: float) -> None:
    """Of random cells, however near: what arrives is what left, at the most."""
    left = np.sum(np.abs(random(PANEL.shape)) ** 2) * SIDES[0] * SIDES[1]
    for z, paraxial in ((1e-9, True), (1e-5, True), (1e-3, True), (1e-3, False), (-1e-3, False)):
        pitch = 2e-6 if abs(z) < 1e-4 else 8e-6
        window = Plane((60, 60), (pitch, pitch), PANEL.centre)
        answer = np.asarray(cells(z, window, paraxial=paraxial).operator(tol)(random(PANEL.shape)))
        # Samples of a sharp edge are a sum, not the integral: the nearest plane has 45 a cell.
        spare = 0.05 if abs(z) < 1e-4 else tol
        assert np.sum(np.abs(answer) ** 2) * pitch**2 <= left * (1 + spare)


def all_there(tol: float) -> None:
    """A wide window gets all light of a smooth field, half a window the half."""
    wide = Plane((128, 129), (1e-6, 1.1e-6), SOURCE.centre)
    left = float((BEAMS.field.abs() ** 2).sum()) * 1.1e-12
    for paraxial in (False, True):
        way = replace(BEAMS, target=wide, paraxial=paraxial)
        arrived = np.abs(np.asarray(way.operator(tol)(BEAMS.field.numpy()))) ** 2 * 1.1e-12
        assert abs(arrived.sum() - left) <= 2 * tol * left


def scaled(tol: float) -> None:
    """The way is chosen by numbers without a unit: fewer metres change neither it nor the field."""
    for way in (BEAMS, replace(BEAMS, paraxial=True, distance=1e-2), cells(1e-3),
                cells(1e-3, paraxial=True)):  # fmt: skip
        first = way.operator(tol)
        for s in (1e-4, 1e3, 1e6):
            other = FreeSpace(
                *(_grown(plane, s) for plane in (way.source, way.target)), way.distance * s,
                WAVELENGTH * s, paraxial=way.paraxial, tol=tol,
                cells=tuple(c * s for c in SIDES) if isinstance(way.light, Cells) else None,  # type: ignore[arg-type]
                **{k: tuple(f / s for f in v) for k, v in way.settings.items()},
            )  # fmt: skip
            assert other.method == first.method
            require_close(other(way.field), first(way.field), 1e-5 if tol > 1e-7 else 1e-10)


def _grown(plane: Plane, s: float) -> Plane:
    return Plane(
        plane.shape,
        (plane.pitch[0] * s, plane.pitch[1] * s),
        (plane.centre[0] * s, plane.centre[1] * s),
    )


def declared_pitch(tol: float) -> None:
    """Neighbours are the declared pitch apart, and the origin is at n // 2."""
    for n in (1, 2, 5, 64, 65):
        for plane in (Plane((n, n + 1), (8e-6, 3e-6)), Plane((n, n + 1), (8e-6, 3e-6), (1.0, -2))):
            for axis in (0, 1):
                at = plane.coordinates(axis).numpy()
                assert np.abs(np.diff(at) - plane.pitch[axis]).max(initial=0) <= 1e-15
                assert at[plane.shape[axis] // 2] == plane.centre[axis]


def precisions(tol: float) -> None:
    """Single precision is off by its rounding, and double precision by none."""
    for way in (beams_at(1.0, paraxial=True), beams_at(1.0, paraxial=False), BEAMS):
        for wanted, allowed in ((1e-4, 1e-6), (1e-10, 1e-10)):
            operator = way.operator(wanted)
            answer = operator(way.field)
            require_close(answer, way.truth(), allowed)
            single = operator.account.precision == "float32"
            assert answer.dtype == (torch.complex64 if single else torch.complex128)
            assert single == (wanted == 1e-4) or operator.method == "direct quadrature"


def two_models(tol: float) -> None:
    """The paraxial model is off by what its account says, within a factor of two."""
    for z in (1e-4, 1e-3):
        pitch = 2e-6 * math.hypot(1, WAVELENGTH * z / (math.pi * 4e-12)) / 8
        way = replace(BEAM, distance=z, target=Plane((41, 41), (pitch, pitch)))
        operator = replace(way, paraxial=True).operator(tol)
        wrong = np.asarray(operator(way.light.samples(FINE))) - way.truth()
        error = float(np.linalg.norm(wrong) / np.linalg.norm(way.truth()))
        assert error > 2 * SINGLE
        assert error / 2 <= operator.account.model.value <= 2 * error


def nothing(tol: float) -> None:
    """Zeros, and gradients without NaN, by every method."""
    for way in (BEAMS, replace(BEAMS, paraxial=True), cells(1e-3), cells(1e-3, paraxial=True)):
        for name in METHODS:
            try:
                operator = way.operator(tol, name)
            except ValueError:
                continue
            dark = torch.zeros_like(way.field).requires_grad_()
            answer = operator(dark)
            (answer.abs() ** 2).sum().backward()
            assert not answer.detach().any()
            assert dark.grad is not None
            assert not dark.grad.any()


def one_of_three_dark(tol: float) -> None:
    """A dark field beside bright ones, in a batch of batches, each as it is alone."""
    field = BEAMS.field
    batch = torch.stack([field, 0 * field, 1e-20j * field])[:, None]
    operator = BEAMS.operator(tol)
    together = operator(batch)
    assert together.shape == (3, 1, 9, 8)
    require_close(together[0, 0], BEAMS.truth(), tol)
    assert not together[1].any()
    require_close(together[2, 0].to(torch.complex128) * -1e20j, BEAMS.truth(), tol)
    assert operator(batch[:0]).shape == (0, 1, 9, 8)


def strength(factor: float) -> Callable[[float], None]:
    def law(tol: float) -> None:
        for way in (BEAMS, cells(1e-3)):
            answer = way.operator(tol)(way.field * factor).to(torch.complex128) / factor
            require_close(answer, way.truth(), tol)

    return law


def kept_unusually(tol: float) -> None:
    """Transposed, conjugated, expanded, read-only and real fields; arrays answered by arrays."""
    field, operator = BEAMS.field, BEAMS.operator(tol)
    plain, truth = operator(field), BEAMS.truth()
    require_close(plain, truth, tol)
    for same in (field.T.contiguous().T, field.conj().resolve_conj().conj(),
                 field.expand(2, *field.shape)[1]):  # fmt: skip
        require_close(operator(same), truth, tol)
    array = field.numpy().copy()
    array.setflags(write=False)
    for kept in (array, np.asfortranarray(array), array.astype(array.dtype.newbyteorder())):
        answer = operator(kept)
        assert isinstance(answer, np.ndarray)
        require_close(answer, truth, tol)
    real = BEAM.light.samples(FINE).real
    for numbers in (real, torch.from_numpy(real)):
        require_close(BEAM.operator(tol)(numbers), BEAM.truth(), tol)


def arrays_back(tol: float) -> None:
    """By every method, there and back: an array for an array, a tensor that numpy can read."""
    for way in (cells(-1e-3), cells(-1e-3, paraxial=True), replace(BEAMS, distance=-1e-4)):
        for operator in accepting(way, tol):
            assert isinstance(operator(way.field.numpy()), np.ndarray)
            assert isinstance(operator.adjoint(operator(way.field).numpy()), np.ndarray)


def mixed_precision(tol: float) -> None:
    """The same numbers under autocast, by every method."""
    for way in (BEAMS, cells(1e-3, paraxial=True), cells(1e-3)):
        for operator in accepting(way, tol):
            plain = operator(way.field)
            with torch.autocast("cpu", dtype=torch.bfloat16):
                require_close(operator(way.field), plain, 1e-12)


def grazing(tol: float) -> None:
    """A wave exactly along the plane, those beside it, and the axial one: no NaN, no infinity."""
    for length in (2.0**-21, 550e-9):
        wavelength = torch.tensor(length, dtype=torch.float64, requires_grad=True)
        f = (1 / length) * torch.tensor([0, 0.5, 1 - 2**-52, 1, 1 + 2**-52, 2], dtype=torch.float64)
        for z in (1e-9, -1e-6, 1.0):
            distance = torch.tensor(z, dtype=torch.float64, requires_grad=True)
            for y, x in ((f, 0 * f), (0.6 * f, 0.8 * f)):
                wave = transfer(y, x, distance, wavelength)
                found = torch.autograd.grad(wave.real.sum() + wave.imag.sum(), (distance, wavelength))
                assert all(torch.isfinite(one) for one in found)
                assert torch.isfinite(torch.view_as_real(wave.detach())).all()
                assert float(wave.detach().abs().max()) <= 1 + 1e-15


def two_steps(tol: float) -> None:
    """A second step through one plan has a graph of its own, and the same derivative."""
    for way_of in (lambda z: replace(BEAMS, distance=z), lambda z: cells(z, paraxial=True)):
        distance = torch.tensor(1e-4, dtype=torch.float64, requires_grad=True)
        operator = way_of(distance).operator(tol)
        field = way_of(1e-4).field.requires_grad_()
        found = []
        for _ in range(2):
            distance.grad = field.grad = None
            (operator(field)[1, 2].abs() ** 2).backward()
            assert distance.grad is not None
            assert field.grad is not None
            found.append((float(distance.grad), float(field.grad.abs().sum())))
        assert found[0] == found[1]
        assert found[0][0] != 0


def moved(name: str, low: float, high: float) -> Callable[[float], None]:
    def law(tol: float) -> None:
        """After an optimiser's step the answer is the new number's, or a refusal."""
        number = torch.tensor(low, dtype=torch.float64, requires_grad=True)

        def way(x: Any) -> Way:
            if name == "target's centre":
                return replace(BEAMS, target=replace(BEAMS.target, centre=(x, 0.0)))
            return replace(BEAMS, **{name: x})

        operator = way(number).operator(tol)
        operator(BEAMS.field)
        with torch.no_grad():
            number.fill_(high)
        try:
            answer = operator(BEAMS.field)
        except ValueError:
            return
        require_close(answer, way(high).truth(), tol)

    return law


def descends(tol: float) -> None:
    """Five steps down the gradient put more light on a sample each time."""
    phase = torch.zeros(PANEL.shape, dtype=torch.float64, requires_grad=True)
    operator = cells(1e-3).operator(tol)
    optimiser = torch.optim.SGD([phase], lr=1.0)
    losses = []
    for _ in range(5):
        optimiser.zero_grad()
        answer = operator(torch.polar(torch.ones_like(phase), phase))
        loss = -(answer[1, 2].abs() ** 2)
        loss.backward()
        optimiser.step()
        losses.append(float(loss.detach()))
    assert all(later < earlier for earlier, later in pairwise(losses))


def without_a_graph(tol: float) -> None:
    """The same numbers inside torch.no_grad(), before and after it."""
    distance = torch.tensor(1e-4, dtype=torch.float64, requires_grad=True)
    operator = replace(BEAMS, distance=distance).operator(tol)
    with torch.no_grad():
        silent = operator(BEAMS.field)
    assert not silent.requires_grad
    again = operator(BEAMS.field)
    assert again.requires_grad
    require_close(again, silent, 1e-6 if tol > 1e-7 else 1e-12)


def on_the_axis(form: Any) -> dict[str, Callable[..., Any]]:
    return {
        "ask": lambda tol: form.operator(tol)(torch.from_numpy(form.light)),
        "truth": lambda: form.truth,
    }


DISC, ARAGO = (soft_disc(20e-6, 100e-6, 1.2e-6, opaque=o, paraxial=False) for o in (False, True))


# Refusals


def refused(
    name: str,
    hard_because: str,
    given: str,
    ask: Callable[[], Any],
    words: str,
    remedy: Callable[[float], Any] = lambda tol: BEAMS.operator(tol)(BEAMS.field),
) -> Refused:
    return Refused(name, hard_because, given, ask, words, remedy)


def lens(pitch: float) -> torch.Tensor:
    """A beam of 60 µm behind a lens whose fringes are 2 µm wide at its rim."""
    n = round(2.4e-4 / pitch)
    plane = Plane((n, n), (pitch, pitch))
    alpha = complex((40e-6) ** -2, math.pi / (WAVELENGTH * 2e-4))
    pulse = Pulse(0.0, 0.0, alpha)
    field = torch.from_numpy(Gaussians(((1.0, pulse, pulse),)).samples(plane))
    return FreeSpace(plane, Plane((5, 5), (1e-6, 1e-6)), 2e-4, WAVELENGTH)(field)


def wide_open(**settings: Any) -> torch.Tensor:
    """A field that its plane cuts off."""
    n = settings.pop("n", 24)
    plane = Plane((n, n), (1e-6, 1e-6))
    field = torch.from_numpy(Beam(6e-6).samples(plane))
    return FreeSpace(plane, BEAMS.target, 1e-4, WAVELENGTH, **settings)(field)


def huge(source: int, target: int, **settings: Any) -> FreeSpace:
    planes = [Plane((n, n), (1e-6, 1e-6)) for n in (source, target)]
    return FreeSpace(*planes, settings.pop("distance", 1e-2), WAVELENGTH,
                     budget=Budget(memory=1 << 28), **settings)  # fmt: skip


def dark(centre: float, tol: float = SINGLE) -> torch.Tensor:
    way = replace(BEAMS, target=replace(BEAMS.target, centre=(centre, 0.0)))
    return way.operator(tol)(way.field)


CASES: list[Case] = [
    # Distances
    *(
        Arrives(
            f"two beams, {z:g} m on" + (", paraxial" if paraxial else ""),
            "so near a kernel is a needle, so far it is a plane, and k z has no digit left",
            beams_at(z, paraxial=paraxial),
            BY_FORM if paraxial else f"{BY_WAVES}, or over the field",
            # A million metres away phases have 1e9 turns, and float64 seven digits of one.
            tols=(SINGLE, DOUBLE if z < 1e3 else 1e-5),
        )
        for paraxial in (False, True)
        for z in (1e-9, -1e-6, 1e-3, -1.0, 1e6)
    ),
    *(
        Arrives(
            f"cells, {z:g} m on, paraxial",
            "edges ring: ever finer fringes, or 1e5 of them between two planes",
            cells(z, paraxial=True),
            BY_FRESNEL,
        )
        for z in (1e-9, -1e-6, 1e-4)
    ),
    *(
        Arrives(
            f"cells, {z:g} m on",
            "a kernel as narrow as the distance, in cells that it must be integrated over",
            cells(z),
            BY_EDGES,
        )
        for z in (3e-5, -1e-4, 3e-3)
    ),
    Arrives(
        "cells a metre away, half a metre aside",
        "k r is 1e7 rad, and the way beyond z alone a million: single precision has none left",
        cells(1.0, Plane((4, 5), (3e-3, 4e-3), (0.3, -0.4)), kind=Cells),
        BY_NODES,
        tols=(SINGLE, 1e-5),
    ),
    Arrives(
        "cells a thousand kilometres away",
        "the whole source is a point but for its phases",
        cells(1e6, orders(1e6, 0.5), kind=Cells),
        BY_NODES,
        tols=(SINGLE, 1e-4),
    ),
    # Ways
    Arrives(
        "two beams, by all ways",
        "a method's error is invisible to itself",
        BEAMS,
        BY_WAVES,
        every=2,
    ),
    Arrives(
        "two beams, back by all ways",
        "a sign of the phase, which no intensity shows",
        replace(BEAMS, distance=-1e-4),
        BY_WAVES,
        every=2,
    ),
    Arrives(
        "two beams, paraxial, by all ways",
        "three integrals that only the exact one is equal to",
        replace(BEAMS, paraxial=True),
        BY_FORM,
        every=2,
    ),
    Arrives(
        "two beams, far on, paraxial, by all ways",
        "one transform, two of them, and convolutions",
        beams_at(-0.02, paraxial=True),
        BY_FORM,
        every=2,
    ),
    Arrives(
        "a beam of two micrometres",
        "called exact elsewhere, with a paraxial kernel inside: 4 % off",
        BEAM,
        BY_HANKEL,
        every=2,
    ),
    Arrives(
        "cells, by all ways",
        "sharp edges, which no spectrum holds",
        cells(1e-3),
        BY_EDGES,
        every=1,
    ),
    Arrives(
        "cells, paraxial, by all ways",
        "chirps that are sampled, and integrals that aren't",
        cells(2e-2, paraxial=True),
        BY_FRESNEL,
        every=2,
    ),
    # Samples
    *(
        Arrives(
            f"{source[0]}x{source[1]} samples to {target[0]}x{target[1]}",
            "a swapped fftshift shows for odd sizes only, half a sample for even ones",
            reshaped(source, target),
            BY_WAVES,
            every=2,
        )
        for source, target in (((71, 74), (8, 9)), ((74, 71), (9, 8)), ((75, 75), (15, 15)),
                               ((74, 74), (14, 14)))
    ),
    Arrives(
        "samples finer than a wavelength",
        "the root of a negative number is NaN at half of the frequencies",
        replace(BEAM, distance=5e-6, target=Plane((7, 8), (0.5e-6, 0.6e-6), (1e-7, 0.0))),
        BY_HANKEL,
        every=2,
    ),
    Arrives(
        "a target of ten nanometres",
        "a hundredth of the finest fringe",
        replace(BEAMS, target=Plane((5, 4), (1e-8, 1e-8), (7e-6, -4e-6))),
        BY_WAVES,
        every=1,
    ),
    Arrives(
        "a target fifteen times coarser one way",
        "one pitch for both axes is the usual assumption",
        replace(BEAMS, target=Plane((10, 3), (0.6e-6, 9e-6), (4e-6, -5e-6))),
        BY_WAVES,
        every=1,
    ),
    Arrives(
        "one sample of a target",
        "no neighbours, no frequencies",
        replace(BEAMS, target=Plane((1, 1), (1e-6, 1e-6), (6e-6, -5e-6))),
        BY_WAVES,
        every=1,
    ),
    *(
        Arrives(
            f"one cell, {'paraxial' if paraxial else 'scalar'}",
            "an axis of length 1 on both sides",
            cells(1e-3, Plane((1, 1), (1e-6, 1e-6), (2e-5, 0.0)), Plane((1, 1), (10e-6, 10e-6)),
                  (9e-6, 8e-6), paraxial=paraxial),
            BY_FRESNEL if paraxial else BY_EDGES,
            every=1,
        )
        for paraxial in (False, True)
    ),
    Arrives(
        "cells smaller than a wavelength",
        "most of their light grazes, or dies at once",
        cells(3e-6, Plane((5, 6), (1e-6, 1.5e-6)), Plane((6, 5), (0.3e-6, 0.4e-6)),
              (0.3e-6, 0.35e-6)),
        BY_EDGES,
    ),
    Arrives(
        "cells that are nearly all gap",
        "a thousandth of the area, over hundreds of orders",
        cells(1e-2, orders(1e-2, 3.0), sides=(0.3e-6, 0.2e-6), paraxial=True),
        BY_FRESNEL,
    ),
    # Steep light
    Arrives(
        "fringes finer than two samples",
        "the carrier is aliased: without its name the light goes the other way",
        fringes(2.5e-6, 3.4e5),
        BY_WAVES,
        every=1,
    ),
    Arrives(
        "fringes of nine samples",
        "a tilt that splits in two at some numbers of samples",
        fringes(1e-6, 1.1e5, 4.5e5),
        BY_WAVES,
        every=2,
    ),
    Arrives(
        "light at 50 degrees",
        "the transfer function's phase is steepest where it ends",
        cells(2e-4, Plane((5, 6), (5e-6, 6e-6), (1.7e-4, -1.7e-4)), Plane((4, 5), (3e-6, 2e-6)),
              (3e-6, 2e-6)),
        BY_EDGES,
    ),
    Arrives(
        "the far corner of a wide window",
        "nodes that suffice on the axis are too few in the corner",
        cells(1e-3, Plane((4, 4), (8e-6, 8e-6), (6e-4, 6e-4))),
        BY_EDGES,
        every=1,
    ),
    Arrives(
        "a far corner, paraxial",
        "the chirp turns by a wave from sample to sample",
        cells(1e-3, Plane((4, 4), (8e-6, 8e-6), (6e-4, 6e-4)), paraxial=True),
        BY_FRESNEL,
        every=1,
    ),
    Arrives(
        "a hundred windows aside",
        "what is centred on the axis has to reach that far",
        cells(0.1, Plane((4, 5), (1e-5, 1e-5), (5e-3, -4e-3)), paraxial=True),
        BY_FRESNEL,
        every=1,
    ),
    # Copies
    Arrives(
        "the third order of cells",
        "spectra repeat; light doesn't: under the envelope of a cell it is a tenth",
        cells(5e-2, orders(5e-2, 3.0), paraxial=True),
        BY_FRESNEL,
        every=1,
    ),
    Arrives(
        "a target wider than the spectrum's copies",
        "nine spots for one: the same light again at every period of the transform",
        replace(BEAMS, distance=2e-3, paraxial=True,
                target=Plane((9, 10), (3e-4, 3e-4), SOURCE.centre)),
        BY_FORM,
        every=1,
    ),
    Arrives(
        "one lit cell in a corner, seen opposite",
        "what wraps around comes out there, where hardly any light is",
        cells(3e-4, Plane((3, 3), (8e-6, 8e-6), (-1e-4, 1e-4)),
              Plane((12, 13), (16e-6, 16e-6)), (16e-6, 16e-6), corner(12, 13)),
        BY_EDGES,
        every=1,
    ),
    Arrives(
        "one lit cell in a corner, seen opposite, paraxial",
        "the same for a Fresnel transfer function",
        cells(3e-4, Plane((3, 3), (8e-6, 8e-6), (-1e-4, 1e-4)),
              Plane((12, 13), (16e-6, 16e-6)), (16e-6, 16e-6), corner(12, 13), paraxial=True),
        BY_FRESNEL,
        every=1,
    ),
    # Little light
    *(
        Arrives(
            f"{share} of the light",
            "errors of a transform are shares of all the light, and most of it is elsewhere",
            replace(BEAMS, target=replace(BEAMS.target, centre=(y, 0.0)), paraxial=True),
            BY_FORM,
            tols=tols,
        )
        for share, y, tols in (("a thousandth", 2.1e-5, (SINGLE, DOUBLE)),
                               ("a millionth", 2.9e-5, (SINGLE, 1e-6)))
    ),
    # Tilted targets
    *(
        Arrives(
            f"a plane turned by ({a:g}, {b:g}) rad",
            "each sample has a distance of its own, and a tilt of its own wave",
            replace(BEAMS, distance=z, tilt=(a, b), target=Plane((6, 7), (3e-6, 3e-6), (8e-6, 0.0))),
            BY_WAVES,
            every=1,
        )
        for a, b, z in ((0.3, -0.7, 1e-4), (-1.2, 0.4, -1e-4))
    ),
    Arrives(
        "a turned plane before cells",
        "sharp edges under a tilt",
        cells(1e-3, Plane((5, 4), (9e-6, 8e-6), (2e-5, 0.0)), tilt=(0.5, 0.6)),
        BY_EDGES,
    ),
    Arrives(
        "a turned plane before cells, paraxial",
        "the axial phase of each sample remains",
        cells(1e-3, Plane((5, 4), (9e-6, 8e-6), (2e-5, 0.0)), tilt=(0.5, 0.6), paraxial=True),
        BY_FRESNEL,
    ),
    # On the axis
    *(
        Agrees(
            f"the axis behind {name}",
            "a factor of 2 in the kernel, or an area left out, shows nowhere else as well",
            "radius 20 µm, 0.1 mm on, an edge of 1.2 µm",
            judge="Osterberg and Smith's closed form",
            tols=(SINGLE, DOUBLE, 5e-10) if name == "a disc" else (SINGLE, DOUBLE),
            **on_the_axis(form),
        )
        for name, form in (("a disc", DISC), ("an opaque disc", ARAGO))
    ),
    # Evanescent light
    *(
        Arrives(
            f"a beam of a quarter of a micrometre, {z:g} m on",
            "half of it is evanescent: on the way back it grows by 1e33 elsewhere, then NaN",
            Way(Beam(0.25e-6), EVANESCENT,
                Plane((5, 6), (0.1e-6 + abs(z) / 10, 0.1e-6 + abs(z) / 9)), z,
                settings=_whole(EVANESCENT)),
            BY_HANKEL,
        )
        for z in (1e-7, -1e-7, -1e-6, -1e-5, -1e-4)
    ),
    *(
        Holds(
            f"power after {z:g} m of a quarter of a micrometre",
            "dead light that is brought back to life",
            "waist 0.25 µm, samples of 50 nm",
            grows_not(z),
            "no more than there was",
        )
        for z in (-1e-6, -1e-5, -1e-4, 1e-6)
    ),
    # Laws
    Holds("power of random cells", "sums over a window that grow, or normalise away what is lost",
          "60x60 samples, 1 nm to 1 mm", no_more_light, "no more than there was",
          tols=(SINGLE, 1e-6)),
    Holds("power of smooth light", "the same, where nothing is lost", "128x129 samples",
          all_there, "what there was"),
    Holds("beams stay centred", "a frequency grid that ends on both ends drifts by samples",
          "n even and odd, 1 nm to 10 m", centred, "symmetry"),
    Holds("beams stay round", "half a sample of shift is 8 %", "65x65 samples, there and back",
          turned_alike, "symmetry"),
    Holds("twice as many samples", "answers that depend on N", "64, 128 finer, 128 wider",
          twice_as_fine, "each other"),
    Holds("there and back", "a conjugate forgotten", "0.1 mm", there_and_back,
          "what there was"),
    Holds("two steps are one", "a phase left out along the way", "30 and 70 µm",
          in_two_steps, BY_WAVES),
    Holds("adjoints of all ways", "a conjugate, or an area, on one side only",
          "smooth light and cells, there and back", adjoint, "the dot test"),
    Holds("all lengths scaled", "a criterion with a unit: 7272 mm for a distance",
          "times 1e-4, 1e3 and 1e6", scaled, "the same method, the same field"),
    Holds("the declared pitch", "n samples from end to end are L / (n - 1) apart",
          "1 to 65 samples", declared_pitch, "its definition", tols=ONCE),
    Holds("single and double precision at a metre", "a hidden downcast: x64 is as bad as x32",
          "two beams, 1 m", precisions, f"each other, and {BY_SPACE}", tols=ONCE),
    Holds("two models of a fine beam", "paraxial light that is called exact",
          "waist 2 µm, 0.1 and 1 mm", two_models, BY_HANKEL, tols=(1e-4,)),
    # Fields of all kinds
    Holds("a dark field, by all ways", "0 / 0 of shares, in value and gradient",
          "smooth light and cells", nothing, "zero, in value and gradient"),
    Holds("a dark field among bright ones", "the least share of a batch is 0 / 0",
          "amplitudes 1, 0 and 1e-20", one_of_three_dark, "each alone"),
    Holds("a field of 1e-25", "its square is zero in single precision", "amplitude 1e-25",
          strength(1e-25), "amplitude 1, scaled"),
    Holds("a field of 1e25", "its square is infinite in single precision", "amplitude 1e25",
          strength(1e25), "amplitude 1, scaled"),
    Holds("samples kept in unusual ways", "strides, conjugates and byte orders",
          "transposed, conjugated, read-only, real …", kept_unusually,
          "the same numbers, plainly kept"),
    Holds("arrays on the way back", "a conjugate that torch only marks and numpy can't read",
          "cells and smooth light, -1 and -0.1 mm", arrays_back, "arrays"),
    Holds("autocast in free space", "eight bits for a phase of a million radians",
          "torch.autocast, bfloat16", mixed_precision, "the same outside"),
    # Derivatives
    Holds("a frequency of exactly 1 / wavelength", "the root of 0 has an infinite derivative",
          "grazing, nearly, and beyond", grazing, "finite", tols=ONCE),
    *(
        Rates(f"lengths of {name}", why, way, judge)
        for name, why, way, judge in (
            ("two beams", "a transfer function's derivative grows with its phase", BEAMS, BY_WAVES),
            ("two paraxial beams", "matrices and chirps, whose widths change as well",
             replace(BEAMS, paraxial=True), BY_FORM),
            ("two beams on their way back", "the sign of z is in the phase, not in the decay",
             replace(BEAMS, distance=-1e-4), BY_WAVES),
            ("cells", "sharp edges under a kernel", few_cells(), BY_EDGES),
            ("paraxial cells", "Fresnel integrals at both ends of a cell",
             few_cells(paraxial=True), BY_FRESNEL),
            ("a turned plane", "the waves' places on the plane change with the wavelength",
             replace(BEAMS, distance=2e-4, tilt=(0.3, -0.7),
                     target=Plane((2, 2), (6e-6, 6e-6), (8e-6, 0.0))), BY_WAVES),
            ("evanescent light", "-inf at the grazing wave elsewhere, or NaN behind a masked root",
             Way(Beam(0.25e-6), EVANESCENT, Plane((3, 4), (0.3e-6, 0.3e-6), (0.2e-6, 0.0)), -5e-7,
                 settings=_whole(EVANESCENT)), BY_HANKEL),
        )
    ),
    Rates(
        "lengths of a metre's way", "phases of 500 rad, whose derivatives have as many",
        replace(beams_at(1.0, paraxial=False), target=Plane((2, 3), (7e-3, 9e-3))), BY_SPACE,
        share=2e-3,
    ),
    Holds("two backward passes through free space", "what the first kept has lost its graph",
          "distance and field, twice", two_steps, "each other"),
    *(
        Holds(f"an optimiser moves free space's {name}", "a plan was made for the old number",
              f"{low:g} to {high:g} m, in place", moved(name, low, high),
              "the new number's field, or a refusal")
        for name, low, high in (("distance", 1e-4, 1.2e-4), ("wavelength", 550e-9, 500e-9),
                                ("target's centre", 0.0, 4e-6))
    ),
    Holds("five steps of descent through cells", "a wrong sign or scale shows at once",
          "SGD on a phase, 1 mm", descends, "a falling loss"),
    Holds("no graph in free space where none is wanted", "what no_grad() made must not be kept",
          "torch.no_grad(), then without", without_a_graph, "the same numbers"),
    # Refusals
    refused(
        "fringes that the samples don't hold",
        "a lens' phase, sampled too coarsely, is accepted elsewhere: 99 % off, no warning",
        "a 60 µm beam behind a lens of 0.2 mm, 2 µm samples",
        lambda: lens(2e-6), "outside carrier ± band .* Sample it finer", lambda tol: lens(0.25e-6),
    ),
    refused(
        "a tilt that nobody announced",
        "0.45 cycles a sample: what comes of it depends on N",
        "carrier left out",
        lambda: replace(fringes(1e-6, 4.5e5), settings={}).operator(SINGLE)(
            fringes(1e-6, 4.5e5).field),
        "outside carrier ± band .* carrier=",
        lambda tol: fringes(1e-6, 4.5e5).operator(SINGLE)(fringes(1e-6, 4.5e5).field),
    ),
    refused(
        "a field that its plane cuts off",
        "its copies next door are what an FFT shows there",
        "waist 6 µm on 24 µm",
        wide_open, "doesn't vanish at the source's edges", lambda tol: wide_open(n=64),
    ),
    *(
        refused(
            f"free space without memory: {name}",
            "allocating first and failing then takes the machine along",
            given, ask, "MB|memory", remedy,
        )
        for name, given, ask, remedy in (
            ("a huge target", "60x60 to 1e6 x 1e6 samples", lambda: huge(60, 10**6),
             lambda tol: huge(60, 10)),
            ("a huge source", "1e6 x 1e6 samples", lambda: huge(10**6, 60),
             lambda tol: huge(60, 60)),
            ("huge cells", "1e6 x 1e6 cells", lambda: huge(10**6, 60, cells=(1e-6, 1e-6)),
             lambda tol: huge(60, 60, cells=(1e-6, 1e-6))),
            ("huge, paraxial", "1e6 x 1e6 samples", lambda: huge(10**6, 60, paraxial=True),
             lambda tol: huge(60, 60, paraxial=True)),
            ("huge and tilted", "60x60 to 1e5 x 1e5",
             lambda: huge(60, 10**5, tilt=(0.01, 0.0), distance=1.0),
             lambda tol: huge(60, 20, tilt=(0.01, 0.0))),
        )
    ),
    refused(
        "a target that gets no light",
        "a relative error of nothing",
        "a beam of 6 µm, 0.1 mm beside it",
        lambda: dark(1.2e-4), "hardly any light|none of the field's light",
        lambda tol: dark(1e-5),
    ),
    refused(
        "free space to a tolerance below rounding",
        "float64 ends at 1e-16",
        "tol 1e-15",
        lambda: BEAMS.operator(1e-15), "tol 1e-15 can't be kept",
        lambda tol: BEAMS.operator(tol)(BEAMS.field),
    ),
    *(
        refused(
            f"free space with {name}",
            "NaN passes every comparison that is written the wrong way round",
            name, ask, words,
        )
        for name, ask, words in (
            ("a distance of 0 m", lambda: replace(BEAMS, distance=0.0).operator(SINGLE),
             "distance is 0 m"),
            ("a distance of NaN", lambda: replace(BEAMS, distance=math.nan).operator(SINGLE),
             "distance is nan"),
            ("an infinite distance", lambda: replace(BEAMS, distance=math.inf).operator(SINGLE),
             "distance is inf"),
            ("a wavelength of 0 m", lambda: replace(BEAMS, wavelength=0.0).operator(SINGLE),
             "wavelength is 0"),
            ("a wavelength of NaN", lambda: replace(BEAMS, wavelength=math.nan).operator(SINGLE),
             "wavelength is nan"),
            ("a tolerance of NaN", lambda: BEAMS.operator(math.nan), "tol is nan"),
            ("a tolerance of 0", lambda: BEAMS.operator(0.0), "tol is 0"),
            ("cells wider than their pitch",
             lambda: huge(60, 60, cells=(2e-6, 1e-6)), "cells are 2e-06 m wide"),
            ("a band beyond the samples", lambda: huge(60, 60, band=(6e5, 1e5)),
             "band is 600000|band is 6e"),
            ("a target turned through the source",
             lambda: replace(BEAMS, tilt=(1.5, 0.0), distance=1e-6).operator(SINGLE),
             "on the other side|through the source's plane"),
            ("a target seen edge-on", lambda: replace(BEAMS, tilt=(1.6, 0.0)).operator(SINGLE),
             "must face the source"),
            ("a method that nobody has", lambda: BEAMS.operator(SINGLE, "FFT"),
             "method is 'FFT'; choose one of angular spectrum"),
            ("a method for another question", lambda: cells(1e-3).operator(SINGLE, METHODS[0]),
             "serves smooth fields"),
            ("NaN among the samples",
             lambda: BEAMS.operator(SINGLE)(torch.full(SOURCE.shape, math.nan)),
             "field has 5400 NaN"),
            ("a transposed field", lambda: BEAMS.operator(SINGLE)(BEAMS.field.T),
             r"field is \(75, 72\)"),
        )
    ),
]  # fmt: skip
