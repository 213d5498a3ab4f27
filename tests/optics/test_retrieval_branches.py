"""The orders in which a video's phases are shown, against all combinations of them."""

import itertools
import math

import numpy as np
import pytest
import torch

from optics.retrieval import slow_crystal as module
from optics.retrieval.slow_crystal import shortest_phase_paths

TURN = 2 * math.pi


def costs(ways: np.ndarray) -> np.ndarray:
    """Squared steps of each pixel (frames, ...) over the repeated video."""
    return ((ways - np.roll(ways, 1, axis=0)) ** 2).sum(0)


def least_costs(phases: np.ndarray, reach: float) -> np.ndarray:
    """The least of all combinations of orders that the panel can show, pixel by pixel."""
    wrapped = phases % TURN
    choices = range(math.ceil(reach / TURN))
    least = np.full(phases.shape[1:], np.inf)
    for orders in itertools.product(choices, repeat=len(phases)):
        shown = wrapped + TURN * np.array(orders)[:, None, None]
        within = (shown <= reach + 1e-9).all(0)
        least = np.where(within, np.minimum(least, costs(shown)), least)
    return least


def random(frames: int, shape=(2, 7), seed=0) -> torch.Tensor:
    rng = np.random.default_rng(seed)
    return torch.from_numpy(rng.uniform(-9, 30, (frames, *shape)))


@pytest.mark.parametrize("frames", [1, 2, 3, 5])
@pytest.mark.parametrize("reach", [TURN, 1.3 * TURN, 2 * TURN, 3 * TURN, 3.35 * TURN])
def test_no_other_orders_are_shorter(frames, reach):
    phases = random(frames)
    ways = shortest_phase_paths(phases, reach)
    assert ways.shape == phases.shape
    assert ways.dtype == torch.float32
    least = least_costs(phases.numpy(), reach)
    assert costs(ways.double().numpy()) == pytest.approx(least, rel=1e-5)
    assert float(ways.min()) >= 0
    assert float(ways.max()) <= reach * (1 + 1e-6)
    # The same light once the crystal stands.
    turns = (ways.double() - phases).numpy() / TURN
    assert np.abs(turns - np.round(turns)).max() < 1e-6


def test_across_the_end_of_a_wave_the_way_is_short_where_there_is_another():
    """From 0.9 to 0.1 turn: a fifth of a turn up, or four fifths down."""
    phases = TURN * torch.tensor([0.9, 0.1], dtype=torch.float64).reshape(2, 1, 1)
    two, one = (shortest_phase_paths(phases, waves * TURN).flatten().tolist() for waves in (2, 1))
    assert two == pytest.approx([0.9 * TURN, 1.1 * TURN], rel=1e-6)
    assert one == pytest.approx([0.9 * TURN, 0.1 * TURN], rel=1e-6)


def test_where_there_is_one_wave_there_is_no_choice():
    phases = random(3)
    for reach in (TURN, TURN * (1 - 1e-12), 1.0001 * TURN):
        ways = shortest_phase_paths(phases, reach).numpy()
        at_end = (phases.numpy() % TURN) < 1e-3
        assert np.abs(ways - phases.numpy() % TURN)[~at_end].max() < 1e-5


@pytest.mark.parametrize("at_a_time", [1, 5, 17])
def test_pixels_in_blocks_of_any_size_are_the_same(at_a_time, monkeypatch):
    phases = random(4)
    together = shortest_phase_paths(phases, 3 * TURN)
    monkeypatch.setattr(module, "_AT_A_TIME", at_a_time)
    assert torch.equal(shortest_phase_paths(phases, 3 * TURN), together)


def test_a_long_video_is_cut_into_few_pixels_at_a_time(monkeypatch):
    """What is held grows with frames x orders x pixels: with more frames fewer pixels."""
    sizes = []

    def counting(phases, reach):
        sizes.append(phases.numel())
        return shortest(phases, reach)

    shortest = module._shortest_paths_of_block
    monkeypatch.setattr(module, "_shortest_paths_of_block", counting)
    monkeypatch.setattr(module, "_AT_A_TIME", 3000)
    phases = random(150, (20, 31))
    ways = shortest_phase_paths(phases, 3 * TURN)
    assert max(sizes) <= 3000
    assert sum(sizes) == phases.numel()
    steps = ways.diff(dim=0).abs().mean()
    # Not farther than without a choice, where two uniform phases are a third of a wave apart.
    assert float(steps) < 0.8 * TURN / 3


def test_phases_at_the_very_end_of_the_range_are_shown_within_it():
    edge = torch.tensor([0.0, TURN, -1e-17, TURN - 1e-12, 3 * TURN, -TURN]).reshape(1, 1, 6)
    for reach in (TURN, 3 * TURN):
        ways = shortest_phase_paths(edge, reach).double()
        assert float(ways.min()) >= 0
        assert float(ways.max()) <= reach * (1 + 1e-6)


def test_less_than_a_wave_is_refused():
    with pytest.raises(ValueError, match=r"reach is 1\.90 pi; a pattern needs 2 pi: choose a sh"):
        shortest_phase_paths(random(2), 1.9 * math.pi)
