"""The panel that tells why the simulator does what it does, looked at on the screen."""

import numpy as np
import pytest
from eyes import pixels
from PySide6.QtCore import Qt

from labapp.window import theme
from labapp.window.effects_panel import BAR, EffectsPanel


def decision(effect, level, relative, forced=False):
    return {
        "effect": effect, "kind": "stage", "level": level, "levels": ["off", "on"],
        "bound": {"mean": 1.0, "variance": 0.0, "sigma": 0.0, "shape": 0.0, "how": "proved: Young"},
        "relative": relative, "estimate": 0.0, "work": 1.0, "why": "pixels of 3.45 µm",
        "physics": "a pixel averages light", "source": "Goodman", "forced": forced,
        "on": level != "off",
    }  # fmt: skip


PLAN = {
    "tol": 1e-3, "error": 8e-4, "work": 2e6, "most_work": 1e8,
    "decisions": [
        decision("pixel aperture", "on", 0.0), decision("dark current", "off", 1e-5),
        decision("vignetting", "off", 0.1, forced=True), decision("clipping", "off", None, True),
    ],
}  # fmt: skip


@pytest.fixture
def panel(qtbot, qapp):
    theme.apply(qapp)
    made = EffectsPanel()
    qtbot.addWidget(made)
    made.resize(520, 300)
    made.show()
    qtbot.waitExposed(made)
    return made


def cell(panel, row, column=BAR):
    return panel.table.visualRect(panel.model.index(row, column))


def filled(panel, row):
    """Of a bar's length, the share that isn't the colour of an empty one, on its second line."""
    place = cell(panel, row)
    shown = pixels(panel.table.viewport())
    line = shown[place.top() + 5, place.left() + 4 : place.right() - 4].astype(int)
    empty = np.array([int(theme.FIELD[k : k + 2], 16) for k in (1, 3, 5)])
    return float((np.abs(line - empty).max(1) > 6).mean())


def shown(panel, row):
    return [panel.model.index(row, column).data() for column in range(3)]


def test_before_the_first_picture_nothing_is_claimed(panel):
    assert "with the first picture" in panel.summary.text()
    assert panel.model.rowCount() == 0


def test_effects_stand_with_level_and_limit(panel):
    panel.show_plan(PLAN)
    assert [shown(panel, row) for row in range(4)] == [
        ["pixel aperture", "on", "nothing"],
        ["dark current", "off", "1.0e-05"],
        ["vignetting", "off", "1.0e-01"],
        ["clipping", "off", "no limit known"],
    ]
    assert "1 of 4 effects are on" in panel.summary.text()
    assert "within 8.0e-04" in panel.summary.text()
    assert "2.0% of the work" in panel.summary.text()


def test_bars_are_as_long_as_the_logarithm_of_the_change(panel, qtbot):
    """From 1e-7 to 1: 1e-5 is two of seven decades, 0.1 is six. The tolerance is a thin line."""
    panel.show_plan(PLAN)
    qtbot.waitUntil(lambda: abs(filled(panel, 2) - 6 / 7) < 0.06)
    assert filled(panel, 0) < 0.04
    assert filled(panel, 1) == pytest.approx(2 / 7, abs=0.06)
    assert filled(panel, 3) > 0.95


def test_forced_effects_are_amber_and_those_that_are_off_are_faint(panel):
    panel.show_plan(PLAN)
    role = Qt.ItemDataRole.ForegroundRole
    colours = [panel.model.index(row, 0).data(role).name() for row in range(4)]
    assert colours == [theme.TEXT, theme.FAINT, theme.SIMULATED, theme.SIMULATED]


def test_the_physics_is_told_where_the_mouse_rests(panel):
    panel.show_plan(PLAN)
    tip = panel.model.index(2, 0).data(Qt.ItemDataRole.ToolTipRole)
    assert tip.splitlines() == [
        "A pixel averages light", "Pixels of 3.45 µm", "Bound: proved: Young",
        "Forced by the scene.",
    ]  # fmt: skip


def test_a_tolerance_that_forced_effects_exceed_is_told(panel):
    panel.show_plan(PLAN | {"error": 0.1})
    assert "which forced effects exceed" in panel.summary.text()
    panel.show_plan(PLAN | {"error": None})
    assert "isn't known" in panel.summary.text()


def test_a_real_camera_empties_the_panel(panel):
    panel.show_plan(PLAN)
    panel.show_plan(None)
    assert panel.model.rowCount() == 0
    assert "with the first picture" in panel.summary.text()


def test_data_of_something_else_is_refused_and_changes_nothing(panel):
    panel.show_plan(PLAN)
    with pytest.raises(KeyError):
        panel.show_plan({"frames": 3})
    assert panel.model.rowCount() == 4
