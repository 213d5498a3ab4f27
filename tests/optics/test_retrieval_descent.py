"""Gradient descent through what a panel really does, against that written out in numpy."""

import numpy as np
import pytest
import scipy.ndimage
import torch
from judges import positions, relative
from judges.retrieval import (
    PITCH,
    REACH,
    WAVELENGTH,
    camera,
    merits,
    quantised,
    ring,
    seeded,
    stop_share,
    tensor,
    whole_far_field,
    window_of,
)
from sweeps import some

from optics.progress import Progress
from optics.retrieval import descent as module
from optics.retrieval import design_plane, retrieve
from optics.retrieval.descent import GradientDescent
from optics.retrieval.goal import RetrievalGoal
from optics.slm import PanelMap

SHAPE, WINDOW, LENGTH, DIAMETER = (40, 48), (45, 50), 96, 38.0
TARGET = ring(WINDOW, 13, 2.5)


def goal_of(target=TARGET, **panel) -> RetrievalGoal:
    optics = camera(SHAPE, DIAMETER, **panel)
    return RetrievalGoal(
        optics, tensor(target), design_plane(optics, WAVELENGTH, WINDOW), WAVELENGTH
    )


def solution(goal: RetrievalGoal, frames=1, iterations=60) -> torch.Tensor:
    """What a quick method gives, which knows nothing of the panel."""
    return retrieve(
        goal.camera, goal.target, goal.plane, WAVELENGTH, frames=frames, iterations=iterations,
        method="joint" if frames > 1 else "over-compensated", generator=seeded(),
    ).phases  # fmt: skip


def intensity(field: np.ndarray) -> np.ndarray:
    return np.abs(window_of(whole_far_field(field, LENGTH), WINDOW)) ** 2


def blurred(phase: np.ndarray, sigma: float, fill: float, fine: int = 29) -> np.ndarray:
    """The mean of exp(i phase) over the active squares, the staircase convolved on a fine grid."""
    stairs = np.kron(phase, np.ones((fine, fine)))
    soft = scipy.ndimage.gaussian_filter(stairs, sigma * fine, mode="nearest", truncate=6)
    inside = np.abs((np.arange(fine) + 0.5) / fine - 0.5) <= np.sqrt(fill) / 2
    blocks = np.exp(1j * soft).reshape(SHAPE[0], fine, SHAPE[1], fine)
    return blocks[:, inside][:, :, :, inside].mean((1, 3))


DISH = 150e-9 * (positions(40, 1 / 20)[:, None] ** 2 + positions(48, 1 / 24)[None, :] ** 2)
BEAM = np.exp(-(positions(40, 1 / 40)[:, None] ** 2 + (positions(48, 1 / 48)[None, :] - 0.2) ** 2))

PANELS = {
    "ideal": {"unmodulated": 0.0},
    "few levels": {"unmodulated": 0.0, "levels": 24},
    "unmodulated": {"unmodulated": 0.12, "front_reflection": 0.03, "reflectivity": 0.6},
    "uneven": {"unmodulated": 0.08, "flatness": PanelMap(DISH), "illumination": PanelMap(BEAM)},
    "jitter": {"unmodulated": 0.1, "jitter": 0.4},
    "gap": {"unmodulated": 0.0, "gap_reflection": 0.3},
    "coupled": {"unmodulated": 0.05, "coupling": 0.35 * PITCH},
}


def by_hand(phase: np.ndarray, panel: dict) -> np.ndarray:
    """Share of all light a sample, from the panel's data alone."""
    figure = DISH * 2 * np.pi / WAVELENGTH if "flatness" in panel else np.zeros(SHAPE)
    beam = np.sqrt(BEAM / BEAM.mean()) if "illumination" in panel else np.ones(SHAPE)
    stop = stop_share(SHAPE, DIAMETER)
    shown = quantised(phase - figure, levels=panel.get("levels", 256))
    pixel = np.exp(1j * shown)
    if "coupling" in panel:
        pixel = blurred(shown, panel["coupling"] / PITCH, 0.87)
    pixel = pixel + panel.get("gap_reflection", 0.0) * (1 - 0.87) / 0.87
    through = stop * beam * np.exp(1j * figure)
    front = panel.get("front_reflection", 0.0) / 0.6
    unturned = (1 - front) * panel["unmodulated"]
    steered = (1 - front - unturned) * np.exp(-(panel.get("jitter", 0.0) ** 2))
    light = steered * intensity(through * pixel)
    light = light + unturned * intensity(through) + front * intensity(stop * beam)
    return light / (LENGTH**2 * ((stop * beam) ** 2).sum())


@pytest.mark.parametrize("name", PANELS)
def test_the_light_is_what_the_panels_data_say(name):
    panel = PANELS[name]
    goal = goal_of(**panel)
    phase = solution(goal)[0]
    truth = by_hand(phase.double().numpy(), panel)
    # The coupling's own rule is good to 3e-3 beside the steepest edges.
    assert relative(GradientDescent(goal).frame_intensity(phase), truth) < (
        1e-2 if name == "coupled" else 3e-3
    )


