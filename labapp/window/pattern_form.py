"""The numbers that make a pattern: one page a kind, in a plan file's own words."""

from __future__ import annotations

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

_KINDS = {
    "constant": "Neutral",
    "ring": "Ring",
    "lens": "Fresnel lens",
    "axicon": "Axicon",
    "image": "Image file",
}
_NUMBERS: dict[str, tuple[tuple[str, str, str, float, float, float], ...]] = {
    "constant": (),
    "ring": (
        ("radius_um", "Radius", " µm", 1, 2000, 80),
        ("width_um", "Width", " µm", 0.5, 500, 8),
    ),
    "lens": (("focal_length_m", "Focal length", " m", -1000, 1000, 20),),
    "axicon": (("radius_um", "Radius", " µm", 1, 5000, 80),),
}
"""Key in the plan file, label, unit, lowest, highest and first value."""

_FOR_ONE_WAVELENGTH = ("ring", "lens", "axicon")


class PatternForm(QWidget):
    """Chooses a kind of pattern and its sizes. changed: something was chosen."""

    changed = Signal()

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.kind = QComboBox(self)
        self.numbers: dict[tuple[str, str], QDoubleSpinBox] = {}
        self.file = QLineEdit(self, placeholderText="8-bit picture of the panel's size")
        self.browse = QPushButton("Browse …", self)
        self._pages = QStackedWidget(self)
        for kind, title in _KINDS.items():
            self.kind.addItem(title, kind)
            self._pages.addWidget(self._file_page() if kind == "image" else self._page(kind))
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.setSpacing(4)
        layout.addWidget(self.kind)
        layout.addWidget(self._pages)
        self.kind.currentIndexChanged.connect(self._pages.setCurrentIndex)
        self.kind.currentIndexChanged.connect(lambda _: self.changed.emit())
        self.file.editingFinished.connect(self.changed)
        self.browse.clicked.connect(self._choose_file)
        # The first bracket of a newcomer shall code something.
        self.choose("ring")

    def table(self, wavelength_nm: float) -> PatternTable:
        """The pattern as a plan file writes it, designed for a wavelength."""
        kind = self.kind.currentData()
        table: PatternTable = {"kind": kind}
        if kind == "image":
            table["file"] = self.file.text()
        for key, *_ in _NUMBERS.get(kind, ()):
            table[key] = round(self.numbers[kind, key].value(), 3)
        if kind in _FOR_ONE_WAVELENGTH:
            table["wavelength_nm"] = round(wavelength_nm, 2)
        return table

    def choose(self, kind: str) -> None:
        index = self.kind.findData(kind)
        if index >= 0:
            self.kind.setCurrentIndex(index)

    def _page(self, kind: str) -> QWidget:
        page = QWidget(self)
        form = QFormLayout(page)
        form.setContentsMargins(0, 0, 0, 0)
        form.setVerticalSpacing(4)
        for key, label, unit, low, high, first in _NUMBERS[kind]:
            box = QDoubleSpinBox(page, suffix=unit, decimals=2)
            box.setRange(low, high)
            box.setValue(first)
            box.setKeyboardTracking(False)
            box.valueChanged.connect(lambda _: self.changed.emit())
            self.numbers[kind, key] = box
            form.addRow(label, box)
        return page

    def _file_page(self) -> QWidget:
        page = QWidget(self)
        row = QHBoxLayout(page)
        row.setContentsMargins(0, 0, 0, 0)
        row.addWidget(self.file, 1)
        row.addWidget(self.browse)
        return page

    def _choose_file(self) -> None:
        pictures = "Pictures (*.png *.tif *.tiff *.bmp *.jpg)"
        path, _ = QFileDialog.getOpenFileName(self, "Pattern", self.file.text(), pictures)
        if path:
            self.file.setText(path)
            self.changed.emit()
