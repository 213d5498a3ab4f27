"""What makes a pattern: one page a kind, in a plan file's own words."""

from __future__ import annotations

from functools import partial
from typing import Any

from PySide6.QtCore import Signal
from PySide6.QtWidgets import (
    QComboBox,
    QDoubleSpinBox,
    QFileDialog,
    QFormLayout,
    QHBoxLayout,
    QLineEdit,
    QPushButton,
    QStackedWidget,
    QVBoxLayout,
    QWidget,
)

from labapp.window.messages import PatternTable
from labapp.window.parts import fill
from labapp.window.pattern_kinds import KINDS, Field, Kind, Number, PictureFile

_FILES = "Pictures and designs (*.png *.tif *.tiff *.bmp *.jpg *.h5)"


class PatternForm(QWidget):
    """Chooses a kind of pattern and its sizes. changed: something was chosen.

    numbers, texts: the fields, by kind and key.
    """

    changed = Signal()

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.kind = QComboBox(self)
        self.kind.setMaxVisibleItems(len(KINDS))
        self.numbers: dict[tuple[str, str], QDoubleSpinBox] = {}
        self.texts: dict[tuple[str, str], QLineEdit] = {}
        self._pages = QStackedWidget(self)
        for kind in KINDS:
            self.kind.addItem(kind.title, kind.name)
            self._pages.addWidget(self._page(kind))
        fill(QVBoxLayout(self), self.kind, self._pages, spacing=4)
        self.kind.currentIndexChanged.connect(self._pages.setCurrentIndex)
        self.kind.currentIndexChanged.connect(lambda _: self.changed.emit())
        # The first bracket of a newcomer shall code something.
        self.choose("ring")

    @property
    def file(self) -> QLineEdit:
        """The path of an image pattern."""
        return self.texts["image", "file"]

    @property
    def lacks(self) -> str:
        """What has to be given before there is a pattern; empty if nothing."""
        kind = self._chosen
        for field in kind.fields:
            if isinstance(field, Number) or self.texts[kind.name, field.key].text():
                continue
            return "choose a picture file" if isinstance(field, PictureFile) else "type some text"
        return ""

    def table(self, wavelength_nm: float) -> PatternTable:
        """The pattern as a plan file writes it, designed for a wavelength."""
        kind = self._chosen
        table = kind.table({field.key: self._value(kind, field) for field in kind.fields})
        return table | {"wavelength_nm": round(wavelength_nm, 2)} if kind.coded else table

    def choose(self, kind: str) -> None:
        index = self.kind.findData(kind)
        if index >= 0:
            self.kind.setCurrentIndex(index)

    @property
    def _chosen(self) -> Kind:
        return KINDS[self.kind.currentIndex()]

    def _value(self, kind: Kind, field: Field) -> Any:
        if not isinstance(field, Number):
            return self.texts[kind.name, field.key].text()
        value = self.numbers[kind.name, field.key].value()
        return round(value, 3) if field.decimals else round(value)

    def _page(self, kind: Kind) -> QWidget:
        page = QWidget(self)
        form = QFormLayout(page)
        form.setContentsMargins(0, 0, 0, 0)
        form.setVerticalSpacing(4)
        for field in kind.fields:
            where = (kind.name, field.key)
            if isinstance(field, Number):
                self.numbers[where] = box = self._number(field, page)
                form.addRow(field.label, box)
                continue
            self.texts[where] = line = QLineEdit(page)
            line.editingFinished.connect(self.changed)
            if isinstance(field, PictureFile):
                line.setPlaceholderText(field.hint)
                browse = QPushButton("Browse …", page)
                browse.clicked.connect(partial(self._choose_file, line))
                form.addRow(fill(QHBoxLayout(), (line, 1), browse))
            else:
                line.setText(field.first)
                line.setMaxLength(field.longest)
                form.addRow(field.label, line)
        return page

    def _number(self, field: Number, page: QWidget) -> QDoubleSpinBox:
        box = QDoubleSpinBox(page, suffix=field.unit, decimals=field.decimals)
        box.setRange(field.low, field.high)
        box.setValue(field.first)
        box.setKeyboardTracking(False)
        box.valueChanged.connect(lambda _: self.changed.emit())
        return box

    def _choose_file(self, line: QLineEdit, checked: bool) -> None:
        path, _ = QFileDialog.getOpenFileName(self, "Pattern", line.text(), _FILES)
        if path:
            line.setText(path)
            self.changed.emit()
