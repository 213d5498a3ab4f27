"""Searches for patterns of several depths: dull starts, darkness, broken steps, few numbers."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
import torch

from hard_cases.depth_waves import CAMERA, KINDS, WAVELENGTH, complex_of
from hard_cases.table import (
    DOUBLE,
    ONCE,
    SINGLE,
    Case,
    Holds,
    Refused,
    require_close,
    require_finite,
)
from optics.camera import Camera, Panel
from optics.edof import (
    NATURAL_SPECTRUM,
    FullTransfer,
    QuarterTransfer,
    SearchSettings,
    SearchState,
    TransferDesign,
    design_pattern,
    random_dioptres,
    rate_pattern,
)
from optics.edof.parametrisation import RadialPhase
from optics.edof.pattern_search import MOST_FAILURES
from optics.edof.spectral_criterion import (
    blind_error,
)

SMALL = replace(CAMERA, panel=Panel((16, 20), 160e-6, unmodulated=0.0))
"""At half a metre the corner of its panel is 8 waves out of focus."""

RANGE = (0.0, 2.0)
FEW = SearchSettings(parts=8, warm_up=3)


def transfer_of(
    kind: Any, camera: Camera = SMALL, reach: int = 24, dtype: torch.dtype = torch.complex64
) -> Any:
    return kind(TransferDesign(camera, WAVELENGTH, 16, reach=reach), dtype)


def search(transfer: Any, steps: int, **given: Any) -> Any:
    """A search from a flat pattern, unless told otherwise."""
    start = given.pop("start", torch.zeros(transfer.shape))
    settings = {"noise": 0.01, "depth_range": RANGE, "settings": FEW} | given
    return design_pattern(
        transfer,
        start,
        NATURAL_SPECTRUM.on_grid(transfer.grid),
        settings.pop("noise"),
        steps=steps,
        generator=torch.Generator().manual_seed(1),
        **settings,
    )


def require_a_gain(transfer: Any, found: Any, noise: float, least: float = 0.3) -> None:
    """Better than the start at depths that the search hasn't seen, in dB."""
    require_finite(found.phase)
    assert found.skipped == 0
    spectrum = NATURAL_SPECTRUM.on_grid(transfer.grid)
    others = random_dioptres(20, torch.Generator().manual_seed(2), RANGE)
    start = torch.zeros(transfer.shape)
    before, after = (
        rate_pattern(transfer, phase, spectrum, noise, others).blind
        for phase in (start, found.phase)
    )
    assert after - before > least


# Where there is no light, and no noise

CHEQUERED = torch.from_numpy(math.pi * (np.indices(SMALL.panel.shape).sum(0) % 2))


def dark_window(tol: float) -> None:
    """All light goes to the corners of the order: nothing is restored, and a search goes on."""
    transfer = transfer_of(FullTransfer, reach=3, dtype=complex_of(tol))
    spectrum = NATURAL_SPECTRUM.on_grid(transfer.grid)
    phase, near = CHEQUERED.clone().requires_grad_(), (0.0, 1e-3)
    error = blind_error(transfer(phase, near), spectrum, transfer.grid.shares(), 0.01)
    error.backward()
    variance = float((transfer.grid.shares() * spectrum).sum())
    assert abs(float(error.detach()) / variance - 1) < 1e-6
    require_finite(phase.grad)
    assert rate_pattern(transfer, CHEQUERED, spectrum, 0.0, near).light < 1e-5
    found = search(transfer, 3, start=CHEQUERED, depth_range=near)
    require_finite(found.phase)
    assert found.skipped == 0


def without_noise(tol: float) -> None:
    """The noise has a floor, and the search a gain."""
    transfer = transfer_of(QuarterTransfer, dtype=complex_of(tol))
    require_a_gain(transfer, search(transfer, 20, noise=0.0), 0.0)


# Searches


def far_and_near(tol: float) -> None:
    """Every step draws one depth at infinity's side and one at half a metre's."""
    for kind in KINDS.values():
        transfer = transfer_of(kind, dtype=complex_of(tol))
        for criterion in ("blind", "known"):
            found = search(
                transfer,
                2,
                criterion=criterion,
                settings=SearchSettings(parts=2, depths=2, warm_up=1),
            )
            require_finite(found.phase)
            assert found.skipped == 0
            assert float(found.phase.abs().max()) > 0