@pytest.mark.parametrize("name", some(PANELS, 0, 2, 4, 6))
def test_the_error_falls(name):
    """Of what the panel makes of it, with the light that the start had on the target; most of
    all on the target, as no pattern takes away the light that none has steered."""
    panel = PANELS[name]
    goal = goal_of(**panel)
    start = solution(goal)
    found = GradientDescent(goal).run(start, 12, Progress())
    assert found.shape == start.shape
    assert found.dtype == torch.float32
    before, after = (by_hand(p[0].double().numpy(), panel) for p in (start, found))
    bright = 0.02 * TARGET.max() < TARGET
    wanted = TARGET * before[bright].sum() / TARGET[bright].sum()
    assert np.linalg.norm(after - wanted) < 0.99 * np.linalg.norm(before - wanted)
    error, usual = (np.linalg.norm((psf - wanted)[bright]) for psf in (after, before))
    assert error < 0.95 * usual
    assert merits(after, TARGET)[0] > 0.9 * merits(before, TARGET)[0]


def test_it_makes_up_for_what_the_quick_methods_dont_know():
    """A panel whose neighbours blur its phases, and levels that are few: the contrast there."""
    panel = {"unmodulated": 0.0, "coupling": 0.3 * PITCH, "levels": 48}
    goal = goal_of(**panel)
    start = solution(goal, iterations=300)
    found = GradientDescent(goal).run(start, 25, Progress())
    before, after = (by_hand(p[0].double().numpy(), panel) for p in (start, found))
    assert merits(after, TARGET)[1] < 0.8 * merits(before, TARGET)[1]
    assert merits(after, TARGET)[2] < 0.75 * merits(before, TARGET)[2]


def test_several_frames_share_their_mean():
    goal = goal_of(unmodulated=0.0)
    start = solution(goal, frames=3, iterations=6)
    found = GradientDescent(goal).run(start, 12, Progress())
    assert found.shape == (3, *SHAPE)
    before, after = (
        merits(np.mean([by_hand(q, PANELS["ideal"]) for q in p.double().numpy()], axis=0), TARGET)
        for p in (start, found)
    )
    assert after[1] < 0.8 * before[1]
    assert after[2] < 0.8 * before[2]


@pytest.mark.parametrize("iterations", [1, 2, 5])
def test_what_comes_is_never_worse_than_the_start(iterations, monkeypatch):
    """With steps so large that every one does harm, the start itself comes back."""
    monkeypatch.setattr(module, "_RATE", 50.0)
    goal = goal_of(unmodulated=0.0)
    start = solution(goal, iterations=200)
    found = GradientDescent(goal).run(start, iterations, Progress())
    before, after = (by_hand(p[0].double().numpy(), PANELS["ideal"]) for p in (start, found))
    assert merits(after, TARGET)[2] <= merits(before, TARGET)[2] + 1e-6


@pytest.mark.parametrize("name", PANELS)
def test_the_derivative_is_finite_and_points_downhill(name):
    goal = goal_of(**PANELS[name])
    descent = GradientDescent(goal)
    phase = solution(goal)[0].clone().requires_grad_()
    light = descent.frame_intensity(phase)
    light[tensor(TARGET) > 0.5].sum().backward()
    assert torch.isfinite(phase.grad).all()
    assert phase.grad.abs().max() > 0
    dark = (stop_share(SHAPE, DIAMETER) == 0) & (PANELS[name].get("coupling", 0) == 0)
    assert not phase.grad.numpy()[dark].any()


def test_the_derivative_is_that_of_a_panel_of_endless_levels():
    """Rounding is passed over: differences of light that no level rounds, in numpy."""
    goal = goal_of(unmodulated=0.0)
    shown = quantised(solution(goal)[0].double().numpy())
    phase = torch.from_numpy(shown).float().requires_grad_()
    weight = np.random.default_rng(0).normal(size=WINDOW)
    (GradientDescent(goal).frame_intensity(phase) * torch.from_numpy(weight)).sum().backward()
    stop = stop_share(SHAPE, DIAMETER)
    change = np.random.default_rng(1).normal(size=SHAPE)

    def merit(step: float) -> float:
        field = stop * np.exp(1j * (shown + step * change))
        return float((weight * intensity(field)).sum() / (LENGTH**2 * (stop**2).sum()))

    slope = (merit(1e-4) - merit(-1e-4)) / 2e-4
    assert float((phase.grad.double().numpy() * change).sum()) == pytest.approx(slope, rel=1e-2)


def test_a_panel_that_reaches_farther_may_use_all_of_its_waves():
    goal = goal_of(unmodulated=0.0)
    phase = 3 * solution(goal)[0]
    shown = quantised(phase.double().numpy(), orders=3)
    stop = stop_share(SHAPE, DIAMETER)
    truth = intensity(stop * np.exp(1j * shown)) / (LENGTH**2 * (stop**2).sum())
    assert 6 * np.pi < REACH
    assert relative(GradientDescent(goal, orders=3).frame_intensity(phase), truth) < 3e-3
