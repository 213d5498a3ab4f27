"""The panel that tells why the simulator does what it does, looked at on the screen."""

import re
from dataclasses import replace

import numpy as np
import pytest
from eyes import pixels
from PySide6.QtCore import QPoint, Qt
from waits import wait_until

from labapp.window import theme
from labapp.window.effects_panel import EffectsPanel
from labapp.window.effects_table import BAR_COLUMN
from labapp.window.messages import DeviceInfo, EffectInfo, EffectsReport

_WHY = "the brightest pixel could hold 5e3 electrons, and 1.05e4 are read without clipping"


def effect(name, level, at_most, forced=False):
    return EffectInfo(
        name, level, level != "off", forced, at_most, 2e-6 if at_most else 0.0,
        "pixels of 3.45 µm", "a pixel averages light", "Goodman 2005", "proved: Young",
    )  # fmt: skip


TOLD = EffectsReport(
    "photograph", "axicon 80 µm", 612.34e-9, 0.0125,
    (
        effect("pixel aperture", "on", 0.0), effect("dark current", "off", 1e-5),
        effect("vignetting", "off", 0.1, forced=True), effect("clipping", "off", None, True),
    ),
    tol=1e-3, error=8e-4, work=0.02,
)  # fmt: skip


@pytest.fixture
def panel(qtbot, dark_theme):
    made = EffectsPanel()
    qtbot.addWidget(made)
    made.resize(520, 300)
    made.show()
    wait_until(lambda: made.windowHandle().isExposed())
    return made


def cell(panel, row, column=BAR_COLUMN):
    return panel.table.visualRect(panel.table.effects.index(row, column))


def colour(name):
    return np.array([int(name[k : k + 2], 16) for k in (1, 3, 5)])


def filled(panel, row):
    """Of a bar's length, the share that isn't the colour of an empty one, near its top."""
    place = cell(panel, row)
    shown = pixels(panel.table.viewport())
    line = shown[place.top() + 6, place.left() + 2 : place.right() - 6].astype(int)
    return float((np.abs(line - colour(theme.PANEL)).max(1) > 6).mean())


def shows_colour(panel, row, column, name):
    place = cell(panel, row, column)
    seen = pixels(panel.table.viewport())[place.top() : place.bottom()]
    part = seen[:, place.left() : place.right()].astype(int)
    return bool((np.abs(part - colour(name)).max(2) < 12).any())


def shown(panel, row):
    return [panel.table.effects.index(row, column).data() for column in range(3)]


def test_before_the_first_picture_nothing_is_claimed(panel):
    assert "with the first picture" in panel.summary.text()
    assert not panel.setting.isVisible()
    assert panel.table.effects.rowCount() == 0


def test_effects_stand_with_level_and_limit(panel):
    panel.show_effects(TOLD)
    assert [shown(panel, row) for row in range(4)] == [
        ["pixel aperture", "on", "nothing"],
        ["dark current", "off", "1e-5"],
        ["vignetting", "off", "0.1"],
        ["clipping", "off", "no limit known"],
    ]
    assert panel.summary.text() == (
        "The picture is within 8e-4 of everything on (tolerance 1e-3), for 2 % of its work. "
        "1 of 4 effects take part."
    )
    assert panel.setting.text() == "photograph · axicon 80 µm · 612.34 nm · 12.500 ms"
    assert panel.setting.isVisible()


def test_bars_are_as_long_as_the_logarithm_of_the_change(panel):
    """From 1e-7 to 1: 1e-5 is two of seven decades, 0.1 is six. The tolerance is a thin line."""
    panel.show_effects(TOLD)
    wait_until(lambda: abs(filled(panel, 2) - 6 / 7) < 0.06)
    wait_until(lambda: filled(panel, 0) < 0.04)
    wait_until(lambda: abs(filled(panel, 1) - 2 / 7) < 0.06)
    wait_until(lambda: filled(panel, 3) > 0.95)


def test_the_tolerance_is_a_line_across_every_bar(panel):
    """1e-3 is four of seven decades, 1e-5 is two."""
    for tol, decades in ((1e-3, 4), (1e-5, 2)):
        panel.show_effects(replace(TOLD, tol=tol))

        def found(row=0):
            place = cell(panel, row)
            line = pixels(panel.table.viewport())[place.top() + 6].astype(int)
            line = line[place.left() : place.right() - 5]
            at = np.flatnonzero(np.abs(line - colour(theme.TEXT)).max(1) < 12)
            return at.mean() / len(line) if len(at) else 0.0

        wait_until(lambda d=decades, f=found: abs(f() - d / 7) < 0.02)


