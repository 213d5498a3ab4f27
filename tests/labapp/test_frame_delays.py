"""What a run's frames take on a bench whose devices are quicker or slower than they document."""

from __future__ import annotations

from contextlib import nullcontext
from types import SimpleNamespace

import numpy as np
import pytest
from plans import abilities, block, plan_of, tunable

from drivers.errors import DeviceError
from drivers.interfaces import Frame, Setting
from labapp.bench.opening import open_bench
from labapp.common.frame_delays import FrameDelays
from labapp.runs.acquisition.frame_delays import measure_frame_delays
from labapp.runs.acquisition.runner import run_plan
from labapp.runs.capabilities import BenchCapabilities
from labapp.runs.steps import planned_shots
from optics.progress import Cancelled, Progress

SHOW, TUNE, PLACE, SET, FIRST, EARLY = 0.1, 0.2, 0.15, 0.01, 0.5, 0.003
"""Seconds of the calls; of the first frame after a change; and by which a picture comes early."""


class SlowBench:
    """A bench of stated times, whose clock goes on by what is done with it, and else stands."""

    file = SimpleNamespace(is_real=True)
    world = wheel = None

    def __init__(self, capabilities, failing=False):
        self.able, self.failing = capabilities, failing
        self.time, self.number = 0.0, 0
        self.frame_delays = None
        self.supervised_devices = {}
        self.changed = True
        self.settings = []
        self.clock = SimpleNamespace(now=lambda: self.time, wait_until=self.wait)
        self.slm = SimpleNamespace(displayed_pattern="", show=self.show)
        self.filter = SimpleNamespace(wavelength=0.0, set_wavelength=self.tune)
        self.targets = SimpleNamespace(
            by_hand=capabilities.by_hand,
            names=capabilities.targets,
            current_target="star",
            place=self.place,
        )
        self.camera = SimpleNamespace(
            full_scale=4095, shape=(1, 1), set_exposure=self.expose, capture=self.capture
        )

    def cancellable_by(self, cancelled):
        return nullcontext()

    def wait(self, until, cancelled):
        self.time = max(self.time, until)

    def done(self, what, seconds, settling):
        self.time += seconds
        self.changed = True
        self.settings.append(what)
        return Setting(what, what, self.time + settling)

    def place(self, name):
        if name not in self.able.targets:
            raise DeviceError("targets", f"place {name}", "no such target", "Choose another")
        self.targets.current_target = name
        return self.done(name, PLACE, self.able.target_settling)

    def show(self, name, grey):
        self.slm.displayed_pattern = name
        return self.done(name, SHOW, self.able.slm_settling)

    def tune(self, wavelength):
        self.filter.wavelength = wavelength
        return self.done(wavelength, TUNE, self.able.filter_settling)

    def expose(self, exposure):
        self.time += SET
        self.exposure = exposure
        return Setting(exposure, exposure, self.time)

    def capture(self, cancelled):
        if self.failing:
            raise DeviceError("camera", "capture", "is broken", "Mend it")
        began = self.time
        self.time += self.exposure + self.able.readout - EARLY + FIRST * self.changed
        self.changed = False
        self.number += 1
        return Frame(np.zeros((1, 1), np.uint16), self.exposure, 1.0, began, self.number)


PLAN = plan_of(
    block(patterns=["neutral", "lens"], wavelengths_nm=[500, 600], exposures_ms=[1, 20], repeats=3)
)


def measured(able, plan=PLAN, placed="star"):
    bench = SlowBench(able)
    bench.targets.current_target = placed
    return bench, measure_frame_delays(bench, able, planned_shots(plan, able), Progress())


def test_delays_are_those_of_the_calls_and_of_the_first_frame_after_a_change():
    bench, able = measured(tunable())
    assert able.delays.frame == pytest.approx(SET - EARLY)
    # While the others settle, the camera is set.
    assert able.delays.filter == pytest.approx(TUNE + FIRST - SET)
    assert able.delays.slm == pytest.approx(SHOW + FIRST - SET)
    assert able.delays.target == pytest.approx(PLACE + FIRST - SET)
    assert bench.targets.current_target == "star"
    assert bench.slm.displayed_pattern == "neutral"
    assert set(able.wavelength_range) <= set(bench.settings)


