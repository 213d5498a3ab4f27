"""What is cut or out of reach in the window, by the geometry of every label and control."""

from __future__ import annotations

from collections.abc import Iterator

from PySide6.QtCore import QPoint, QRect
from PySide6.QtWidgets import (
    QAbstractButton,
    QAbstractSlider,
    QAbstractSpinBox,
    QComboBox,
    QDockWidget,
    QLabel,
    QLineEdit,
    QMainWindow,
    QScrollArea,
    QScrollBar,
    QTabWidget,
    QWidget,
)

from labapp.window.elided_label import ElidedLabel

_CONTROLS = (QAbstractButton, QAbstractSpinBox, QComboBox, QLineEdit, QAbstractSlider)
_ARROWS = 24
"""Pixels that a box needs beside its text, for its arrows and frame."""


def faults(window: QMainWindow, screen: QRect) -> list[str]:
    """What a person couldn't read or reach in the window as it stands.

    A text must fit, or end in "…" and be in the tool tip. A control must be on the screen, or in
    an area that scrolls and is itself on the screen.
    """
    behind = [
        dock
        for dock in window.findChildren(QDockWidget)
        if window.tabifiedDockWidgets(dock) and dock.visibleRegion().isEmpty()
    ]
    return [
        f"{_name(widget)}: {fault}"
        for widget in window.findChildren(QWidget)
        if widget.isVisible() and not widget.size().isEmpty()
        if not any(dock is widget or dock.isAncestorOf(widget) for dock in behind)
        for fault in _faults_of(widget, screen)
    ]


def all_faults(window: QMainWindow, screen: QRect, settle: object) -> dict[str, list[str]]:
    """The faults with each tab and each dock in front, by its title. settle: lets Qt work."""
    assert callable(settle)
    found = {}
    tabs = window.findChild(QTabWidget)
    assert tabs is not None
    for index in range(tabs.count()):
        tabs.setCurrentIndex(index)
        settle()
        found[f"tab {tabs.tabText(index)}"] = faults(window, screen)
    tabs.setCurrentIndex(0)
    for dock in window.findChildren(QDockWidget):
        dock.raise_()
        settle()
        found[f"dock {dock.windowTitle()}"] = faults(window, screen)
    return {where: seen for where, seen in found.items() if seen}


def _faults_of(widget: QWidget, screen: QRect) -> Iterator[str]:
    if isinstance(widget, ElidedLabel):
        if widget.is_elided and not widget.toolTip():
            yield "is shortened without a tool tip"
    elif isinstance(widget, QLabel) and widget.text() and not widget.pixmap():
        yield from _label_faults(widget)
    elif isinstance(widget, QAbstractButton) and widget.text():
        if widget.width() < widget.minimumSizeHint().width():
            yield f"text is cut: {widget.width()} of {widget.minimumSizeHint().width()} px"
    elif isinstance(widget, QComboBox):
        yield from _box_faults(widget, widget.currentText())
    elif isinstance(widget, QAbstractSpinBox):
        yield from _box_faults(widget, widget.text())
    if isinstance(widget, _CONTROLS) and not isinstance(widget, QScrollBar):
        yield from _place_faults(widget, screen)


def _label_faults(label: QLabel) -> Iterator[str]:
    if label.wordWrap():
        needed = label.heightForWidth(label.width())
        if needed > label.height() + 1:
            yield f"lines are cut: {label.height()} of {needed} px"
        return
    needed = label.sizeHint().width()
    if needed > label.width() + 1 and not label.toolTip():
        yield f"text is cut: {label.width()} of {needed} px"


def _box_faults(box: QWidget, text: str) -> Iterator[str]:
    needed = box.fontMetrics().horizontalAdvance(text) + _ARROWS
    if needed > box.width() and not box.toolTip():
        yield f"value {text!r} is cut: {box.width()} of {needed} px"


def _place_faults(control: QWidget, screen: QRect) -> Iterator[str]:
    """Whether a control is on the screen, or scrolling brings it there."""
    place = QRect(control.mapToGlobal(QPoint(0, 0)), control.size())
    area = control.parentWidget()
    while area is not None and not isinstance(area, QScrollArea):
        area = area.parentWidget()
    if isinstance(area, QScrollArea):
        port = area.viewport()
        seen = QRect(port.mapToGlobal(QPoint(0, 0)), port.size())
        # Up and down, and sideways where the area scrolls sideways, anything can be reached.
        if area.horizontalScrollBar().maximum() == 0 and not _within(place, seen):
            yield "is cut at the side"
        place = seen
    if not screen.contains(place):
        yield f"is off the screen: {place.getRect()}"


def _within(place: QRect, room: QRect) -> bool:
    return place.left() >= room.left() - 1 and place.right() <= room.right() + 1


def _name(widget: QWidget) -> str:
    text = getattr(widget, "text", str)()
    return f"{type(widget).__name__} {widget.objectName()} {text[:40]!r}"
