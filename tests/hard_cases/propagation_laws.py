"""Free space: symmetries, powers, precisions, fields of all kinds, derivatives."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import torch
from judges import Beam
from judges.fields import Cells
from judges.view import WAVELENGTH

from hard_cases.table import ONCE, SINGLE, Case, Holds, require_close
from hard_cases.ways import (
    BEAM,
    BEAMS,
    BY_EDGES,
    BY_FORM,
    BY_FRESNEL,
    BY_HANKEL,
    BY_SPACE,
    BY_WAVES,
    EVANESCENT,
    FINE,
    PANEL,
    SIDES,
    SOURCE,
    Rates,
    Way,
    accepting,
    beams,
    beams_at,
    cells,
    few_cells,
    random,
    whole,
)
from optics.plane import Plane
from optics.propagation import METHODS, FreeSpace
from optics.propagation.transfer_function import free_space_transfer_function

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
                                **whole(source))  # fmt: skip
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
                  settings=whole(source))  # fmt: skip
        for operator in accepting(way, tol):
            shown = np.asarray(operator(way.light.samples(source)))
            for same in (shown.T, shown[::-1], shown[:, ::-1], np.rot90(shown)):
                assert np.abs(same - shown).max() <= 2 * tol * np.abs(shown).max()


def twice_as_fine(tol: float) -> None:
    """The same beam on half the pitch, and on a plane twice as wide."""
    answers = []
    for n, pitch in ((64, 1e-6), (128, 0.5e-6), (128, 1e-6)):
        source = Plane((n, n), (pitch, pitch))
        light = beams(SOURCE, 5e-6, 3e4).samples(source)
        way = FreeSpace(source, BEAMS.target, 1e-4, WAVELENGTH, tol=tol, band=(4.2e5, 4.2e5))
        answers.append(way(light))
    for answer in answers[1:]:
        require_close(answer, answers[0], 2 * tol)


def there_and_back(tol: float) -> None:
    """Waves that travel come back as they left."""
    wide = Plane((220, 221), (1e-6, 1.1e-6), SOURCE.centre)
    there = replace(BEAMS, target=wide).operator(tol)
    back = FreeSpace(wide, SOURCE, -1e-4, WAVELENGTH, tol=tol, **whole(SOURCE))
    require_close(back(there(BEAMS.field)), BEAMS.field, 2 * tol)


def in_two_steps(tol: float) -> None:
    """30 µm and 70 µm are 100 µm."""
    wide = Plane((160, 161), (1e-6, 1.1e-6), SOURCE.centre)
    first = replace(BEAMS, target=wide, distance=3e-5).operator(tol)
    second = FreeSpace(wide, BEAMS.target, 7e-5, WAVELENGTH, tol=tol, **whole(SOURCE))
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


def grows_not(distance: float) -> Callable[[float], None]:
    def law(tol: float) -> None:
        """Light that died on the way isn't made on the way back."""
        light = Beam(0.25e-6).samples(EVANESCENT)
        pitch = 0.1e-6 + abs(distance) / 20
        target = Plane((41, 41), (pitch, pitch))
        way = FreeSpace(EVANESCENT, target, distance, WAVELENGTH, tol=tol, **whole(EVANESCENT))
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
    for way in (
        BEAMS,
        replace(BEAMS, paraxial=True, distance=1e-2),
        cells(1e-3),
        cells(1e-3, paraxial=True),
    ):
        first = way.operator(tol)
        for s in (1e-4, 1e3, 1e6):
            other = _grown_way(way, s).operator(tol)
            assert other.method == first.method
            require_close(other(way.field), first(way.field), 1e-5 if tol > 1e-7 else 1e-10)


def _grown_way(way: Way, s: float) -> Way:
    """Of the same light: only its cells' sides are looked at."""
    light = way.light
    if isinstance(light, Cells):
        light = replace(light, sides=(s * light.sides[0], s * light.sides[1]))
    return replace(
        way,
        light=light,
        source=_grown(way.source, s),
        target=_grown(way.target, s),
        distance=way.distance * s,
        wavelength=way.wavelength * s,
        settings={name: (pair[0] / s, pair[1] / s) for name, pair in way.settings.items()},
    )


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
                wave = free_space_transfer_function(y, x, distance, wavelength)
                found = torch.autograd.grad(
                    wave.real.sum() + wave.imag.sum(), (distance, wavelength)
                )
                assert all(torch.isfinite(one) for one in found)
                assert torch.isfinite(torch.view_as_real(wave.detach())).all()
                assert float(wave.detach().abs().max()) <= 1 + 1e-15


def two_steps(tol: float) -> None:
    """A second step through one plan has a graph of its own, and the same derivative."""
    for way in (BEAMS, cells(1e-4, paraxial=True)):
        distance = torch.tensor(1e-4, dtype=torch.float64, requires_grad=True)
        operator = replace(way, distance=distance).operator(tol)
        field = way.field.requires_grad_()
        found: list[tuple[float, float]] = []
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


CASES: list[Case] = [
    # Laws
    *(
        Holds(f"power after {z:g} m of a quarter of a micrometre",
              "dead light that is brought back to life", "waist 0.25 µm, samples of 50 nm",
              grows_not(z), "no more than there was")
        for z in (-1e-6, -1e-5, -1e-4, 1e-6)
    ),
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
                 settings=whole(EVANESCENT)), BY_HANKEL),
        )
    ),
    Rates("lengths of a metre's way", "phases of 500 rad, whose derivatives have as many",
          replace(beams_at(1.0, paraxial=False), target=Plane((2, 3), (7e-3, 9e-3))), BY_SPACE,
          share=2e-3),
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
]  # fmt: skip
