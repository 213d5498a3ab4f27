"""Neutral, coded and reconstructed photographs side by side."""

from __future__ import annotations

from html import escape

import numpy as np
from numpy.typing import NDArray
from PySide6.QtCore import QSize
from PySide6.QtGui import QShowEvent
from PySide6.QtWidgets import QGridLayout, QLabel, QVBoxLayout, QWidget

from labapp.window import tone_mapping
from labapp.window.messages import ReconstructionResult
from labapp.window.picture_view import PictureView
from labapp.window.thumbnail import PSF_DECADES, Thumbnail
from labapp.window.widgets import fill_layout, make_label

_TITLES = {
    "neutral": "Neutral (reference)",
    "coded": "Coded",
    "earlier": "Reconstructed before, by another method",
    "after": "Reconstructed",
}
_EMPTY = "Nothing is reconstructed yet: acquire a bracket (F6), then reconstruct it (F7)."


class SideBySide(QWidget):
    """Show four photographs on one scale, PSNR and SSIM of each, and the measured PSF.

    The PSF is shown in a corner of the coded picture, which it has blurred. The last
    reconstruction by another method stays beside the new one if both are of the same run.
    """

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._last_results: list[ReconstructionResult] = []
        self._is_outdated = False
        self.pictures = {name: PictureView(self) for name in _TITLES}
        self.titles = {name: make_label(self, title, rich=True) for name, title in _TITLES.items()}
        inset = QSize(104, 104)
        self.psf = Thumbnail(inset, self.pictures["coded"])
        self.psf.setFixedSize(inset)
        self.psf.setToolTip(f"PSF, {PSF_DECADES} decades from its peak")
        self.psf.move(6, 6)
        self.psf.hide()
        self.note = make_label(self, _EMPTY, look="faint", wrap=True)
        grid = QGridLayout(self)
        grid.setContentsMargins(0, 0, 0, 0)
        grid.setSpacing(4)
        for number, name in enumerate(_TITLES):
            row, column = divmod(number, 2)
            grid.addWidget(_with_title(self.titles[name], self.pictures[name]), row, column)
            grid.setRowStretch(row, 1)
            grid.setColumnStretch(column, 1)
            if name != "neutral":
                self.pictures[name].link(self.pictures["neutral"])
        grid.addWidget(self.note, 2, 0, 1, 2)

    def show_result(self, result: ReconstructionResult) -> None:
        others = [one for one in self._last_results if one.method != result.method]
        self._last_results = [*[one for one in others if one.path == result.path][-1:], result]
        self._is_outdated = True
        if self.isVisible():
            self._show_last()

    def showEvent(self, event: QShowEvent) -> None:
        super().showEvent(event)
        if self._is_outdated:
            self._show_last()

    def _show_last(self) -> None:
        """Show the last results; not before anybody looks, as large ones take long."""
        self._is_outdated = False
        result = self._last_results[-1]
        dark = np.zeros_like(result.before)
        self._show("neutral", dark if result.neutral is None else result.neutral)
        self._show("coded", result.before, result.scores and result.scores[0])
        self._show("earlier", dark)
        for name, one in zip(("after", "earlier"), reversed(self._last_results), strict=False):
            self._show(name, one.after, one.scores and one.scores[1], one.method)
        self.psf.show_decades(result.psf, PSF_DECADES)
        self.psf.show()
        self.pictures["coded"].fit()
        self.note.setText(
            "PSNR and SSIM are against the neutral picture, over the central 90 %; its white is "
            "their peak and range, and white on the screen. "
            f"Inset: PSF over {PSF_DECADES} decades. "
            "Zoom one and all follow; double-click to fit."
        )

    def _show(
        self,
        name: str,
        picture: NDArray[np.uint8],
        score: tuple[float, float] | None = None,
        title: str = "",
    ) -> None:
        self.pictures[name].show_indices(picture, tone_mapping.build_palette(mark_clipping=False))
        text = escape(title[:1].upper() + title[1:] or _TITLES[name])
        if score is not None:
            text += f":&nbsp; <b>{score[0]:.1f} dB</b> PSNR,&nbsp; <b>{score[1]:.3f}</b> SSIM"
        self.titles[name].setText(text)


def _with_title(title: QLabel, picture: PictureView) -> QWidget:
    widget = QWidget()
    fill_layout(QVBoxLayout(widget), title, (picture, 1), margins=(0, 2, 0, 0), spacing=2)
    return widget
