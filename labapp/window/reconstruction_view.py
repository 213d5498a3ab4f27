"""A reconstruction: how to restore, then a photograph, or a spectral cube."""

from __future__ import annotations

from PySide6.QtCore import Signal
from PySide6.QtGui import QAction, QStandardItemModel
from PySide6.QtWidgets import (
    QCheckBox,
    QComboBox,
    QHBoxLayout,
    QLineEdit,
    QPushButton,
    QStackedWidget,
    QVBoxLayout,
    QWidget,
)

from labapp.window.before_after_view import BeforeAfterView
from labapp.window.commands import DECODER
from labapp.window.messages import ReconstructionResult, RecordOpened
from labapp.window.number_fields import NumberBox
from labapp.window.spectral_messages import RecordBands, SpectralResult
from labapp.window.spectral_view import SpectralView
from labapp.window.widgets import fill_layout, make_label, make_tool_button, plain_tip
from optics.inverse.method_names import AUTO, RESTORATIONS

METHODS = {
    "Automatic": AUTO,
    **{one.title[0].upper() + one.title[1:]: name for name, one in RESTORATIONS.items()},
}
"""Names of the restoration methods in the engine, by the titles that are shown."""

DECODER_TITLE = "Depth of field: decoder"
"""The title of the choice that decodes a photograph behind a trained pattern."""

_NO_DECODER = (
    "For a photograph through the pattern Extended depth of field, or through a design file with a "
    "decoder: labapp train edof"
)

_EMPTY = (
    "Nothing is reconstructed yet: acquire a bracket (F6) or open a run, then reconstruct it (F7)."
)


_SHORT_NAME = 10
"""Characters of a method's name that are seen at least: "Automatic" is whole."""

_BANDS_TIP = (
    "Restore a spectral cube from the photographs that were taken at several wavelengths through "
    "the coded pattern, with the star at each of them"
)

_ALL_BANDS = "all bands"


