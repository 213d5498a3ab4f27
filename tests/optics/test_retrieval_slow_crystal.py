"""Videos on a liquid crystal that moves all the time, against its simulation in small steps."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from judges import positions, relative
from judges.retrieval import (
    REACH,
    WAVELENGTH,
    camera,
    light,
    merits,
    quantised,
    ring,
    seeded,
    tensor,
    whole_far_field,
    window_of,
)
from sweeps import some

from optics.retrieval import design_plane, retrieve
from optics.retrieval.far_field import FarField
from optics.retrieval.goal import RetrievalGoal
from optics.retrieval.slow_crystal import (
    LiquidCrystal,
    crystal_of_goal,
    displayed_psf,
    moving_crystal_intensity,
    shortest_phase_paths,
    usable_orders,
)
from optics.slm import PanelMap, PhaseResponse, grey_to_phase, phase_to_grey

TURN = 2 * math.pi


def by_small_steps(
    phases: np.ndarray, frame_time: float, tau: float, length: int, window, besides=0.0
) -> np.ndarray:
    """The mean light over the 40th cycle of a video: the crystal relaxes from moment to moment."""
    moments = 100
    left = math.exp(-frame_time / moments / tau)
    angle, total = phases[0].copy(), np.zeros(window)
    # A crystal that stands is seen once a frame, until the cycle that counts.
    for _ in range(40 * len(phases)):
        angle = phases[_ % len(phases)] + (angle - phases[_ % len(phases)]) * left**moments
    for phase in phases:
        for _ in range(moments):
            middle = phase + (angle - phase) * math.sqrt(left)
            field = whole_far_field(np.exp(1j * (middle + besides)), length)
            total += np.abs(window_of(field, window)) ** 2
            angle = phase + (angle - phase) * left
    return total / (moments * len(phases))


@pytest.mark.parametrize("tau", [0.5e-3, 5e-3, 30e-3])
@pytest.mark.parametrize("waves", [0.3, 1.0])
def test_moving_light_is_the_mean_over_many_moments(tau, waves):
    """Steps of up to a wave at 60 Hz, on crystals from nimble to far too slow."""
    rng = np.random.default_rng(0)
    phases, besides = rng.uniform(0, TURN * waves, (3, 16, 20)), rng.normal(size=(16, 20))
    far_field = FarField((16, 20), 40, (18, 15))
    crystal = LiquidCrystal(1 / 60, tau, TURN)
    truth = by_small_steps(phases, 1 / 60, tau, 40, (18, 15), besides)
    seen = moving_crystal_intensity(
        far_field,
        torch.ones(16, 20),
        torch.from_numpy(phases),
        crystal,
        6,
        torch.from_numpy(besides),
    )
    assert relative(seen, truth) < 1e-3


def test_a_crystal_without_inertia_shows_the_plain_mean():
    rng = np.random.default_rng(1)
    phases = rng.uniform(0, TURN, (4, 16, 20))
    crystal = LiquidCrystal(1 / 60, 0.0, TURN)
    amplitude = rng.uniform(0.1, 1, (16, 20))
    seen = moving_crystal_intensity(
        FarField((16, 20), 40, (18, 15)),
        torch.from_numpy(amplitude).float(),
        torch.from_numpy(phases),
        crystal,
        6,
    )
    truth = light(phases, 40, (18, 15), amplitude) * 40**2 * (amplitude**2).sum()
    assert relative(seen, truth) < 1e-5


def test_one_frame_stands_however_slow_the_crystal():
    phases = np.random.default_rng(2).uniform(0, TURN, (1, 16, 20))
    seen = moving_crystal_intensity(
        FarField((16, 20), 40, (18, 15)),
        torch.ones(16, 20),
        torch.from_numpy(phases),
        LiquidCrystal(1 / 60, 20e-3, TURN),
        6,
    )
    assert relative(seen, light(phases, 40, (18, 15)) * 40**2 * 320) < 1e-5


# What a panel makes of a video

SHAPE, WINDOW, LENGTH = (60, 64), (61, 64), 128
TARGET = ring(WINDOW, 18, 2)


def goal_of(**panel) -> RetrievalGoal:
    optics = camera(SHAPE, **panel)
    return RetrievalGoal(
        optics, tensor(TARGET), design_plane(optics, WAVELENGTH, WINDOW), WAVELENGTH
    )


def dish() -> np.ndarray:
    """Metres of optical path, more than a wave."""
    y, x = positions(60, 1 / 30)[:, None], positions(64, 1 / 32)[None, :]
    return 400e-9 * (y**2 + 0.7 * x**2 + 0.5 * x)


@pytest.mark.parametrize("orders", [1, 3])
def test_shown_light_is_that_of_the_panels_levels_on_their_way(orders):
    """Quantised and wrapped by numpy, then simulated; all light sums to one by Parseval."""
    rng = np.random.default_rng(3)
    # Small steps, so that the ways are as short as those that are made for a slow crystal.
    phases = rng.uniform(0, 6, (1, *SHAPE)) + rng.uniform(0, 1.5, (3, *SHAPE))
    goal = goal_of(response_time=5e-3)
    shown = quantised(phases, orders=orders)
    truth = by_small_steps(shown, 1 / 60, 5e-3, LENGTH, WINDOW) / (60 * 64 * LENGTH**2)
    assert relative(displayed_psf(goal, torch.from_numpy(phases), orders), truth) < 1e-3


def test_shown_light_knows_of_a_flatness_that_is_taken_off_and_put_on_again():
    """With a dish of a panel the pattern is rounded elsewhere, and is the same light besides."""
    phases = np.random.default_rng(4).uniform(0, 6, (2, *SHAPE))
    goal = goal_of(flatness=PanelMap(dish()))
    figure = dish() * (TURN / WAVELENGTH)
    shown = quantised(phases - figure)
    truth = light(shown + figure, LENGTH, WINDOW)
    assert relative(displayed_psf(goal, torch.from_numpy(phases), 1), truth) < 1e-4


@pytest.mark.parametrize("flatness", some([PanelMap(dish()), None]))
def test_half_of_what_a_slow_crystal_loses_is_recovered(flatness):
    """At 5 ms and 60 Hz: against a video that knows nothing of the motion."""
    shape, window = (135, 240), (160, 160)
    slow = camera(shape, response_time=5e-3, flatness=flatness)
    still = replace(slow, panel=replace(slow.panel, response_time=0.0))
    target = tensor(ring(window, 40, 4))
    plane = design_plane(slow, WAVELENGTH, window)
    found = {
        optics: retrieve(
            optics, target, plane, WAVELENGTH, frames=4, iterations=30, generator=seeded()
        )
        for optics in (still, slow)
    }
    blind, aware = found.values()
    assert (blind.method, aware.method) == ("joint", "responding")
    goal = RetrievalGoal(slow, target, plane, WAVELENGTH)
    moving = displayed_psf(goal, blind.phases, blind.orders).numpy()
    caught, contrast, _ = merits(moving, target.numpy())
    lost = blind.quality.steered_share - caught
    assert lost > 0.1
    assert aware.quality.steered_share - caught >= 0.5 * lost
    assert aware.quality.contrast < contrast


def test_ways_that_are_short_are_what_recovers():
    """The same frames, in three waves and in one: a step in time turns fewer phases by a wave."""
    goal = goal_of(response_time=5e-3)
    found = retrieve(
        goal.camera, goal.target, goal.plane, WAVELENGTH, frames=4, iterations=30,
        generator=seeded(),
    )  # fmt: skip
    assert found.orders == 3
    far = by_small_steps(quantised(found.phases.numpy()), 1 / 60, 5e-3, LENGTH, WINDOW)
    near = by_small_steps(quantised(found.phases.numpy(), orders=3), 1 / 60, 5e-3, LENGTH, WINDOW)
    share = 60 * 64 * LENGTH**2
    assert merits(near / share, TARGET)[0] > merits(far / share, TARGET)[0] + 0.05
    assert found.quality.steered_share == pytest.approx(merits(near / share, TARGET)[0], rel=1e-3)


# How the ways are shown

BENT = PhaseResponse.from_curve(WAVELENGTH, np.linspace(0, 1, 256) ** 1.3 * 0.75)
LIFTED = PhaseResponse.from_curve(WAVELENGTH, 0.1 + 0.8 * np.linspace(0, 1, 256))
PATCHY = PhaseResponse(
    (WAVELENGTH,), torch.linspace(0, 1, 256) * torch.tensor([1.0, 0.8]).reshape(1, 1, 2, 1)
)


@pytest.mark.parametrize(
    ("panel", "orders"),
    [
        ({}, 3),
        ({"response": BENT}, 2),  # 5.0 pi
        ({"response": LIFTED}, 2),  # 5.4 pi, from 0.7 pi
        ({"response": PATCHY}, 2),  # 5.4 pi on the right
        ({"flatness": PanelMap(dish())}, 3),
        ({"response": LIFTED, "flatness": PanelMap(dish())}, 2),
    ],
)
def test_the_panel_shows_the_ways_that_were_found(panel, orders):
    """Each phase within half a level of where it was asked for, no wave above or below it."""
    goal = goal_of(response_time=5e-3, **panel)
    assert usable_orders(goal.camera.panel, WAVELENGTH) == orders
    found = retrieve(
        goal.camera, goal.target, goal.plane, WAVELENGTH, frames=3, iterations=6,
        generator=seeded(),
    )  # fmt: skip
    assert found.method == "responding"
    assert found.orders == orders
    grey = phase_to_grey(goal.camera.panel, found.phases, WAVELENGTH, found.orders)
    shown = grey_to_phase(goal.camera.panel, grey, WAVELENGTH).numpy()
    figure = dish() * (TURN / WAVELENGTH) if "flatness" in panel else 0.0
    error = np.abs(shown + figure - found.phases.numpy())
    level = 1.4 * REACH / 255
    # Right below the whole range the nearest level is the first: no panel has one beyond.
    assert (error > level).mean() < 0.005
    wrapped = error % (TURN * orders)
    assert np.minimum(wrapped, TURN * orders - wrapped).max() < level


def test_the_crystal_is_read_from_the_panel():
    """6.7 pi are three waves, less half a level; a panel of less than two has one."""
    crystal = crystal_of_goal(goal_of(response_time=4e-3, frame_rate=50.0))
    assert (crystal.frame_time, crystal.response_time) == (0.02, 4e-3)
    assert crystal.reach == pytest.approx(3 * TURN - REACH / 255 / 2, rel=1e-6)
    weak = goal_of(max_phase=((WAVELENGTH, 3.9 * math.pi),))
    assert usable_orders(weak.camera.panel, WAVELENGTH) == 1


def test_ways_are_short_in_radians_a_frame():
    """Root mean square steps of a video for a slow crystal, against the same wrapped in one."""
    goal = goal_of(response_time=5e-3)
    found = retrieve(
        goal.camera, goal.target, goal.plane, WAVELENGTH, frames=4, iterations=20,
        generator=seeded(),
    )  # fmt: skip
    phases = found.phases.double().numpy()

    def step(ways: np.ndarray) -> float:
        return float(np.sqrt(np.mean((ways - np.roll(ways, 1, axis=0)) ** 2)))

    assert step(phases) < 0.6 * step(phases % TURN)
    assert step(phases) == pytest.approx(
        step(shortest_phase_paths(found.phases, 3 * TURN).numpy()), rel=1e-5
    )
