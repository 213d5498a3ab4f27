"""The pattern chooser: what it would look like on the SLM, and the PSF that it would give."""

from __future__ import annotations

from PySide6.QtCore import QSize, QTimer, Signal
from PySide6.QtWidgets import QHBoxLayout, QPushButton, QVBoxLayout, QWidget

from labapp.window.messages import PatternPreview, PatternTable
from labapp.window.parts import OF_A_PANEL, fill, label, mark
from labapp.window.pattern_form import PatternForm
from labapp.window.thumbnail import Thumbnail

_PAUSE = 300
"""Milliseconds without a change before a preview is computed."""

_DECADES = 4


class PatternPanel(QWidget):
    """preview_asked, show_asked: the chosen pattern, as a plan file writes it."""

    preview_asked = Signal(dict)
    show_asked = Signal(dict)

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.form = PatternForm(self)
        self.grey = Thumbnail(QSize(288, 162), self)
        self.psf = Thumbnail(QSize(150, 150), self)
        self.note = label(self, look="faint", wrap=True)
        self.shown = label(self, "On the SLM: –", look="shown", wrap=True)
        self.show_button = QPushButton("Show on SLM", self)
        self._wavelength_nm = 550.0
        self._chosen = self._on_panel = ""
        self._pause = QTimer(self, singleShot=True, interval=_PAUSE)
        self._pause.timeout.connect(self._ask)
        self.form.changed.connect(self.refresh)
        self.show_button.clicked.connect(lambda: self.show_asked.emit(self.table()))
        below = fill(QHBoxLayout(), (self.psf, 1), (self.note, 1))
        parts = self.form, (self.grey, 1), (below, 1), self.show_button, self.shown
        fill(QVBoxLayout(self), *parts, margins=OF_A_PANEL, spacing=5)

    def table(self) -> PatternTable:
        return self.form.table(self._wavelength_nm)

    def set_wavelength(self, nanometres: float) -> None:
        """Design for this wavelength from now on; what the SLM shows stays as it is."""
        if nanometres != self._wavelength_nm:
            self._wavelength_nm = nanometres
            self.refresh()

    def set_in_run(self, on: bool) -> None:
        """A run has the SLM; a pattern can be chosen for the bracket that follows."""
        self.show_button.setEnabled(not on)

    def refresh(self) -> None:
        """Compute the preview once nothing has changed for a moment."""
        self.note.setText("computing the preview …")
        self._pause.start()

    def show_preview(self, preview: PatternPreview) -> None:
        """Draw a preview, unless something else has been chosen since."""
        if preview.pattern != self.table():
            return
        self._chosen = preview.name
        self._compare()
        self.grey.show_grey(preview.grey)
        self.psf.show_decades(preview.psf, _DECADES)
        side = preview.psf.shape[0]
        self.note.setText(
            f"Predicted PSF at {self._wavelength_nm:g} nm: {side} px wide, {_DECADES} decades. "
            f"Its brightest pixel gets {100 * preview.peak:.3g} % of the light."
        )

    def show_failed(self) -> None:
        """No preview came: leave nothing on the screen that isn't the chosen pattern."""
        if self.note.text().startswith("computing"):
            self.note.setText("no preview")
            self.grey.clear()
            self.psf.clear()

    def show_shown(self, name: str) -> None:
        self._on_panel = name
        self._compare()

    def _compare(self) -> None:
        """Say what the SLM shows, in another colour where it isn't what is chosen here."""
        self.shown.setText(f"On the SLM: {self._on_panel}")
        mark(self.shown, self._chosen not in ("", self._on_panel))

    def _ask(self) -> None:
        if self.form.lacks:
            self.note.setText(self.form.lacks)
            return
        self.preview_asked.emit(self.table())