@pytest.mark.parametrize(
    ("names", "shown"),
    [
        (["lens"], ["grey", "lens", "grey", "neutral"]),
        (["ring", "lens"], ["ring", "lens", "ring", "neutral"]),
        (["grey", "neutral"], ["neutral", "grey", "neutral"]),
    ],
)
def test_patterns_of_the_run_are_shown_for_that_and_constant_ones_where_they_are_too_few(
    names, shown
):
    able = tunable()
    bench = SlowBench(able)
    bench.slm.play = bench.slm.show
    plan = plan_of(block(patterns=names), patterns={name: {"kind": "constant"} for name in names})
    patterns = {name: np.zeros((2, *able.panel_shape), np.uint8) for name in names}
    measure_frame_delays(bench, able, planned_shots(plan, able), Progress(), patterns)
    assert [one for one in bench.settings if one in (*shown, *names)] == shown


@pytest.mark.parametrize("placed", ["star", ""])
def test_a_person_is_not_asked_to_place_targets_for_that(placed):
    """Nor does a target count as placed of which nobody said so."""
    bench, able = measured(tunable(by_hand=True), placed=placed)
    assert able.delays.frame == pytest.approx(SET - EARLY)
    assert able.delays.target == 0.0
    assert {one for one in bench.settings if one in able.targets} <= {placed}
    assert bench.targets.current_target == placed


def test_a_plans_time_follows_from_them():
    """24 frames; of twice two settings, in which pattern or wavelength change, and the target."""
    _, able = measured(tunable())
    first = max(able.target_settling, able.slm_settling, able.filter_settling)
    frames = 12 * (1e-3 + 20e-3) + 24 * (able.readout + SET - EARLY)
    delay = TUNE + FIRST - SET
    changes = first + delay  # all of them, before the first frame
    changes += 2 * (able.filter_settling + delay)  # 500 to 600 nm, and to 600 again
    changes += able.filter_settling + delay  # back to 500 nm with another pattern
    listed = planned_shots(PLAN, able)
    assert sum(shot.duration for shot in listed) == pytest.approx(frames + changes)
    assert listed[1].start_time - listed[0].start_time == pytest.approx(
        1e-3 + able.readout + SET - EARLY + delay
    )


def test_they_are_measured_once_and_never_on_a_virtual_bench(small, tmp_path):
    bench, able = measured(tunable())
    count = bench.number
    assert measure_frame_delays(bench, tunable(), planned_shots(PLAN, able), Progress()) == able
    assert bench.number == count
    with open_bench(small.bench_files) as virtual:
        run_plan(virtual, plan_of(block(targets=["dark"])), tmp_path / "run.h5")
        assert virtual.frame_delays is None


@pytest.mark.parametrize("slots", [(532e-9,), (450e-9, 532e-9)])
def test_a_wheel_turns_if_it_can(slots):
    able = abilities(slots=slots)
    bench = SlowBench(able)
    bench.wheel = SimpleNamespace(set_slot=lambda slot: bench.tune(slots[slot - 1]))
    plan = plan_of(block(wavelengths_nm=None, slots=[1]))
    found = measure_frame_delays(bench, able, planned_shots(plan, able), Progress())
    assert found.delays.filter == pytest.approx(TUNE + FIRST - SET if len(slots) > 1 else 0.0)


def test_a_device_that_fails_leaves_the_run_to_tell(caplog):
    able = tunable()
    bench = SlowBench(able, failing=True)
    listed = planned_shots(PLAN, able)
    assert measure_frame_delays(bench, able, listed, Progress()) == able
    assert "could not be measured: camera" in caplog.text
    progress = Progress()
    progress.cancel()
    with pytest.raises(Cancelled):
        measure_frame_delays(bench, able, listed, progress)


def test_a_record_tells_the_delays_again():
    able = tunable(delays=FrameDelays(frame=-0.01, filter=0.2))
    data = {**vars(able), "delays": vars(able.delays)}
    assert BenchCapabilities.of_data(data) == able
    assert BenchCapabilities.of_data({**vars(tunable()), "delays": {}}) == tunable()


def test_no_frame_takes_less_than_its_exposure():
    able = tunable(delays=FrameDelays(frame=-1.0))
    shots = planned_shots(plan_of(block(repeats=2)), able)
    assert shots[1].duration == pytest.approx(1e-3)
