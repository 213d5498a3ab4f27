"""Restoration of several depths where there is neither light nor noise to divide by."""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import numpy as np
import torch
from judges import richardson
from numpy.typing import NDArray

from hard_cases.depth_designs import transfer_of
from hard_cases.depth_protocols import SCENE, SIDE, numbers
from hard_cases.depth_waves import complex_of
from hard_cases.table import (
    DOUBLE,
    SINGLE,
    Agrees,
    Case,
    Holds,
    Refused,
    require_finite,
    require_finite_gradient,
)
from optics.edof import (
    NATURAL_SPECTRUM,
    QuarterTransfer,
    blind_wiener,
    known_depth_wiener,
    no_decoder,
    rate_pattern,
)
from optics.edof.spectral_criterion import (
    LEAST_NOISE,
    blind_error,
    blind_filter,
    filter_error,
    known_depth_error,
)

# Criteria and filters

RNG = np.random.default_rng(6)
SPECTRUM = torch.from_numpy(RNG.uniform(0.1, 1, (4, 3)))
SPECTRUM[0, 0] = 0
SHARES = torch.full((4, 3), 1 / 12, dtype=torch.float64)
PARTLY = torch.from_numpy(RNG.normal(size=(3, 4, 3)) + 1j * RNG.normal(size=(3, 4, 3)))
PARTLY[:, 1] = 0
PARTLY[0, 0, 0] = 0
PARTLY[1, 2] *= 1e-20


def without_light(tol: float) -> None:
    """The whole variance is lost, and the gradient is zero by |0|², not NaN."""
    variance = float((SHARES * SPECTRUM).sum())
    for dtype in (complex_of(tol), complex_of(tol).to_real()):
        for noise in (0.0, 1e-3):
            for error in (blind_error, known_depth_error):
                dark = torch.zeros(2, 4, 3, dtype=dtype, requires_grad=True)
                value = error(dark, SPECTRUM, SHARES, noise)
                value.backward()
                assert abs(float(value.detach()) - variance) <= 1e-12
                assert dark.grad is not None
                assert not dark.grad.any()


def filter_without_noise(tol: float) -> torch.Tensor:
    given = PARTLY.to(complex_of(tol))
    return torch.stack([blind_filter(one[None], SPECTRUM, 0.0) for one in given])


def filter_by_numbers() -> Any:
    """S H* / (S |H|² + floor²), number by number; the mean is kept where there is one."""
    answer = np.zeros((3, 4, 3), dtype=complex)
    for place in np.ndindex(3, 4, 3):
        h, s = complex(PARTLY[place]), float(SPECTRUM[place[1:]])
        answer[place] = h.conjugate() * s / (abs(h) ** 2 * s + LEAST_NOISE**2)
        if place[1:] == (0, 0):
            answer[place] = 1 / h if h else 0
    return answer


def slope_of_a_filter(tol: float) -> None:
    """Through filter and error, at zeros of the OTF and without noise: as differences have it."""
    given = PARTLY.to(complex_of(tol)).requires_grad_()
    total = filter_error(blind_filter(given, SPECTRUM, 0.0), given, SPECTRUM, SHARES, 0.0)
    total.backward()
    direction = torch.from_numpy(np.random.default_rng(1).normal(size=(3, 4, 3)))

    def along(t: float) -> float:
        moved = PARTLY + t * direction
        restoring = blind_filter(moved, SPECTRUM, 0.0)
        return float(filter_error(restoring, moved, SPECTRUM, SHARES, 0.0).detach())

    assert given.grad is not None
    require_finite(torch.view_as_real(given.grad))
    slope = float((given.grad.real.double() * direction).sum())
    assert abs(slope - richardson(along, 0.0, 1e-4)) <= max(tol, 1e-6)


# Decoders

