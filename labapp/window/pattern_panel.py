"""The pattern chooser, with previews of the grey levels on the SLM and of the PSF."""

from __future__ import annotations

from PySide6.QtCore import QSize, QTimer, Signal
from PySide6.QtWidgets import QHBoxLayout, QPushButton, QVBoxLayout, QWidget

from labapp.window.commands import PatternTable
from labapp.window.messages import PatternPreview
from labapp.window.pattern_form import PatternForm
from labapp.window.theme import DIFFERS_SIGN
from labapp.window.thumbnail import PSF_DECADES, Thumbnail
from labapp.window.widgets import (
    BEGINS,
    PANEL_MARGINS,
    fill_layout,
    make_label,
    mark_difference,
)


class PatternPanel(QWidget):
    """Let the person choose a pattern for the SLM, and show its preview.

    `preview_requested` and `show_requested` are emitted with the chosen pattern in the form of a
    plan file.
    """

    preview_requested = Signal(dict)
    show_requested = Signal(dict)

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.form = PatternForm(self)
        self.grey = Thumbnail(QSize(144, 81), self)
        self.psf = Thumbnail(QSize(75, 75), self)
        self.note = make_label(self, look="faint", wrap=True)
        self.displayed_label = make_label(self, "On the SLM: –", look="shown", wrap=True)
        self.show_button = QPushButton("Show on SLM", self)
        self.show_button.setProperty(BEGINS, True)
        self._wavelength_nm = 550.0
        self._chosen = self._on_panel = ""
        self._showing_allowed = self._has_preview = False
        # A preview is computed once nothing has changed for 300 ms.
        self._pause = QTimer(self, singleShot=True, interval=300)
        self._pause.timeout.connect(self._request_preview)
        self.form.changed.connect(self.schedule_preview)
        self.form.edited.connect(self._mark_outdated)
        self.show_button.clicked.connect(lambda: self.show_requested.emit(self.pattern_table()))
        below = fill_layout(QHBoxLayout(), (self.psf, 1), (self.note, 1))
        # On a small screen, the pictures are what is out of sight, and not the button.
        parts = self.form, self.show_button, self.displayed_label, (self.grey, 1), (below, 1)
        fill_layout(QVBoxLayout(self), *parts, margins=PANEL_MARGINS, spacing=5)

    def pattern_table(self) -> PatternTable:
        return self.form.pattern_table(self._wavelength_nm)

    def set_wavelength(self, nanometres: float) -> None:
        """Design patterns for this wavelength from now on; the SLM's pattern stays."""
        if nanometres != self._wavelength_nm:
            self._wavelength_nm = nanometres
            self.schedule_preview()

    def set_showing_allowed(self, on: bool) -> None:
        """Enable "Show on SLM" if the bench is free and the pattern is complete.

        A file must have been read for a preview. The next pattern can be chosen in any case.
        """
        self._showing_allowed = on
        known = not self.form.missing_input and (self._has_preview or not self.form.needs_file)
        self.show_button.setEnabled(on and known)

    def schedule_preview(self) -> None:
        """Request a preview when no setting has changed for a moment.

        Until it comes, the preview before is faint. A pattern that isn't complete has none.
        """
        self._mark_outdated()
        if missing := self.form.missing_input:
            self._pause.stop()
            self.note.setText(missing)
            self._clear_preview()
            return
        self.note.setText("computing the preview …")
        self._pause.start()

    def show_preview(self, preview: PatternPreview) -> None:
        """Show a pattern's preview, unless another pattern has been chosen since."""
        if preview.pattern != self.pattern_table():
            return
        self._chosen = preview.name
        self._compare()
        self._has_preview = True
        self.set_showing_allowed(self._showing_allowed)
        self.grey.show_grey(preview.grey)
        self.psf.show_decades(preview.psf, PSF_DECADES)
        side = preview.psf.shape[0]
        self.note.setText(
            f"Predicted PSF at {self._wavelength_nm:g} nm: {side} px wide, {PSF_DECADES} decades. "
            f"Its brightest pixel gets {100 * preview.peak:.3g} % of the light."
        )

    def show_no_preview(self) -> None:
        """Clear the preview of an earlier pattern, as the requested one didn't come."""
        if self.note.text().startswith("computing"):
            self.note.setText("no preview")
            self._clear_preview()

    def show_displayed(self, name: str) -> None:
        self._on_panel = name
        self._compare()

    def _compare(self) -> None:
        """Name the SLM's pattern; sign and colour tell if it isn't the chosen one."""
        differs = self._chosen not in ("", self._on_panel)
        sign = f"{DIFFERS_SIGN} " if differs else ""
        self.displayed_label.setText(f"{sign}On the SLM: {self._on_panel}")
        mark_difference(self.displayed_label, differs)

    def _mark_outdated(self) -> None:
        """Show the preview faintly, as that of the pattern before."""
        self._has_preview = False
        self.set_showing_allowed(self._showing_allowed)
        for thumbnail in (self.grey, self.psf):
            thumbnail.set_outdated(True)

    def _clear_preview(self) -> None:
        self._chosen = ""
        self._compare()
        self.grey.clear()
        self.psf.clear()

    def _request_preview(self) -> None:
        self.preview_requested.emit(self.pattern_table())
