"""Fourier transforms between two planes, by every method that serves."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from judges import direct_transform, positions
from numpy.typing import NDArray

from hard_cases.table import ONCE, Agrees, Case, Holds, Refused, require_close
from optics.accuracy import Budget
from optics.focal_plane import focal_field
from optics.fourier import (
    CommensurateTransform,
    FourierGeometry,
    GriddedTransform,
    NonuniformTransform,
    plan_transform,
    valid_transforms,
)
from optics.plane import Plane, RectilinearGrid

TOLS = (2e-6, 1e-11)
"""Relative L2 errors of fields in single and in double precision."""

BY_SUM = "the sum, term by term"

Field = NDArray[np.complex128]


def dtype_for(tol: float) -> torch.dtype:
    return torch.complex64 if tol > 1e-7 else torch.complex128


def random(shape: tuple[int, ...], seed: int = 0) -> Field:
    rng = np.random.default_rng(seed)
    return rng.normal(size=shape) + 1j * rng.normal(size=shape)


def ways(geometry: FourierGeometry, tol: float) -> list[Any]:
    """Every transform that is valid, the one with an error of its own among them."""
    return valid_transforms(geometry, dtype_for(tol), 1e-7 if tol > 1e-7 else 1e-13)


def every_way(
    name: str,
    hard_because: str,
    pupil: Plane,
    image: Plane,
    scale: float,
    field: Field | None = None,
    **row: Any,
) -> Agrees:
    """All methods at once against the sum."""
    geometry = FourierGeometry(pupil, image, scale)
    given = random(pupil.shape) if field is None else field
    sizes = "{}x{} to {}x{} samples".format(*pupil.shape, *image.shape)
    return Agrees(
        name,
        hard_because,
        f"{sizes}, {geometry.step(0):.3g} and {geometry.step(1):.3g} turns from one to the next",
        lambda tol: torch.stack([way(torch.from_numpy(given)) for way in ways(geometry, tol)]),
        lambda: np.stack([direct_transform(given, pupil, image, scale)] * len(ways(geometry, 1.0))),
        BY_SUM,
        **{"tols": TOLS, **row},
    )


def chirp(n: int) -> Field:
    return np.exp(1j * np.pi / n * (np.arange(n) - n // 2) ** 2)[None, :]


def corner(rows: int, columns: int) -> Field:
    field = np.zeros((rows, columns), dtype=complex)
    field[0, -1] = 1
    return field


def uneven(tol: float) -> torch.Tensor:
    geometry = FourierGeometry(RectilinearGrid(*_ROWS), Plane((5, 4), (3e-4, 2e-4)), 3e-7)
    return torch.stack([way(torch.from_numpy(random((6, 7)))) for way in ways(geometry, tol)])


_ROWS = (torch.linspace(-1, 1, 6).double() ** 3 * 1e-3, torch.linspace(-1, 2, 7).double() * 1e-3)


def by_uneven_sum() -> Field:
    v, u = positions(5, 3e-4), positions(4, 2e-4)
    y, x = (row.numpy() for row in _ROWS)
    rows, columns = (np.exp(-2j * np.pi / 3e-7 * np.outer(a, b)) for a, b in ((v, y), (u, x)))
    return np.stack([rows @ random((6, 7)) @ columns.T] * 2)


def scattered(y: Any, x: Any, image: Plane, scale: float) -> tuple[Callable[..., Any], Any]:
    """finufft on points, and the sum over them."""
    y, x = (np.asarray(a, dtype=float) for a in (y, x))
    field = random(y.shape, 3)

    def ask(tol: float) -> torch.Tensor:
        places = torch.from_numpy(y), torch.from_numpy(x)
        transform = NonuniformTransform(places[0], places[1], image, scale, tol / 10)
        return transform(torch.from_numpy(field))

    def truth() -> Field:
        v, u = (positions(n, p, c) for n, p, c in
                zip(image.shape, image.pitch, image.centre, strict=True))  # fmt: skip
        turn = v[:, None, None] * y + u[:, None] * x
        return np.asarray(np.exp(-2j * np.pi / scale * turn) @ field)

    return ask, truth


RNG = np.random.default_rng(8)
POINTS = RNG.uniform(-9e-3, 9e-3, (2, 60))


def zero_field(tol: float) -> None:
    """Zeros, and a gradient without NaN, from every method."""
    geometry = FourierGeometry(Plane((5, 6), (1e-5, 1e-5)), Plane((4, 3), (1e-5, 2e-5)), 1e-9)
    for way in ways(geometry, tol):
        field = torch.zeros(5, 6, dtype=way.dtype, requires_grad=True)
        answer = way(field)
        (answer.abs() ** 2).sum().backward()
        assert not answer.detach().any()
        assert field.grad is not None
        assert not field.grad.any()


def strides(tol: float) -> None:
    """Transposed, conjugated and expanded fields are the numbers that they show."""
    geometry = FourierGeometry(Plane((5, 6), (1e-5, 1e-5)), Plane((4, 3), (1e-5, 2e-5)), 1e-9)
    plain = torch.from_numpy(random((5, 6)))
    for way in ways(geometry, tol):
        for field in (plain.T.contiguous().T, plain.conj().resolve_conj().conj(),
                      plain.expand(2, 5, 6)[1]):  # fmt: skip
            require_close(way(field), way(plain), 1e-6 if tol > 1e-7 else 1e-14)


def adjoints(tol: float) -> None:
    """<A x, y> = <x, A* y>, off the axis on both sides, odd to even."""
    geometry = FourierGeometry(
        Plane((7, 6), (1e-5, 1.3e-5), (2e-4, -1e-4)),
        Plane((4, 9), (1e-5, 2e-5), (1e-3, 3e-3)),
        1e-9,
    )
    x, y = torch.from_numpy(random((7, 6))), torch.from_numpy(random((4, 9), 1))
    for way in ways(geometry, tol):
        left = torch.sum(way(x).to(torch.complex128).conj() * y)
        right = torch.sum(x.conj() * way.adjoint(y).to(torch.complex128))
        assert abs(complex(left - right)) <= tol * float(way(x).norm() * y.norm())


def nearly_fitting(tol: float) -> None:
    """A step of 1/16 that isn't quite: the FFT of 16 may not be taken."""
    pitch = 1e-9 / (16 * 1e-5) * (1 + 1e-9)
    geometry = FourierGeometry(Plane((40, 40), (1e-5, 1e-5)), Plane((40, 40), (pitch, pitch)), 1e-9)
    assert not CommensurateTransform.is_commensurate(geometry)
    almost = FourierGeometry(geometry.pupil, Plane((40, 40), (pitch / (1 + 1e-9),) * 2), 1e-9)
    assert CommensurateTransform.is_commensurate(almost)


