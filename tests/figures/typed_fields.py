"""`python typed_fields.py LOCALE SEED COUNT FOLDER`: what every number field makes of texts.

It prints one JSON line: the fields, and the texts by how they were taken.
"""

from __future__ import annotations

import json
import random
import sys
from collections import Counter
from decimal import Decimal
from pathlib import Path
from typing import Any

from judges.typed_texts import Field, Typed, draw_texts, fate
from PySide6.QtCore import QEvent, QLocale, Qt
from PySide6.QtGui import QKeyEvent
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QAbstractSpinBox, QApplication, QDoubleSpinBox, QLabel, QWidget

from labapp.window.engine_connection import EngineConnection
from labapp.window.main_window import MainWindow
from labapp.window.remembered_settings import RememberedSettings


def type_into_all(window: QWidget, rng: random.Random, count: int) -> dict[str, Any]:
    """As a person types: select all, keys, Enter; each into the field as it stands then."""
    fates, wrong, fields = Counter[str](), [], 0
    for field in window.findChildren(QAbstractSpinBox):
        fields += 1
        taken = _limits(field)
        for typed in draw_texts(taken, rng, count):
            before, after, told = _type(window, field, typed)
            found = fate(typed, before, after, told)
            fates[found] += 1
            if found not in ("set", "kept"):
                wrong.append((typed.text, typed.rule, after, found))
    return {"fields": fields, "fates": fates, "wrong": wrong[:20]}


def _limits(field: Any) -> Field:
    places = field.decimals() if isinstance(field, QDoubleSpinBox) else 0
    low, high = (Decimal(f"{one:.{places}f}") for one in (field.minimum(), field.maximum()))
    return Field(low, high, places, field.suffix().strip())


def _type(window: Any, field: Any, typed: Typed) -> tuple[float, float, bool]:
    enable_all(field)
    field.setFocus()
    window.message.acknowledge()
    before = field.value()
    field.selectAll()
    if not typed.text:
        QTest.keyClick(field, Qt.Key.Key_Delete)
    for letter in typed.text:
        _press(field, letter)
    QTest.keyClick(field, Qt.Key.Key_Return)
    return before, field.value(), window.message.is_error


def _press(field: QWidget, letter: str) -> None:
    """As a keyboard of any language sends it; QTest knows Latin ones only."""
    for kind in (QEvent.Type.KeyPress, QEvent.Type.KeyRelease):
        event = QKeyEvent(kind, 0, Qt.KeyboardModifier.NoModifier, letter)
        QApplication.sendEvent(field, event)


def enable_all(field: QWidget) -> None:
    """A bench that isn't open yet disables fields; the keys go to the field all the same."""
    parent: QWidget | None = field
    while parent is not None:
        parent.setEnabled(True)
        parent = parent.parentWidget()


def main(arguments: list[str]) -> None:
    locale, seed, count, folder = arguments
    QLocale.setDefault(QLocale(locale))
    application = QApplication(sys.argv[:1])
    window = MainWindow(EngineConnection(), RememberedSettings(Path(folder) / "window.ini"))
    window.show()
    application.processEvents()
    found = type_into_all(window, random.Random(int(seed)), int(count))
    found["shown"] = [one.text() for one in window.findChildren(QLabel) if "ms" in one.text()]
    print(json.dumps(found), flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
