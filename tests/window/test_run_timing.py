"""The time that is left of a run follows from what was measured, in this run and before it."""

from pathlib import Path

import pytest

from labapp.runs.shots import Shot
from labapp.window.engine import timing
from labapp.window.engine.frame_costs import FrameCosts, frame_kinds
from labapp.window.engine.timing import RunTiming


def make_shots(*settings):
    """Frames of 2 s on the bench's clock, of the given targets and exposures."""
    return [
        Shot(n, n, 0, target, "neutral", 550e-9, exposure, duration=2.0)
        for n, (target, exposure) in enumerate(settings)
    ]


FIVE = make_shots(*[("dark", 1.0)] * 5)


class Clock:
    def __init__(self):
        self.now = 100.0

    def passes(self, seconds):
        self.now += seconds


@pytest.fixture
def clock(monkeypatch):
    made = Clock()
    monkeypatch.setattr(timing.time, "monotonic", lambda: made.now)
    return made


@pytest.fixture
def costs(tmp_path):
    return FrameCosts(tmp_path / "costs.json", "bench")


def test_frames_of_a_setting_are_told_from_its_first():
    shots = make_shots(("dark", 1.0), ("dark", 1.0), ("star", 1.0), ("star", 2.0), ("star", 1.0))
    assert frame_kinds(shots) == ["new dark", "same dark", "new star", "new star", "same star"]
    known = {("star", "neutral", 550e-9, 2.0)}
    assert frame_kinds(shots, known)[2:] == ["new star", "known star", "same star"]


@pytest.mark.parametrize(("virtual", "left"), [(True, 3 * 0.5), (False, 6.0 + 3 * 0.5)])
def test_what_is_left_follows_from_the_frames_taken(clock, costs, virtual, left):
    """Five frames of 2 s of bench time, each half a second longer than that."""
    told = RunTiming(FIVE, virtual=virtual, costs=costs)
    told.begin()
    assert told.seconds_left is None
    clock.passes(30)  # patterns are computed, which says nothing about frames
    told.count_frame()
    clock.passes(0.5 if virtual else 2.5)
    told.count_frame()
    assert told.seconds_left == pytest.approx(left)
    clock.passes(0.25)
    assert told.seconds_left == pytest.approx(left - 0.25)
    # A frame that takes longer than usual takes nothing from those after it.
    clock.passes(100)
    assert told.seconds_left == pytest.approx(left * 2 / 3)
    told.rest()
    clock.passes(1000)
    assert told.seconds_left == pytest.approx(left)
    assert told.elapsed_seconds == pytest.approx(1130.75 if virtual else 1132.75)


def test_a_run_is_known_from_the_one_before(clock, costs, tmp_path):
    """Preparing takes 8 s, a new dark frame 1 s, a new star 3 s, and each further frame 0.5 s."""
    shots = make_shots(
        *[("dark", 1.0)] * 3, *[("star", 1.0)] * 2, ("dark", 2.0), *[("star", 2.0)] * 2
    )

    def take(told, slower=1.0, frames=8):
        told.begin()
        clock.passes(8 + slower)
        for lasts in (0.0, 0.5, 0.5, 3.0, 0.5, 1.0, 3.0, 0.5)[:frames]:
            clock.passes(slower * lasts)
            told.count_frame()
        told.end(complete=frames == 8)

    take(RunTiming(shots, virtual=True, costs=costs))
    again = FrameCosts(tmp_path / "costs.json", "bench")
    told = RunTiming(shots, virtual=True, costs=again)
    # The first frame's second counts as preparing: nobody can tell them apart.
    assert told.whole_seconds == pytest.approx(9 + 1 + 4 * 0.5 + 2 * 3 + 1 - 1, rel=0.1)
    told.begin()
    clock.passes(4)
    assert told.seconds_left == pytest.approx(5 + 9, rel=0.1)
    # In the session, the pictures are there already: each costs what a further frame does.
    again_at_once = RunTiming(shots, virtual=True, costs=costs)
    assert again_at_once.whole_seconds == pytest.approx(8 * 0.5)
    # The machine is twice as slow now, which the stars that are to come feel as well.
    slow = RunTiming(shots, virtual=True, costs=again)
    take(slow, slower=2.0, frames=3)
    assert slow.seconds_left == pytest.approx(2 * (3 + 0.5 + 1 + 3 + 0.5))
    assert (
        RunTiming(shots, virtual=True, costs=FrameCosts(Path("no"), "other")).whole_seconds is None
    )


@pytest.mark.parametrize("text", ["", "\x00\xff", "[]", '{"bench": 3}', '{"bench": {"a": ["b"]}}'])
def test_a_damaged_file_is_left_out(tmp_path, text):
    (tmp_path / "costs.json").write_text(text)
    costs = FrameCosts(tmp_path / "costs.json", "bench")
    assert costs.seconds("new star") is None
    costs.add({"new star": 2.0})
    assert FrameCosts(tmp_path / "costs.json", "bench").seconds("new star") == 2.0


def test_costs_follow_the_last_runs_of_their_bench(tmp_path):
    file = tmp_path / "costs.json"
    for seconds in (9.0, 9.0, 1.0, 2.0, 3.0, 4.0, 5.0):
        FrameCosts(file, "bench").add({"new star": seconds})
    FrameCosts(file, "other").add({"new star": 100.0})
    assert FrameCosts(file, "bench").seconds("new star") == 3.0