def from_a_flat_pattern(focus: float, steps: int) -> Callable[[float], None]:
    def law(tol: float) -> None:
        """The steps are finite, and the pattern gets better at other depths."""
        camera = replace(SMALL, lens=replace(SMALL.lens, focus_distance=focus))
        transfer = transfer_of(QuarterTransfer, camera, dtype=complex_of(tol))
        require_a_gain(transfer, search(transfer, steps), 0.01)

    return law


def slope_at_a_flat_pattern(tol: float) -> None:
    """In focus at the middle of the depths, by symmetry, zero; elsewhere it isn't."""
    sizes = []
    for focus, dioptres in ((math.inf, (0.25, 1.75)), (1.0, (0.25, 1.75)), (1.0, (1.75,))):
        camera = replace(SMALL, lens=replace(SMALL.lens, focus_distance=focus))
        transfer = transfer_of(QuarterTransfer, camera, dtype=complex_of(tol))
        phase = torch.zeros(transfer.shape, dtype=torch.float64, requires_grad=True)
        spectrum, shares = NATURAL_SPECTRUM.on_grid(transfer.grid), transfer.grid.shares()
        blind_error(transfer(phase, dioptres), spectrum, shares, 0.01).backward()
        assert phase.grad is not None
        sizes.append(float(phase.grad.norm()))
    assert sizes[0] > 0.1 * sizes[2] > 0
    assert sizes[1] <= tol * sizes[2]


class Noted(QuarterTransfer):
    """Notes the depths of every step that is asked for its gradient."""

    def __call__(self, phase: torch.Tensor, dioptres: Any) -> torch.Tensor:
        if phase.requires_grad and torch.is_grad_enabled():
            self.__dict__.setdefault("noted", []).append(tuple(dioptres))
        return super().__call__(phase, dioptres)


def every_part_is_drawn(tol: float) -> None:
    """Eight parts, two a step: after four steps each part once, the last one too."""
    for criterion in ("blind", "known"):
        transfer = transfer_of(Noted)
        search(transfer, 12, criterion=criterion)
        assert len(transfer.noted) == 12
        for turn in range(3):
            drawn = [d for step in transfer.noted[4 * turn : 4 * turn + 4] for d in step]
            assert sorted(int(d / (RANGE[1] / 8)) for d in drawn) == list(range(8))


def broken_steps(broken: Callable[[torch.Tensor], torch.Tensor]) -> Callable[[float], None]:
    def law(tol: float) -> None:
        """Two steps are counted and change nothing; the search goes on."""
        seen: list[torch.Tensor] = []

        def pattern(parameters: torch.Tensor) -> torch.Tensor:
            if not torch.is_grad_enabled():
                return parameters
            seen.append(parameters.detach().clone())
            return broken(parameters) if len(seen) in (3, 4) else parameters

        found = search(transfer_of(QuarterTransfer), 8, pattern=pattern)
        assert found.skipped == 2
        require_finite(found.phase)
        changed = [not torch.equal(a, b) for a, b in pairwise(seen)]
        assert changed == [True, True, False, False, True, True, True]

    return law


def broken_for_good(broken: Callable[[torch.Tensor], torch.Tensor]) -> Callable[[float], None]:
    def law(tol: float) -> None:
        """After five such steps in a row there is an error, and the state is as it was."""
        seen: list[torch.Tensor] = []

        def pattern(parameters: torch.Tensor) -> torch.Tensor:
            if not torch.is_grad_enabled():
                return parameters
            seen.append(parameters.detach().clone())
            return parameters if len(seen) <= 2 else broken(parameters)

        state = SearchState()
        with pytest.raises(FloatingPointError, match="5 steps in a row had no finite gradient"):
            search(transfer_of(QuarterTransfer), 50, pattern=pattern, state=state)
        assert state.skipped == MOST_FAILURES == 5
        assert len(seen) == 7
        assert state.parameters is not None
        assert torch.equal(state.parameters, seen[2])

    return law