def test_forced_effects_are_amber_and_those_that_are_off_are_faint(panel):
    panel.show_effects(TOLD)
    for row, name in ((2, theme.SIMULATED), (0, theme.TEXT), (1, theme.FAINT)):
        wait_until(lambda r=row, n=name: shows_colour(panel, r, 0, n))
    # All is painted now.
    for row in (0, 1):
        assert not shows_colour(panel, row, 0, theme.SIMULATED)
    assert not shows_colour(panel, 1, 0, theme.TEXT)


def test_a_sentence_that_is_too_long_wraps_and_is_seen_to_its_end(panel):
    """Wherever it ends, the lowest line of the row has ink, and the edge below it has none."""
    long = replace(TOLD.effects[1], why=_WHY)
    panel.show_effects(replace(TOLD, effects=(TOLD.effects[1], long)))
    heights = []
    for width in (900, 520, 380, 300):
        panel.resize(width, 300)
        wait_until(lambda w=width: panel.table.viewport().width() < panel.width() <= w)
        heights.append(cell(panel, 1).height())
        assert cell(panel, 0).height() <= heights[-1]

        def inked():
            place = cell(panel, 1)
            seen = pixels(panel.table.viewport())[place.top() : place.bottom() - 1].astype(int)
            faint = np.abs(seen - colour(theme.FAINT)).max(2) < 40
            return np.flatnonzero(faint.any(1)).max(initial=0)

        line = 1.5 * panel.fontMetrics().lineSpacing()
        wait_until(lambda f=inked, h=heights[-1], s=line: h - s < f() < h - 3)
    assert heights == sorted(heights)
    assert heights[-1] > heights[0] + panel.fontMetrics().lineSpacing()


def test_the_physics_is_told_where_the_mouse_rests(panel):
    panel.show_effects(TOLD)
    tip = panel.table.effects.index(2, 0).data(Qt.ItemDataRole.ToolTipRole)
    assert tip.splitlines() == [
        "A pixel averages light", "Pixels of 3.45 µm", "Error proved: Young",
        "Source: Goodman 2005", "Forced by the scene",
    ]  # fmt: skip


def test_a_tolerance_that_forced_effects_exceed_is_told(panel):
    panel.show_effects(replace(TOLD, error=0.1))
    assert "within 0.1 of everything on (tolerance 1e-3, which forced effects exceed)" in (
        panel.summary.text()
    )
    panel.show_effects(replace(TOLD, error=None))
    assert "isn't known" in panel.summary.text()


def test_news_of_the_same_effects_leaves_the_person_where_they_are(panel):
    many = tuple(replace(TOLD.effects[1], name=f"effect {n}") for n in range(30))
    panel.show_effects(replace(TOLD, effects=many))
    bar = panel.table.verticalScrollBar()
    wait_until(lambda: bar.maximum() > 200)
    bar.setValue(200)
    changed = tuple(replace(one, error=0.5) for one in many)
    panel.show_effects(replace(TOLD, effects=changed))
    assert bar.value() == 200
    assert shown(panel, 29)[BAR_COLUMN] == "0.5"
    place = cell(panel, 10)
    assert panel.table.indexAt(QPoint(5, place.center().y())).row() == 10


@pytest.mark.parametrize(
    ("simulated", "words"),
    [
        ((), "Real devices: nothing is simulated."),
        (("slm", "targets"), "The camera is real: nothing is simulated in its pictures."),
        (("camera",), "appears here with the first picture"),
    ],
)
def test_of_real_devices_nothing_is_claimed(panel, simulated, words):
    panel.show_effects(TOLD)
    names = ("slm", "filter", "camera", "targets")
    panel.show_bench(tuple(DeviceInfo(name, "any", name in simulated) for name in names))
    assert panel.table.effects.rowCount() == 0
    assert re.search(re.escape(words), panel.summary.text())
    assert not panel.setting.isVisible()


def test_what_is_estimated_is_said_to_be(panel):
    panel.show_effects(TOLD)
    assert "as estimated" not in panel.summary.text()
    panel.show_effects(replace(TOLD, is_estimated=True))
    assert "within 8e-4 of everything on, as estimated (tolerance" in panel.summary.text()
