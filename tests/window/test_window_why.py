"""From the simulator to the panel: plans are told when they change, and found with a key."""

import pickle
import subprocess
import sys
from dataclasses import astuple, replace

import numpy as np
import pytest
from eyes import pixels
from plan_files import LONG, write_plan
from PySide6.QtCore import Qt
from waits import wait_until
from window_scene import write_bench

from labapp.bench.opening import open_bench
from labapp.window import theme
from labapp.window.engine.effects_reporter import EffectsReporter
from labapp.window.engine_connection import EngineConnection
from labapp.window.main_window import MainWindow
from labapp.window.messages import BenchOpened, DeviceInfo, EffectsReport, LiveFrame, QueueState
from labapp.window.remembered_settings import RememberedSettings


class Heard:
    """A channel to nobody, which remembers what was sent."""

    def __init__(self):
        self.sent = []

    def send(self, report):
        self.sent.append(report)


@pytest.fixture
def small_bench(tmp_path):
    with open_bench(write_bench(tmp_path)) as bench:
        yield bench


def frame(bench, exposure=0.4, pattern="neutral"):
    """What the window is told of a picture; nobody looks at the picture itself here."""
    world = bench.world
    image = np.zeros((1, 1), np.uint16)
    return LiveFrame(image, world.target, pattern, world.wavelength, exposure, 1)


def dark_current(told):
    return next(effect for effect in told.effects if effect.name == "dark current")


def test_a_plan_is_told_once_for_each_setting(small_bench):
    heard = Heard()
    effects, world = EffectsReporter(small_bench, heard), small_bench.world
    for _ in range(3):
        effects.report_if_changed(frame(small_bench))
    assert len(heard.sent) == 1
    # Time passes, and nothing else changes.
    world.begin_frame(1, 2, 3, index=4, start_time=5.0)
    effects.report_if_changed(frame(small_bench))
    assert len(heard.sent) == 1
    effects.report_if_changed(frame(small_bench, exposure=0.8))
    world.wavelength = 600e-9
    effects.report_if_changed(frame(small_bench, exposure=0.8))
    # A file that has changed is another pattern of the same name.
    world.grey = np.full(world.camera.panel.shape, 9, np.uint8)
    effects.report_if_changed(frame(small_bench, exposure=0.8))
    world.target = "flat"
    effects.report_if_changed(frame(small_bench, exposure=0.8))
    told = [(one.target, round(one.wavelength * 1e9), one.exposure) for one in heard.sent]
    assert told == [
        ("dark", 550, 0.4), ("dark", 550, 0.8), ("dark", 600, 0.8), ("dark", 600, 0.8),
        ("flat", 600, 0.8),
    ]  # fmt: skip


def test_what_is_told_is_what_the_plan_says(small_bench):
    heard = Heard()
    small_bench.world.target = "flat"
    EffectsReporter(small_bench, heard).report_if_changed(frame(small_bench, exposure=0.01))
    told = heard.sent[0]
    plan = small_bench.world.imaging.plan(small_bench.world.situation(0.01))
    assert [effect.name for effect in told.effects] == [one.effect for one in plan.decisions]
    for effect, decision in zip(told.effects, plan.decisions, strict=True):
        assert (effect.on, effect.forced) == (decision.on, decision.forced)
        assert effect.level.split(" of ")[0] == decision.level
        assert (effect.error, effect.why) == (decision.relative, decision.why)
    assert {effect.name for effect in told.effects if effect.forced} == {
        "panel orders", "PSF reach"
    }  # fmt: skip
    assert told.tol == 0.01
    assert 0 < told.work <= 1


def test_dark_electrons_grow_with_the_exposure(small_bench):
    """One electron a second, as the bench file says."""
    heard = Heard()
    effects = EffectsReporter(small_bench, heard)
    for exposure in (0.4, 0.8):
        effects.report_if_changed(frame(small_bench, exposure=exposure))
    said = [dark_current(told).why.split()[0] for told in heard.sent]
    assert [float(number) for number in said] == pytest.approx([0.4, 0.8], rel=1e-2)