DARK_ROW = np.zeros((3, SIDE, SIDE // 2 + 1), dtype=complex)
DARK_ROW[:, 0] = RNG.uniform(0.2, 1, SIDE // 2 + 1)
"""Transfer functions that are zero but for one row of frequencies."""


def flat_spectrum(n: int) -> torch.Tensor:
    power = torch.ones(n, n // 2 + 1, dtype=torch.float64)
    power[0, 0] = 0
    return power


def decoders_without_light(tol: float) -> None:
    """Finite pictures and gradients, of black captures as well, and without noise."""
    transfers = torch.from_numpy(DARK_ROW)
    for design in (transfers, torch.zeros_like(transfers)):
        for noise in (0.0, 0.01):
            restore = [
                blind_wiener(flat_spectrum).build(design, noise),
                known_depth_wiener(flat_spectrum).build(design[0], noise),
            ]
            if design.any():
                restore.append(no_decoder().build(design, noise))
            for one in restore:
                for scene in (SCENE, 0 * SCENE):
                    capture = numbers(scene, tol)
                    require_finite(one(capture))
                    require_finite_gradient(one, capture)
                assert not one(numbers(0 * SCENE, tol)).any()


def decoded_without_noise(tol: float) -> torch.Tensor:
    """The frequencies that arrive come back, without loss; the others stay dark."""
    transfer = torch.from_numpy(DARK_ROW[0])
    scene = torch.from_numpy(SCENE)
    capture = torch.fft.irfft2(torch.fft.rfft2(scene) * transfer, s=(SIDE, SIDE))
    return known_depth_wiener(flat_spectrum).build(transfer, 0.0)(capture)


def mean_of_columns() -> NDArray[np.float64]:
    return np.broadcast_to(SCENE.mean(0), (SIDE, SIDE)).copy()


# Ratings

ONE_NAN = torch.zeros(8, 10)
ONE_NAN[3, 4] = torch.nan


def rated(phase: Any = None, strength: float = 1.0, dioptres: Any = (0.0, 2.0)) -> Any:
    transfer = transfer_of(QuarterTransfer)
    spectrum = strength * NATURAL_SPECTRUM.on_grid(transfer.grid)
    shown = torch.zeros(transfer.shape) if phase is None else phase
    return rate_pattern(transfer, shown, spectrum, 0.01, dioptres)


CASES: list[Case] = [
    Holds("criteria without any light", "0 / 0, and the slope of |0|", "OTFs of zeros",
          without_light, "the variance of the pictures"),
    Agrees("a filter without noise at zeros of the OTF", "0 / 0 where there is neither light nor "
           "noise, and at zero frequency no spectrum", "rows of zeros, 1e-20 and a zero mean",
           filter_without_noise, filter_by_numbers, "the formula, number by number",
           tols=(1e-4, 1e-10)),
    Holds("the derivative of that filter", "an untaken branch with 1 / 0 gives 0 x inf",
          "filter and error, no noise", slope_of_a_filter, "differences"),
    Holds("decoders without light or noise", "0 / 0 at zeros of the OTF, and for the mean",
          "OTFs of zeros but for a row, or all, noise 0 and .01, black captures",
          decoders_without_light, "finite; black stays black", tols=(SINGLE, DOUBLE)),
    Agrees("a decoder without noise", "1 / H where there is light, and 0 / 0 elsewhere",
           "one row of frequencies, noise 0", decoded_without_noise, mean_of_columns,
           "the means of columns", tols=(1e-6,)),
    # What has no answer
    *(
        Refused(name, why, given, partial(rated, **wrong), words, lambda _: rated().blind)
        for name, why, given, wrong, words in (
            ("a pattern that is NaN somewhere", "its rating is NaN as well, without a word",
             "a pixel of NaN", {"phase": ONE_NAN},
             "phase has 1 NaN or infinite values of 80; give finite numbers"),
            ("pictures without detail", "no error is left: infinitely many dB, and 0 / 0 of scale",
             "a spectrum of zeros", {"strength": 0.0},
             "spectrum has no power; give that of pictures that aren't constant"),
            ("an object at an infinity of dioptres", "inf - inf in the wave", "inf dioptres",
             {"dioptres": (0.0, math.inf)}, "dioptres holds inf dioptres; give 0 \\(infinity\\)"),
            ("no depths", "the mean of nothing", "()", {"dioptres": ()},
             "dioptres is empty; give one depth at least"),
        )
    ),
]  # fmt: skip
