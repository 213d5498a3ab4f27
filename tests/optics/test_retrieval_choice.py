"""retrieve(): every method by name, the choice among them, budgets, refusals, progress."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest
import torch
from judges.retrieval import (
    WAVELENGTH,
    camera,
    dots,
    light,
    merits,
    quantised,
    ring,
    seeded,
    stop_share,
    tensor,
)

from optics.accuracy import MachineSpeed
from optics.progress import Cancelled, Progress
from optics.retrieval import METHODS, RetrievalResult, design_plane, retrieve
from optics.retrieval.goal import RetrievalGoal

SHAPE, WINDOW, LENGTH, DIAMETER = (55, 64), (61, 54), 128, 52.0
CAMERA = camera(SHAPE, DIAMETER)
SLOW = camera(SHAPE, DIAMETER, response_time=5e-3)
PLANE = design_plane(CAMERA, WAVELENGTH, WINDOW)
RING = ring(WINDOW, 18, 2.5)
DOTS = dots(WINDOW, [(-20, -9), (4, 22), (18, -15), (3, 1)], 1.2)

SNAIL = MachineSpeed(fft=1e-4)
"""A machine so slow that few iterations fit into any budget."""


def solve(method=None, frames=1, optics=CAMERA, target=None, seed=1, **options) -> RetrievalResult:
    if target is None:
        target = tensor(DOTS if method == "weighted" else RING)
    return retrieve(
        optics, target, PLANE, WAVELENGTH, method=method, frames=frames,
        generator=seeded(seed), **options,
    )  # fmt: skip


def served(method: str) -> int:
    """A number of frames that a method serves, more than one if it can."""
    return 3 if METHODS[method].serves(3) else 1


@pytest.mark.parametrize("method", METHODS)
def test_every_method_sends_the_light_to_its_target(method):
    frames = served(method)
    found = solve(method, frames, iterations=20)
    assert (found.method, found.iterations) == (method, 20)
    assert found.phases.shape == (frames, *SHAPE)
    assert found.phases.dtype == torch.float32
    assert torch.isfinite(found.phases).all()
    assert found.orders == (3 if method == "responding" else 1)
    assert found.cpu_seconds > 0
    # The dots are smaller than the stop's Airy disc.
    assert found.quality.steered_share > (0.4 if method == "weighted" else 0.75)


@pytest.mark.parametrize(
    ("method", "frames"), [(m, n) for m in METHODS for n in (1, 3) if METHODS[m].serves(n)]
)
def test_the_quality_is_that_of_the_rounded_pattern(method, frames):
    """By numpy: 256 levels over 6.7 pi, whole FFTs, a stop of 40 x 40 points a pixel."""
    found = solve(method, frames, iterations=8)
    shown = quantised(found.phases.double().numpy(), orders=found.orders)
    target = DOTS if method == "weighted" else RING
    truth = merits(light(shown, LENGTH, WINDOW, stop_share(SHAPE, DIAMETER)), target)
    quality = (found.quality.steered_share, found.quality.contrast, found.quality.nrmse)
    assert quality == pytest.approx(truth, rel=5e-3)


def test_few_levels_are_judged_as_few():
    coarse = camera(SHAPE, DIAMETER, levels=12)
    found = solve(optics=coarse, iterations=30)
    shown = quantised(found.phases.double().numpy(), levels=12)
    truth = merits(light(shown, LENGTH, WINDOW, stop_share(SHAPE, DIAMETER)), RING)
    assert found.quality.contrast == pytest.approx(truth[1], rel=5e-3)
    assert found.quality.contrast > 1.2 * solve(iterations=30).quality.contrast


# Chance


@pytest.mark.parametrize("method", METHODS)
def test_the_generator_alone_decides(method):
    """The same bits from the same seed, others from another, and no other chance is touched."""
    before = torch.get_rng_state()
    options = {"frames": served(method), "iterations": 3}
    first, again, other = (solve(method, seed=seed, **options) for seed in (7, 7, 8))
    assert torch.equal(first.phases, again.phases)
    assert first.quality == again.quality
    assert not torch.equal(first.phases, other.phases)
    assert torch.equal(torch.get_rng_state(), before)


def test_a_quadratic_start_needs_no_chance():
    first, other = (solve(seed=s, iterations=3, start="quadratic") for s in (7, 8))
    assert torch.equal(first.phases, other.phases)


# The choice


@pytest.mark.parametrize(
    ("optics", "frames", "method"),
    [
        (CAMERA, 1, "over-compensated"),
        (CAMERA, 2, "joint"),
        (SLOW, 1, "over-compensated"),
        (SLOW, 2, "responding"),
    ],
)
def test_without_a_budget_the_quick_method_serves(optics, frames, method):
    assert solve(frames=frames, optics=optics, iterations=2).method == method


def test_a_large_budget_pays_for_the_descent():
    """On a machine that is slow on paper: fewer iterations of the descent than it has time for."""
    frugal, rich = (solve(budget=seconds, speed=SNAIL) for seconds in (2000, 200_000))
    assert frugal.method == "over-compensated"
    assert rich.method == "descent"
    assert rich.quality.contrast < frugal.quality.contrast


def test_a_slow_crystal_keeps_its_method_whatever_the_budget():
    assert solve(frames=2, optics=SLOW, budget=3000, speed=SNAIL).method == "responding"


@pytest.mark.parametrize("method", METHODS)
def test_a_larger_budget_buys_more_iterations_and_none_is_overdrawn(method):
    frames, goal = served(method), RetrievalGoal(CAMERA, tensor(RING), PLANE, WAVELENGTH)
    way, counts = METHODS[method], []
    for seconds in np.geomspace(1e-2, 1e3, 12):
        count = way.iterations(goal, frames, seconds, MachineSpeed())
        counts.append(count)
        if count >= 1:
            spent = way.seconds(goal, frames, count, MachineSpeed())
            more = way.seconds(goal, frames, count + 1, MachineSpeed())
            assert spent <= seconds * (1 + 1e-9)
            assert more > seconds * (1 - 1e-9)
    assert counts == sorted(counts)
    assert counts[-1] > 100 * max(counts[3], 1)


def test_a_budget_is_turned_into_iterations():
    found = [solve("joint", 2, budget=seconds, speed=SNAIL) for seconds in (2000, 4000, 8000)]
    counts = [each.iterations for each in found]
    assert counts[0] < counts[1] < counts[2]
    assert counts[2] < 6 * counts[0]


def test_a_faster_machine_does_more_for_the_same():
    fast, slow = (
        solve("gerchberg-saxton", budget=1000, speed=replace(SNAIL, fft=f)) for f in (5e-5, 1e-4)
    )
    assert fast.iterations > slow.iterations


@pytest.mark.parametrize("method", [None, *METHODS])
def test_a_budget_that_is_too_small_says_how_much_is_enough(method):
    frames = served(method) if method else 1
    with pytest.raises(ValueError, match=r"budget is 0\.0001 s; .* allow more") as caught:
        solve(method, frames, budget=1e-4, speed=SNAIL)
    advised = float(re.search(r"1 iteration of .* takes about (\S+) s", str(caught.value))[1])
    found = solve(method, frames, budget=advised, speed=SNAIL)
    assert found.iterations >= 1
    with pytest.raises(ValueError, match=r"allow more"):
        solve(method, frames, budget=0.9 * advised, speed=SNAIL)


# Targets as they come


@pytest.mark.parametrize(
    "dress",
    [
        lambda t: t,
        lambda t: t.astype(">f4"),
        lambda t: np.flipud(np.flipud(t).copy()),
        lambda t: np.asfortranarray(t),
        lambda t: torch.from_numpy(t).requires_grad_(),
        lambda t: torch.from_numpy(t).to(torch.float32),
    ],
)
def test_arrays_of_any_dress_are_taken(dress):
    plain = solve(target=tensor(RING), iterations=4)
    found = solve(target=dress(RING), iterations=4)
    assert isinstance(found.phases, torch.Tensor)
    assert not found.phases.requires_grad
    apart = torch.remainder(found.phases - plain.phases + math.pi, 2 * math.pi) - math.pi
    assert float(apart[:, 20:40, 20:40].abs().max()) < 1e-2


def test_a_read_only_array_of_whole_numbers_is_taken():
    whole = np.round(200 * RING).astype(np.uint8)
    whole.flags.writeable = False
    assert solve(target=whole, iterations=20).quality.steered_share > 0.8


# Refusals


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"frames": 0}, r"frames is 0; a pattern has one"),
        ({"frames": -2}, r"frames is -2; a pattern has one"),
        ({"frames": 4000}, r"frames is 4000; .* a video 3600 at most"),
        ({"budget": 1.0, "iterations": 3}, r"budget and iterations are both given; give one"),
        ({"budget": 0.0}, r"budget is 0 s; it must be positive"),
        ({"budget": -1.0}, r"budget is -1 s; it must be positive"),
        ({"budget": math.nan}, r"budget is nan s; it must be positive and finite"),
        ({"budget": math.inf}, r"budget is inf s; it must be positive and finite"),
        ({"iterations": 0}, r"iterations is 0; at least 1 is needed"),
        ({"method": "magic"}, r"method is 'magic'; choose one of published, gerchberg-saxton, .*"),
        (
            {"method": "mixed-region", "frames": 2},
            r"'mixed-region'; for 2 frames choose one of",
        ),
        ({"method": "responding", "frames": 1}, r"'responding'; for 1 frame choose"),
        ({"method": "weighted"}, r"the target has a part \d+ samples wide"),
        ({"start": "flat"}, r"start is 'flat'; choose one of smooth"),
        ({"start": "flat", "frames": 3}, r"start is 'flat'; choose one of smooth"),
        ({"target": np.full(WINDOW, math.nan)}, r"target must be finite"),
        ({"target": -RING}, r"nowhere negative"),
        ({"target": 0 * RING}, r"somewhere positive"),
        ({"target": RING[1:]}, r"target is \(60, 54\); its plane has \(61, 54\)"),
    ],
)
def test_what_cannot_be_asked_for_is_refused_by_name(options, words):
    options = {"target": tensor(RING), **options}
    with pytest.raises(ValueError, match=words):
        solve(**options)


def test_a_wavelength_beyond_the_panels_table_is_refused():
    """Before anything is computed."""
    plane, heard = design_plane(CAMERA, 1200e-9, WINDOW), []
    with pytest.raises(ValueError, match=r"wavelength 1200 nm is outside the panel's table"):
        retrieve(
            CAMERA, tensor(RING), plane, 1200e-9, iterations=9, generator=seeded(),
            progress=Progress(lambda fraction, message: heard.append(message)),
        )  # fmt: skip
    assert heard == []


@pytest.mark.parametrize("frames", [1, 2])
def test_a_panel_of_less_than_a_wave_is_refused(frames):
    weak = camera(SHAPE, DIAMETER, max_phase=((WAVELENGTH, 1.5 * math.pi),), response_time=5e-3)
    progress = Progress()
    # Whoever computes first is cancelled.
    progress.cancel()
    with pytest.raises(ValueError, match=r"reaches 1\.50 pi .* needs 2 pi; choose a shorter"):
        solve(optics=weak, iterations=9, frames=frames, progress=progress)


# Progress


@pytest.mark.parametrize("method", METHODS)
def test_progress_runs_from_nothing_to_all(method):
    heard = []
    progress = Progress(lambda fraction, message: heard.append((fraction, message)))
    solve(method, served(method), iterations=5, progress=progress)
    fractions = [fraction for fraction, _ in heard]
    assert fractions == sorted(fractions)
    assert fractions[0] < 0.3
    assert fractions[-1] == 1
    assert len(fractions) >= 5
    assert all(message for _, message in heard)


@pytest.mark.parametrize("method", METHODS)
def test_every_method_can_be_cancelled_inside(method):
    """At the third report no more than the step that is under way is finished."""
    heard = []

    def listen(fraction: float, message: str) -> None:
        heard.append(fraction)
        if len(heard) == 3:
            progress.cancel()

    progress = Progress(listen)
    with pytest.raises(Cancelled):
        solve(method, served(method), iterations=40, progress=progress)
    assert len(heard) == 3
    assert heard[-1] < 0.5