def test_messages_need_no_simulator_to_be_read(small_bench):
    """The window's process has no torch: what it gets is words and numbers."""
    heard = Heard()
    EffectsReporter(small_bench, heard).report_if_changed(frame(small_bench))
    plain = (str, float, bool, int, type(None))
    told = heard.sent[0]
    for effect in told.effects:
        assert all(type(value) in plain for value in astuple(effect))
    assert all(type(value) in plain for value in astuple(replace(told, effects=())) if value != ())
    assert len(pickle.dumps(told)) < 30_000


def test_a_limit_that_is_not_known_is_told_as_none(small_bench):
    heard, world = Heard(), small_bench.world
    world.target = "flat"
    plan = world.imaging.plan(world.situation(0.01))
    plan.relative_error = float("inf")
    plan.decisions = (replace(plan.decisions[0], relative=float("inf")), *plan.decisions[1:])
    EffectsReporter(small_bench, heard).report_if_changed(frame(small_bench, exposure=0.01))
    assert heard.sent[0].error is None
    assert heard.sent[0].effects[0].error is None


def test_of_a_real_camera_nothing_is_told(small_bench):
    class Real:
        """A camera of the simulated bench that says that it's a real one."""

        identity = replace(small_bench.camera.identity, simulated=False)

    bench, heard = replace(small_bench, camera=Real()), Heard()
    assert small_bench.camera_world is small_bench.world
    assert bench.camera_world is None
    EffectsReporter(bench, heard).report_if_changed(frame(small_bench))
    assert heard.sent == []


@pytest.fixture
def live(bench, person):
    """The shared window, live on the dark target; the queue in front."""
    person.chooses(bench.window.settings.target, "dark")
    person.waits(lambda: bench.frame.target == "dark")
    return bench, person


def in_front(widget):
    """Of what shares a place, Qt calls all visible."""
    return not widget.visibleRegion().isEmpty()


def names(window):
    return [row.name for row in window.effects.table.effects.rows]


def test_a_key_brings_the_reasons_to_the_front_and_the_queue_back(live):
    bench, person = live
    window = bench.window
    person.waits(lambda: in_front(window.queue) and not in_front(window.effects))
    person.presses(Qt.Key.Key_W)
    person.waits(lambda: in_front(window.effects) and not in_front(window.queue))
    person.waits(window.actions_["why"].isChecked)
    person.presses(Qt.Key.Key_W)
    person.waits(lambda: in_front(window.queue))
    person.waits(lambda: not window.actions_["why"].isChecked())
    person.clicks(window.bar.buttons["why"])
    person.waits(lambda: in_front(window.effects))


def test_the_panel_follows_the_setting_and_not_the_frames(live):
    bench, person = live
    window = bench.window
    person.clicks(window.bar.buttons["why"])
    person.waits(lambda: window.effects.setting.text() == "dark · neutral · 550.00 nm · 400.000 ms")
    assert "read noise" in names(window)
    assert "diffraction" not in names(window)
    count, told = bench.frames, len([r for r in bench.reports if isinstance(r, EffectsReport)])
    person.waits(lambda: bench.frames > count + 5)
    assert len([r for r in bench.reports if isinstance(r, EffectsReport)]) == told
    person.types(window.settings.exposure, "10")
    person.waits(lambda: window.effects.setting.text().endswith("· 10.000 ms"))
    person.chooses(window.settings.target, "flat")
    person.waits(lambda: window.effects.setting.text().startswith("flat ·"))
    assert "diffraction" in names(window)
    assert bench.last(EffectsReport).target == "flat"
    assert "of everything on, as estimated (tolerance 1e-2" in window.effects.summary.text()


