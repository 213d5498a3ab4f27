"""Form for a pattern: a page for each kind, with the keys of a plan file."""

from __future__ import annotations

from functools import partial
from typing import Any

from PySide6.QtCore import Signal
from PySide6.QtWidgets import (
    QComboBox,
    QFileDialog,
    QFormLayout,
    QHBoxLayout,
    QLineEdit,
    QPushButton,
    QStackedWidget,
    QVBoxLayout,
    QWidget,
)

from labapp.window.commands import PatternTable
from labapp.window.number_fields import NumberBox
from labapp.window.pattern_kinds import (
    PATTERN_KINDS,
    FileField,
    NumberField,
    PatternField,
    PatternKind,
)
from labapp.window.widgets import fill_layout

_FILES = "Pictures and designs (*.png *.tif *.tiff *.bmp *.jpg *.h5)"


class PatternForm(QWidget):
    """Let the person choose a kind of pattern and its parameters.

    `changed` is emitted after each change, and `edited` while a text is being typed. `numbers` and
    `texts` are the fields by kind and key.
    """

    changed = Signal()
    edited = Signal()

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.kind = QComboBox(self)
        self.kind.setMaxVisibleItems(len(PATTERN_KINDS))
        self.numbers: dict[tuple[str, str], NumberBox] = {}
        self.texts: dict[tuple[str, str], QLineEdit] = {}
        self._pages = QStackedWidget(self)
        for kind in PATTERN_KINDS:
            self.kind.addItem(kind.title, kind.name)
            self._pages.addWidget(self._page(kind))
        fill_layout(QVBoxLayout(self), self.kind, self._pages, spacing=4)
        self.kind.currentIndexChanged.connect(self._pages.setCurrentIndex)
        self.kind.currentIndexChanged.connect(lambda _: self.changed.emit())
        # Start with a pattern that changes the PSF: a bracket with a constant one is refused.
        self.select_kind("ring")

    @property
    def file(self) -> QLineEdit:
        """Return the field for the file of a picture that is used as a pattern."""
        return self.texts["image", "file"]

    @property
    def missing_input(self) -> str:
        """Return what the person must still enter, or ""."""
        kind = self._selected_kind
        for field in kind.fields:
            if isinstance(field, NumberField):
                continue
            if self.texts[kind.name, field.key].text().strip():
                continue
            return "choose a picture file" if isinstance(field, FileField) else "type some text"
        return ""

    @property
    def needs_file(self) -> bool:
        """Return whether the chosen pattern comes from a file."""
        return any(isinstance(field, FileField) for field in self._selected_kind.fields)

    def pattern_table(self, wavelength_nm: float) -> PatternTable:
        """Return the chosen pattern as a table of a plan file, designed for this wavelength."""
        kind = self._selected_kind
        table = kind.build_table({field.key: self._value(kind, field) for field in kind.fields})
        return (
            table | {"wavelength_nm": round(wavelength_nm, 2)} if kind.needs_wavelength else table
        )

    def select_kind(self, kind: str) -> None:
        index = self.kind.findData(kind)
        if index >= 0:
            self.kind.setCurrentIndex(index)

    @property
    def _selected_kind(self) -> PatternKind:
        return PATTERN_KINDS[self.kind.currentIndex()]

    def _value(self, kind: PatternKind, field: PatternField) -> Any:
        if not isinstance(field, NumberField):
            return self.texts[kind.name, field.key].text()
        value = self.numbers[kind.name, field.key].value()
        return round(value, 3) if field.decimals else round(value)

    def _page(self, kind: PatternKind) -> QWidget:
        page = QWidget(self)
        form = QFormLayout(page)
        form.setContentsMargins(0, 0, 0, 0)
        form.setVerticalSpacing(4)
        for field in kind.fields:
            where = (kind.name, field.key)
            if isinstance(field, NumberField):
                self.numbers[where] = box = self._number(field, page)
                form.addRow(field.label, box)
                continue
            self.texts[where] = line = QLineEdit(page)
            line.textChanged.connect(self.edited)
            line.editingFinished.connect(self.changed)
            if isinstance(field, FileField):
                line.setPlaceholderText(field.hint)
                browse = QPushButton("Browse …", page)
                browse.clicked.connect(partial(self._choose_file, line))
                form.addRow(fill_layout(QHBoxLayout(), (line, 1), browse))
            else:
                line.setText(field.initial)
                line.setMaxLength(field.longest)
                form.addRow(field.label, line)
        return page

    def _number(self, field: NumberField, page: QWidget) -> NumberBox:
        box = NumberBox(page, suffix=field.unit, decimals=field.decimals)
        box.setRange(field.low, field.high)
        box.setValue(field.initial)
        box.valueChanged.connect(lambda _: self.changed.emit())
        return box

    def _choose_file(self, line: QLineEdit, checked: bool) -> None:
        path, _ = QFileDialog.getOpenFileName(self, "Pattern", line.text(), _FILES)
        if path:
            line.setText(path)
            self.changed.emit()