# The focal plane

WAVE, FOCUS = 500e-9, 0.1
GAUSSIAN = Plane((64, 65), (2e-5, 2e-5))
SPOT = Plane((9, 8), (8e-6, 8e-6))
AWAY = Plane((4, 5), (2e-6, 2e-6), (2.4e-2, -2.4e-2))
APERTURE = Plane((6, 7), (1e-6, 1e-6))


def bell(plane: Plane, width: float) -> NDArray[np.float64]:
    y, x = (positions(n, p) for n, p in zip(plane.shape, plane.pitch, strict=True))
    return np.exp(-np.pi / width**2 * (y[:, None] ** 2 + x**2))


def far_from_the_axis(tol: float) -> Any:
    field = random(APERTURE.shape).astype(np.complex64 if tol > 1e-7 else np.complex128)
    return focal_field(field, APERTURE, AWAY, FOCUS, WAVE)


def by_curved_sum() -> Field:
    """The curvature in extended precision, as whole and broken turns."""
    scale = WAVE * FOCUS
    v, u = (positions(n, p, c).astype(np.longdouble) for n, p, c in
            zip(AWAY.shape, AWAY.pitch, AWAY.centre, strict=True))  # fmt: skip
    turns = (v[:, None] ** 2 + u**2) / (2 * np.longdouble(WAVE) * np.longdouble(FOCUS))
    part = (turns - np.rint(turns)).astype(float)
    total = direct_transform(random(APERTURE.shape), APERTURE, AWAY, scale)
    return np.asarray(-1j * np.exp(2j * np.pi * part) * total * 1e-12 / scale)