def test_a_run_tells_what_its_frames_are_computed_with(live, chosen_file, tmp_path):
    bench, person = live
    # One after the other: of two that alternate, a busy machine may always show the same.
    plan = write_plan(tmp_path, "Two exposures", exposures="[1]", repeats=LONG // 4)
    later = write_plan(tmp_path, "The later one", exposures="[8]", repeats=LONG)
    _, table, block = later.read_text().partition("[[acquire]]")
    plan.write_text(plan.read_text() + table + block)
    chosen_file(plan)
    bench.reports.clear()
    bench.window.actions_["plan"].trigger()

    def exposures():
        return {told.exposure for told in bench.reports if isinstance(told, EffectsReport)}

    person.waits(lambda: exposures() >= {1e-3, 8e-3})
    person.cancels()
    person.waits(lambda: bench.states[-1] == "CANCELLED")
    # The live view comes back with what the person had set.
    person.presses(Qt.Key.Key_F5)
    person.waits(lambda: bench.last(EffectsReport).exposure == 0.4)


def test_reset_layout_brings_the_queue_back(live):
    bench, person = live
    window = bench.window
    person.clicks(window.bar.buttons["why"])
    person.waits(lambda: in_front(window.effects))
    person.clicks(window.bar.buttons["reset"])
    person.waits(lambda: in_front(window.queue))
    person.waits(lambda: not window.actions_["why"].isChecked())


def test_apart_from_the_queue_the_reasons_stay(live):
    bench, person = live
    window = bench.window
    dock = window.docks["Why"]
    dock.setFloating(True)
    person.waits(lambda: in_front(window.effects) and in_front(window.queue))
    person.waits(window.actions_["why"].isChecked)
    person.clicks(window.bar.buttons["why"])
    assert in_front(window.effects)
    assert window.actions_["why"].isChecked()
    person.clicks(window.bar.buttons["reset"])
    person.waits(lambda: in_front(window.queue) and not in_front(window.effects))
    assert not dock.isFloating()


def test_forced_effects_are_amber_on_the_screen(live):
    bench, person = live
    window = bench.window
    person.clicks(window.bar.buttons["why"])
    person.chooses(window.settings.target, "flat")
    person.waits(lambda: window.effects.setting.text().startswith("flat ·"))
    table = window.effects.table
    row = names(window).index("panel orders")
    table.scrollTo(table.effects.index(row, 0))
    amber = np.array([int(theme.SIMULATED[k : k + 2], 16) for k in (1, 3, 5)])

    def seen():
        place = table.visualRect(table.effects.index(row, 0))
        screen = pixels(table.viewport())[place.top() : place.bottom()].astype(int)
        return (np.abs(screen - amber).max(2) < 12).any()

    person.waits(seen)


def test_a_queue_that_is_held_comes_to_the_front(live):
    """It waits for a person, who may be reading something else."""
    bench, person = live
    window = bench.window
    person.clicks(window.bar.buttons["why"])
    person.waits(lambda: in_front(window.effects))
    bench.connection.report_received.emit(QueueState((), "Night run failed"))
    person.waits(lambda: in_front(window.queue.hold_bar))
    person.waits(lambda: not window.actions_["why"].isChecked())
    bench.connection.report_received.emit(QueueState(()))


def test_a_window_with_the_reasons_in_front_fits_a_small_screen(live):
    bench, person = live
    person.clicks(bench.window.bar.buttons["why"])
    needed = bench.window.minimumSizeHint()
    assert needed.width() <= 1280
    assert needed.height() <= 690
    # Nor is the badge cut.
    assert bench.window.bar.badge.text() == "SIMULATED: slm, filter, camera, targets"
    assert bench.window.bar.minimumSizeHint().width() <= 1280


def test_a_bench_of_real_devices_says_so(dark_theme, qtbot, tmp_path):
    window = MainWindow(EngineConnection(), RememberedSettings(tmp_path / "window.ini"))
    qtbot.addWidget(window)
    window.show()
    devices = tuple(DeviceInfo(n, "any", False) for n in ("slm", "filter", "camera", "targets"))
    opened = BenchOpened(
        "Bench", devices, ("scene",), (4e-7, 7e-7), (1e-5, 1.0), (32, 48), 4095, False
    )
    window.connection.report_received.emit(opened)
    window.actions_["why"].trigger()
    wait_until(lambda: in_front(window.effects))
    assert window.effects.summary.text() == "Real devices: nothing is simulated."


def test_what_the_window_reads_imports_no_torch():
    code = "import sys, labapp.window.effects_panel; print('torch' in sys.modules)"
    said = subprocess.run(
        [sys.executable, "-c", code], stdout=subprocess.PIPE, text=True, check=True, timeout=60
    )
    assert said.stdout.strip() == "False"