BROKEN: dict[str, Callable[[torch.Tensor], torch.Tensor]] = {
    "NaN": lambda p: p * math.nan,
    # The phase is finite, and the root of zero has an infinite slope.
    "sqrt(0)": lambda p: p + torch.sqrt(p - p.detach()),
}


# Few parameters


def bernstein(parameters: Any, shape: tuple[int, int]) -> Any:
    """One cubic over the radius, by Bernstein's polynomials, from the middle of the pixels."""
    y, x = (np.arange(n) - (n - 1) / 2 for n in shape)
    r = np.hypot(y[:, None], x) / (0.5 * math.hypot(*shape))
    terms = [math.comb(3, k) * r**k * (1 - r) ** (3 - k) for k in range(4)]
    return sum(p * term for p, term in zip(parameters, terms, strict=True)), np.stack(terms)


def four_radial_values(tol: float) -> None:
    """The least number makes one cubic; its gradient is a sum over the pixels."""
    for shape in ((1, 1), (1, 2), (2, 2), (5, 1), (23, 31), (24, 32)):
        radial = RadialPhase(shape, values=4)
        numbers = np.random.default_rng(2).normal(0, 1e4, 4)
        dtype = complex_of(tol).to_real()
        given = torch.from_numpy(numbers).to(dtype).requires_grad_()
        value, terms = bernstein(given.detach().double().numpy(), shape)
        phase = radial.phase(given)
        require_close(phase, value, max(tol**2, 1e-13))
        weights = np.random.default_rng(3).uniform(size=shape)
        (phase * torch.from_numpy(weights).to(dtype)).sum().backward()
        require_close(given.grad, (terms * weights).sum((1, 2)), max(tol**2, 1e-13))


CASES: list[Case] = [
    # Zeros
    Holds("a window without light", "a share of nothing; sqrt(0) in a modulus",
          "a chequered pattern, 7x7 pixels around the axis", dark_window,
          "the variance of the pictures"),
    Holds("a design without noise", "a filter that divides by the OTF", "noise 0, 20 steps",
          without_noise, "a gain at other depths"),
    # Searches
    Holds("infinity and half a metre in one step", "infinity is a depth like others only as 0 "
          "dioptres", "0 to 2 dioptres in two parts, 2 steps", far_and_near, "finite"),
    Holds("a search from a flat pattern", "a start without structure may be a saddle",
          "focus at ∞, 0 to 2 dioptres, 40 steps", from_a_flat_pattern(math.inf, 40),
          "a gain at other depths"),
    Holds("a search from a flat pattern, in focus in the middle",
          "depths on both sides of focus cancel: the mean gradient is zero",
          "focus at 1 dioptre, 0 to 2, 80 steps", from_a_flat_pattern(1.0, 80),
          "a gain at other depths"),
    Holds("the gradient at a flat pattern", "zero by symmetry, or by mistake",
          ".25 and 1.75 dioptres, focus at ∞ and between them", slope_at_a_flat_pattern,
          "symmetry of defocus"),
    Holds("every part of the depths is drawn", "int(u (n - 1)) never reaches the last",
          "8 parts, 2 a step, 12 steps", every_part_is_drawn, "counting", tols=ONCE),
    *(
        Holds(f"two broken steps, {name}", "one NaN in Adam's means is there for ever",
              "steps 3 and 4 of 8", broken_steps(broken), "parameters that stay", tols=ONCE)
        for name, broken in BROKEN.items()
    ),
    *(
        Holds(f"nothing but broken steps, {name}", "a run that goes on for hours and does nothing",
              "from step 3", broken_for_good(broken), "an error after five", tols=ONCE)
        for name, broken in BROKEN.items()
    ),
    # Parameters
    Holds("a radial pattern of four numbers", "knots only at the ends; a single radius",
          "panels of 1x1 to 24x32, phases of 1e4 rad", four_radial_values,
          "Bernstein's polynomials", tols=(SINGLE, DOUBLE)),
    *(
        Refused(f"a radial pattern of {count}", "a cubic has four coefficients", f"values={count}",
                lambda n=count: RadialPhase((24, 32), values=n), r"values is \d+; choose 4 to 192",
                lambda _: RadialPhase((24, 32), values=4).phase(torch.ones(4)))
        for count in (1, 2)
    ),
]  # fmt: skip