class ReconstructionView(QWidget):
    """Let the person choose how to restore, and show the engine's result: a picture or a cube.

    `save_requested` is emitted when the person wants to save the restored picture or cube.
    """

    save_requested = Signal()

    def __init__(self, reconstruct: QAction, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.method = QComboBox(self)
        self.method.addItems([*METHODS, DECODER_TITLE])
        self._allow_decoder("")
        # On a small screen, the longest names are cut short.
        self.method.setMaximumWidth(self.method.sizeHint().width())
        shrinking = QComboBox.SizeAdjustPolicy.AdjustToMinimumContentsLengthWithIcon
        self.method.setSizeAdjustPolicy(shrinking)
        self.method.setMinimumContentsLength(_SHORT_NAME)
        self.method.setToolTip("Method: automatic takes what serves best in the time")
        self.budget = NumberBox(self, decimals=2, maximum=3600.0, singleStep=0.1)
        self.budget.setSuffix(" s")
        self.budget.setSpecialValueText("as usual")
        self.budget.setToolTip("Processor seconds that it may take")
        self.grey = QCheckBox("Grey", self)
        self.grey.setToolTip(
            "Of a sensor with colour filters, restore one grey band: for light of one colour"
        )
        self.bands = QCheckBox("Bands", self)
        self.bands.setToolTip(_BANDS_TIP)
        self.band_list = QLineEdit(self)
        self.band_list.setPlaceholderText(_ALL_BANDS)
        self.band_list.setToolTip("Wavelengths in nm with commas between; all if it is empty")
        self._photograph_fields = self.method, make_label(self, "Time"), self.budget, self.grey
        self.start = make_tool_button(self, reconstruct)
        self.before = QPushButton("Before", self)
        self.before.setToolTip("While you hold it, the photograph before is all that is seen")
        self.save = QPushButton("Save …", self)
        self.picture = BeforeAfterView(self)
        self.note = make_label(self, _EMPTY, look="faint", wrap=True)
        self.spectra = SpectralView(self)
        self._pages = QStackedWidget(self)
        self._described, self._hint = _EMPTY, ""
        self.bands.toggled.connect(self._choose_bands)
        self.method.currentTextChanged.connect(self._choose_decoder)
        self.before.pressed.connect(lambda: self._show_before(True))
        self.before.released.connect(lambda: self._show_before(False))
        self.save.clicked.connect(self.save_requested)
        for button in (self.before, self.save):
            button.setEnabled(False)
        self._arrange()
        self._choose_bands(False)

    @property
    def choices(self) -> tuple[str, float | None, bool]:
        """Return method, processor seconds, None for the usual time, and whether grey is chosen."""
        title, grey = self.method.currentText(), self.grey.isChecked()
        if title == DECODER_TITLE:
            return DECODER, None, grey
        return METHODS[title], self.budget.value() or None, grey

    @property
    def wanted_bands(self) -> str | None:
        """Return the bands that the person typed, or "all"; None for a single photograph."""
        if not self.bands.isChecked():
            return None
        return self.band_list.text().strip() or "all"

    @property
    def shows_cube(self) -> bool:
        """Return whether a spectral cube is shown, and not a restored photograph."""
        return self._pages.currentWidget() is self.spectra

    def show_result(self, result: ReconstructionResult) -> None:
        self.picture.show_before_after(result.before, result.after)
        self._described = describe_result(result)
        self.note.setText(self._described + self._hint)
        self.note.setToolTip(plain_tip(str(result.path)))
        self._pages.setCurrentIndex(0)
        self._enable_buttons()

    def show_record(self, record: RecordOpened) -> None:
        """Show a record as it is: a raw frame, and what else it holds."""
        if record.picture is not None:
            self.picture.show_single(record.picture)
        shown = f" Shown: {record.frame}." if record.frame else ""
        why = f" Not restored: {record.why_not_restored}." if record.why_not_restored else ""
        self._described = f"{record.summary}{shown}{why}"
        self.note.setText(self._described + self._hint)
        self.note.setToolTip(plain_tip(str(record.path)))
        self._pages.setCurrentIndex(0)

    def show_cube(self, result: SpectralResult) -> None:
        self._pages.setCurrentWidget(self.spectra)
        self.spectra.show_result(result)
        self._enable_buttons()

    def show_bands(self, found: RecordBands) -> None:
        """Show the bands of a record, and say where they can be restored."""
        several = len(found.wavelengths) > 1
        listed = ", ".join(f"{one * 1e9:.4g}" for one in found.wavelengths)
        self.band_list.setPlaceholderText(f"all: {listed} nm" if several else _ALL_BANDS)
        self.bands.setToolTip(f"{_BANDS_TIP}: {listed} nm" if several else _BANDS_TIP)
        self._hint = (
            f" {found.path.name} has the coded photograph at {len(found.wavelengths)} wavelengths: "
            "tick Bands to restore a spectral cube (F7)."
            if several
            else ""
        )
        self._allow_decoder(found.decoder)
        self.note.setText(self._described + self._hint)

    def _allow_decoder(self, decoder: str) -> None:
        """Offer the decoder of the design file of this name; "" offers none."""
        index = self.method.findText(DECODER_TITLE)
        model = self.method.model()
        assert isinstance(model, QStandardItemModel)
        model.item(index).setEnabled(bool(decoder))
        model.item(index).setToolTip(plain_tip(f"Blind, by {decoder}") if decoder else _NO_DECODER)
        if not decoder and self.method.currentIndex() == index:
            self.method.setCurrentIndex(0)

    def _choose_decoder(self, title: str) -> None:
        """Disable the field for the time where a decoder is chosen, which has one time."""
        self.budget.setEnabled(title != DECODER_TITLE)

    def _choose_bands(self, on: bool) -> None:
        """Show the fields that count for a cube, or those for a photograph."""
        self.band_list.setVisible(on)
        for field in self._photograph_fields:
            field.setVisible(not on)

    def _show_before(self, on: bool) -> None:
        self.picture.show_only_before(on)
        self.spectra.show_only_snapshot(on)

    def _enable_buttons(self) -> None:
        for button in (self.before, self.save):
            button.setEnabled(True)

    def _arrange(self) -> None:
        photograph = (self.method, 1), *self._photograph_fields[1:]
        choices = self.bands, (self.band_list, 1), *photograph, self.start
        bar = fill_layout(QHBoxLayout(), *choices, self.before, self.save, spacing=4)
        single = QWidget(self)
        fill_layout(QVBoxLayout(single), (self.picture, 1), self.note, spacing=4)
        for page in (single, self.spectra):
            self._pages.addWidget(page)
        fill_layout(QVBoxLayout(self), bar, (self._pages, 1), margins=(0, 4, 0, 0), spacing=4)


def describe_result(result: ReconstructionResult) -> str:
    """Describe a reconstruction in a few sentences."""
    weight = "" if result.weight is None else f", weight {result.weight:.3g}"
    scores = ""
    if result.scores is not None:
        (before, was), (after, now) = result.scores
        scores = (
            f"Against the neutral photograph PSNR {before:.1f} to {after:.1f} dB, "
            f"SSIM {was:.3f} to {now:.3f}. "
        )
    noise = f"Noise {result.noise:.3g} {result.unit}, {result.noise_source}. "
    steps = "" if result.iterations is None else f"{result.iterations} iterations in "
    judged = f"{result.verdict} " if result.verdict else ""
    if result.residual is not None:
        judged = f"Residual {result.residual:.2f} of the noise, {result.verdict}. "
    return (
        f"{result.source}: {result.method}{weight}, {steps}{result.cpu_seconds:.2f} s of processor "
        f"time. {scores}{noise}{judged}{_HANDLING}"
    )


_HANDLING = "Drag the divider; zoom with the wheel, double-click to fit."
