"""Settings that are kept from one session to the next."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Any

from PySide6.QtCore import QByteArray, QSettings, QStandardPaths, SignalInstance
from PySide6.QtWidgets import QCheckBox, QComboBox, QLineEdit, QWidget

from labapp.window.commit_fields import CommitSpinBox
from labapp.window.number_fields import NumberField

log = logging.getLogger(__name__)

_TICKED = "ticked"
"""What the file has for a box that is ticked."""


def default_settings_file() -> Path:
    """Return the path of the person's settings file."""
    where = QStandardPaths.StandardLocation.GenericConfigLocation
    return Path(QStandardPaths.writableLocation(where)) / "labapp" / "window.ini"


class RememberedSettings:
    """Keep fields and layout in a file, which may be missing, old or broken.

    Nothing in the file can keep the window from opening: values that can't be used are ignored.
    """

    def __init__(self, file: Path) -> None:
        self._settings = QSettings(str(file), QSettings.Format.IniFormat)

    @property
    def queue_file(self) -> Path:
        """Return the file beside the settings that keeps the queue."""
        return Path(self._settings.fileName()).with_name("queue.json")

    def text(self, key: str) -> str:
        value = self._settings.value(key)
        return value if isinstance(value, str) else ""

    def layout(self, key: str) -> QByteArray:
        value = self._settings.value(key)
        return value if isinstance(value, QByteArray) else QByteArray()

    def put(self, key: str, value: Any) -> None:
        self._settings.setValue(key, value)

    def restore_fields(self, fields: dict[str, QWidget]) -> None:
        """Set every field to its saved value; ignore values that don't fit."""
        for key, field in fields.items():
            text = self.text(key)
            if not text:
                continue
            try:
                _set(field, text)
            except ValueError:
                log.warning("the settings file has %s = %r, which is left out", key, text)

    def store_fields(self, fields: dict[str, QWidget]) -> None:
        for key, field in fields.items():
            self._settings.setValue(key, _get(field))

    def save(self) -> None:
        """Write the settings file; if that isn't possible, log a warning."""
        self._settings.sync()
        if self._settings.status() != QSettings.Status.NoError:
            log.warning("%s: the settings could not be kept", self._settings.fileName())


def changes(field: QWidget) -> SignalInstance | None:
    """Return the signal of a field that tells of a change; None if it has none."""
    if isinstance(field, NumberField):
        return field.valueChanged
    if isinstance(field, QLineEdit):
        return field.textChanged
    if isinstance(field, QCheckBox):
        return field.toggled
    return field.currentTextChanged if isinstance(field, QComboBox) else None


def _set(field: QWidget, text: str) -> None:
    """Set a field to its saved value."""
    if isinstance(field, NumberField):
        field.set_from_text(text)
    elif isinstance(field, QLineEdit):
        field.setText(text)
    elif isinstance(field, QCheckBox):
        field.setChecked(text == _TICKED)
    elif isinstance(field, QComboBox) and field.findText(text) >= 0:
        field.setCurrentText(text)


def _get(field: QWidget) -> str:
    """Return the value of a field, to be saved."""
    if isinstance(field, CommitSpinBox):
        # What is only proposed in it isn't set yet.
        return str(field.set_value)
    if isinstance(field, NumberField):
        return str(field.value())
    if isinstance(field, QLineEdit):
        return field.text()
    if isinstance(field, QCheckBox):
        return _TICKED if field.isChecked() else ""
    return field.currentText() if isinstance(field, QComboBox) else ""
