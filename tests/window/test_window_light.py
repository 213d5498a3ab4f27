"""Dim and red light, the list of keys, and panels by the keyboard alone."""

import gc
from functools import partial

import numpy as np
import pytest
from eyes import pixels
from PySide6.QtCore import Qt
from PySide6.QtWidgets import QDialog, QLabel, QMenu, QVBoxLayout, QWidget
from shiboken6 import isValid
from waits import wait_until

from labapp.runs.state import State
from labapp.window import theme
from labapp.window.actions import ACTION_SPECS
from labapp.window.engine_connection import EngineConnection
from labapp.window.main_window import MainWindow
from labapp.window.remembered_settings import RememberedSettings


@pytest.fixture
def window(dark_theme, qtbot, tmp_path):
    made = MainWindow(EngineConnection(), RememberedSettings(tmp_path / "window.ini"))
    qtbot.addWidget(made)
    made.show()
    qtbot.waitExposed(made)
    yield made
    for name in ("dim", "red"):
        made.actions_[name].setChecked(False)


def brightest(widget):
    """The greatest red, green and blue that the screen shows there."""
    return pixels(widget).reshape(-1, 3).max(axis=0)


def test_red_light_leaves_red_alone_in_dialogues_too(window, qtbot):
    wait_until(lambda: brightest(window).min() > 150)
    window.actions_["red"].trigger()
    wait_until(lambda: tuple(brightest(window)[1:]) == (0, 0))
    assert brightest(window)[0] > 150
    dialogue = QDialog(window)
    qtbot.addWidget(dialogue)
    label = QLabel("white", dialogue)
    label.setStyleSheet("background: white; color: white;")
    QVBoxLayout(dialogue).addWidget(label)
    dialogue.resize(200, 120)
    dialogue.show()
    wait_until(lambda: tuple(brightest(dialogue)) == (255, 0, 0))
    # What opens while it is red is in white light again afterwards, like all else.
    window.actions_["red"].trigger()
    wait_until(lambda: tuple(brightest(dialogue)) == (255, 255, 255))
    wait_until(lambda: brightest(window).min() > 150)


def test_dialogues_come_and_go_in_red_light(window):
    window.actions_["red"].trigger()
    for _ in range(20):
        dialogue = QDialog(window)
        dialogue.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        dialogue.show()
        dialogue.close()
        wait_until(lambda dialogue=dialogue: not isValid(dialogue))
    wait_until(lambda: tuple(brightest(window)[1:]) == (0, 0))
    window.actions_["red"].trigger()
    wait_until(lambda: brightest(window).min() > 150)


def test_a_window_that_python_ends_takes_its_pane_along(window):
    """In a cycle with its pane, it would end at a later collection, which crashed."""
    others, ended = {"shown": QWidget(), "hidden": QMenu()}, []
    others["shown"].show()
    for name in others:
        others[name].destroyed.connect(partial(ended.append, name))
    window.actions_["red"].trigger()
    wait_until(lambda: tuple(brightest(others["shown"])[1:]) == (0, 0))
    others.clear()
    assert ended == ["shown", "hidden"]
    gc.collect()


def test_dim_light_keeps_colours_and_takes_light(window):
    before = pixels(window.bar).astype(float)
    window.actions_["dim"].trigger()
    wait_until(lambda: not np.array_equal(pixels(window.bar), before))
    assert np.abs(pixels(window.bar) - 115 / 255 * before).max() <= 1.5
    # Clicks pass through.
    why = window.bar.buttons["why"]
    assert window.childAt(why.mapTo(window, why.rect().center())) == why


def test_the_light_is_kept(window, qtbot, tmp_path):
    window.actions_["red"].trigger()
    window.close()
    again = MainWindow(EngineConnection(), RememberedSettings(tmp_path / "window.ini"))
    qtbot.addWidget(again)
    again.show()
    wait_until(lambda: tuple(brightest(again)[1:]) == (0, 0))
    again.actions_["red"].trigger()


def test_every_key_is_listed(window):
    window.actions_["keys"].trigger()
    listed = window.keys.list
    keys = [listed.topLevelItem(row).text(0) for row in range(listed.topLevelItemCount())]
    wanted = [spec.shortcut for spec in ACTION_SPECS if spec.shortcut]
    assert keys[: len(wanted)] == wanted
    assert len(set(keys)) == len(keys)
    window.keys.close()


def test_a_panel_is_reached_by_a_key(window, qtbot):
    window.activateWindow()
    wait_until(window.isActiveWindow)
    window.docks["Log"].close()
    number = list(window.docks).index("Log") + 1
    key = getattr(Qt.Key, f"Key_{number}")
    qtbot.keyClick(window, key, Qt.KeyboardModifier.ControlModifier)
    wait_until(window.docks["Log"].isVisible)
    wait_until(lambda: window.log.isAncestorOf(window.focusWidget()))


def test_states_differ_by_shape():
    assert len({theme.RUN_SIGNS[state] for state in State if state in theme.RUN_STATES}) == len(
        theme.RUN_STATES
    )
    assert len({theme.READY_SIGN, *theme.DEVICE_SIGNS.values()}) == 3