CASES: list[Case] = [
    every_way(
        "a critically sampled chirp",
        "half a wave of step between neighbours at its ends: the very edge of aliasing",
        Plane((1, 64), (1e-5, 1e-5)), Plane((1, 64), (1e-5, 1e-5)), 64 * 1e-10, chirp(64),
    ),
    every_way(
        "an image coarser than the finest fringe",
        "more than a turn from one sample to the next: the sum is periodic, and so is every method",
        Plane((5, 6), (1e-3, 1e-3)), Plane((7, 4), (1e-3, 1.3e-3)), 3e-7,
    ),
    every_way(
        "an image that is folded three times",
        "an FFT shorter than its input; libraries refuse it, or alias",
        Plane((20, 19), (8e-6, 5e-6)), Plane((9, 10), (1 / 6 / 8e-6 * 1e-9, 1 / 7 / 5e-6 * 1e-9)),
        1e-9,
    ),
    every_way(
        "odd numbers of samples",
        "a swapped fftshift shows for odd sizes only, and only in the phase",
        Plane((7, 9), (8e-6, 5e-6)), Plane((5, 11), (1 / 15 / 8e-6 * 1e-9, 1 / 11 / 5e-6 * 1e-9)),
        1e-9,
    ),
    every_way(
        "one sample on either side",
        "no neighbours, no frequencies: the sum has one term",
        Plane((1, 1), (1e-5, 1e-5)), Plane((1, 1), (1e-5, 2e-5), (1e-5, 3e-5)), 1e-9,
    ),
    every_way(
        "one sample to many",
        "a column becomes a row",
        Plane((2, 1), (1e-5, 1e-5)), Plane((1, 9), (1e-5, 2e-5), (1e-5, 0.0)), 1e-9,
    ),
    every_way(
        "two thousand samples in a line, in single precision",
        "chirps made in single precision are 0.2 to 2 % off at this length",
        Plane((1, 2236), (8e-6, 8e-6)), Plane((1, 64), (3.45e-6, 3.45e-6)), 6.9e-8,
    ),
    every_way(
        "planes a thousand windows off the axis",
        "tilts of 3e4 turns on both sides: single precision leaves a hundredth of one",
        Plane((7, 6), (1e-5, 1.3e-5), (0.05, -0.04)), Plane((5, 8), (4e-6, 3e-6), (0.03, 0.07)),
        6.9e-8, tols=(2e-6, 1e-9),
    ),
    every_way(
        "light in one corner alone",
        "half of every FFT is zero, and what wraps around comes out opposite",
        Plane((8, 9), (1e-5, 1e-5)), Plane((8, 9), (1e-5, 1e-5)), 1e-9, corner(8, 9),
    ),
    Agrees(
        "rows and columns at uneven distances", "no step, no FFT, no chirp",
        "6x7 rows and columns", uneven, by_uneven_sum, BY_SUM, tols=TOLS,
    ),
    Agrees(
        "scattered points and a coarse image",
        "angles of hundreds of turns: libraries take three periods at most",
        "60 points over 18 mm", *scattered(*POINTS, Plane((6, 5), (2e-3, 3e-3)), 5e-8), BY_SUM,
        tols=(1e-6, 1e-10),
    ),
    Agrees(
        "scattered points, all in one place",
        "every point is spread over the same few samples of the grid",
        "60 points in one", *scattered(*(0 * POINTS + 1e-3), Plane((6, 5), (2e-6, 3e-6)), 5e-8),
        BY_SUM, tols=(1e-6, 1e-11),
    ),
    Agrees(
        "one point and one sample", "a grid of one by one",
        "1 point", *scattered([2e-3], [1e-3], Plane((1, 1), (2e-6, 3e-6), (1e-4, 0.0)), 5e-8),
        BY_SUM, tols=(1e-6, 1e-11),
    ),
    Holds("a field of zeros", "0 / 0 of normalisations", "5x6 to 4x3 samples", zero_field,
          "zero, in value and gradient", tols=TOLS),
    Holds("fields kept in unusual ways", "strides and conjugates that scipy doesn't see",
          "transposed, conjugated, expanded", strides, "the same numbers, plainly kept", tols=TOLS),
    Holds("adjoints off the axis", "two tilts, to be conjugated and applied in reverse",
          "7x6 to 4x9 samples", adjoints, "the dot test", tols=TOLS),
    Holds("a step that nearly fits an FFT", "1e-9 of it is a hundredth of a turn at the corners "
          "of large planes", "40x40 samples, 1/16 turn", nearly_fitting, "its definition",
          tols=ONCE),
    Agrees(
        "a bell in a 2f system", "a curvature left over, or a sign of i, shows in no intensity",
        "before = f, 64x65 samples",
        lambda tol: focal_field(
            bell(GAUSSIAN, 2e-4), GAUSSIAN, SPOT, FOCUS, WAVE, distance_before_lens=FOCUS
        ),
        lambda: -1j * bell(SPOT, WAVE * FOCUS / 2e-4) * 4e-8 / (WAVE * FOCUS),
        "a Gaussian's own transform", tols=(1e-9,),
    ),
    Agrees(
        "a focal plane far from the axis",
        "a curvature of 7e4 rad, to be stored in single precision",
        "2.4 cm off at f = 10 cm", far_from_the_axis, by_curved_sum,
        BY_SUM + ", with curvature in extended precision", tols=(2e-6, 1e-9),
    ),
    # Refusals
    Refused(
        "an image plane that sees replicas",
        "the same light shows again, as it does for nine PSFs of a too wide field of view",
        "10 mm at 2.5 mm of resolved light",
        lambda: focal_field(np.ones((64, 65)), GAUSSIAN, Plane((9, 9), (2e-3, 2e-3)), FOCUS, WAVE),
        r"image_plane reaches 0.008 m in y.* pupil_plane's pitch 3.12e-06 m or finer",
        lambda tol: focal_field(
            np.ones((4, 4)), Plane((4, 4), (3.12e-6, 3.12e-6)), Plane((9, 9), (2e-3, 2e-3)), FOCUS,
            WAVE,
        ),
    ),
    *(
        Refused(
            f"a scale of {value:g} m²", "a phase of anything over it is 0, NaN or infinite",
            f"{value:g}", lambda value=value: FourierGeometry(SPOT, SPOT, value),
            "must be positive and finite", lambda tol: FourierGeometry(SPOT, SPOT, 1e-9).step(0),
        )
        for value in (0.0, math.nan, math.inf)
    ),
    Refused(
        "a transform that no memory holds", "allocating first and failing then",
        "1e5 x 1e5 samples",
        lambda: plan_transform(FourierGeometry(Plane((10**5, 10**5), (1e-6, 1e-6)),
                                        Plane((10**5, 10**5), (1e-6, 1e-6)), 1e-9),
                               budget=Budget(memory=1 << 20)),
        r"needs \d+ MB at least and 1 MB are allowed",
        lambda tol: plan_transform(FourierGeometry(SPOT, SPOT, 1e-9))(torch.ones(9, 8)),
    ),
    Refused(
        "gridding below rounding", "a kernel so wide that its own digits are lost",
        "error 1e-15",
        lambda: GriddedTransform(FourierGeometry(SPOT, SPOT, 1e-9), torch.complex128, 1e-15),
        "gridding reaches 1e-13", lambda tol: GriddedTransform(
            FourierGeometry(SPOT, SPOT, 1e-9), torch.complex128, 1e-13)(torch.ones(9, 8)),
    ),
    Refused(
        "a field of another shape", "72 samples either way", "8x9 for 9x8",
        lambda: plan_transform(FourierGeometry(SPOT, SPOT, 1e-9))(torch.ones(8, 9)),
        r"field is \(8, 9\); its plane has \(9, 8\) samples",
        lambda tol: plan_transform(FourierGeometry(SPOT, SPOT, 1e-9))(torch.ones(9, 8)),
    ),
]  # fmt: skip
