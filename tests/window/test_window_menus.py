"""Menus and bar: every action has a place, and none is cut in a narrow window."""

import pytest
from PySide6.QtCore import QRect, QSize
from PySide6.QtWidgets import QMainWindow, QWidget

from labapp.window.action_bar import TOOL_GROUPS
from labapp.window.actions import ACTION_SPECS, make_actions
from labapp.window.flow_layout import FlowLayout
from labapp.window.menus import MENUS, SEPARATOR, MenuBar


def test_every_action_is_in_one_menu():
    names = [name for menu in MENUS.values() for name in menu if name != SEPARATOR]
    assert sorted(names) == sorted(spec.name for spec in ACTION_SPECS)
    assert {name for group in TOOL_GROUPS for name in group} <= set(names)


def test_menus_show_shortcuts_beside_texts(dark_theme, qtbot):
    window = QMainWindow()
    qtbot.addWidget(window)
    actions = make_actions(window)
    menus = MenuBar(actions, window).menus
    assert list(menus) == [title.replace("&", "") for title in MENUS]
    live = menus["Bench"].actions()[0]
    assert (live.text(), live.iconText(), live.shortcut().toString()) == ("Live", "Live  F5", "F5")


class Brick(QWidget):
    def __init__(self, width, parent):
        super().__init__(parent)
        self._size = QSize(width, 20)

    def sizeHint(self):
        return self._size


@pytest.mark.parametrize(
    ("width", "places", "height"),
    [
        (300, [(0, 0), (104, 0), (208, 0)], 20),
        # 100 + 4 + 100 = 204 fit, the third has a row of its own.
        (204, [(0, 0), (104, 0), (0, 24)], 44),
        (203, [(0, 0), (0, 24), (104, 24)], 44),
        # Narrower than a widget: it is as wide as the row.
        (80, [(0, 0), (0, 24), (0, 48)], 68),
    ],
)
def test_rows_are_filled_from_the_left(dark_theme, qtbot, width, places, height):
    parent = QWidget()
    qtbot.addWidget(parent)
    flow = FlowLayout(spacing=4)
    parent.setLayout(flow)
    bricks = [Brick(size, parent) for size in (100, 100, 50)]
    for brick in bricks:
        flow.addWidget(brick)
    flow.setContentsMargins(0, 0, 0, 0)
    assert flow.heightForWidth(width) == height
    flow.setGeometry(QRect(0, 0, width, height))
    assert [(brick.x(), brick.y()) for brick in bricks] == places
    assert all(brick.geometry().right() < width for brick in bricks)
