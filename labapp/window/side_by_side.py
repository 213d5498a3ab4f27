"""Neutral, coded and reconstructed photographs side by side, zoomed together."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from PySide6.QtCore import QSize
from PySide6.QtWidgets import QGridLayout, QLabel, QVBoxLayout, QWidget

from labapp.window import tone
from labapp.window.label import label
from labapp.window.messages import Reconstructed
from labapp.window.picture import Picture
from labapp.window.thumbnail import Thumbnail

_TITLES = {
    "neutral": "Neutral (reference)",
    "coded": "Coded",
    "earlier": "By another method before",
    "after": "Reconstructed",
}
_DECADES = 4
_INSET = 104
_EMPTY = "Nothing is reconstructed yet: acquire a bracket (F6), then reconstruct it (F7)."


class SideBySide(QWidget):
    """Four pictures on one scale, figures of merit beside each, and the measured PSF.

    The PSF stands in a corner of the coded picture, which it explains. The last reconstruction by
    another method stays beside the new one, as long as it is of the same run.
    """

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._last: Reconstructed | None = None
        self._earlier: Reconstructed | None = None
        self.pictures = {name: Picture(self) for name in _TITLES}
        self.titles = {name: label(self, title) for name, title in _TITLES.items()}
        self.psf = Thumbnail(QSize(_INSET, _INSET), self.pictures["coded"])
        self.psf.setFixedSize(_INSET, _INSET)
        self.psf.setToolTip(f"PSF, {_DECADES} decades from its peak")
        self.psf.move(6, 6)
        self.psf.hide()
        self.note = label(self, _EMPTY, look="faint", wrap=True)
        grid = QGridLayout(self)
        grid.setContentsMargins(0, 0, 0, 0)
        grid.setSpacing(4)
        for number, name in enumerate(_TITLES):
            row, column = divmod(number, 2)
            grid.addWidget(_titled(self.titles[name], self.pictures[name]), row, column)
            grid.setRowStretch(row, 1)
            grid.setColumnStretch(column, 1)
            if name != "neutral":
                self.pictures[name].link(self.pictures["neutral"])
        grid.addWidget(self.note, 2, 0, 1, 2)

    def show_result(self, result: Reconstructed) -> None:
        if self._last is not None and self._last.method != result.method:
            self._earlier = self._last
        if self._earlier is not None and self._earlier.path != result.path:
            self._earlier = None
        self._last = result
        was = None if result.scores is None else result.scores[0]
        self._show("coded", _TITLES["coded"], result.before, was)
        self._show("neutral", _TITLES["neutral"], result.neutral, None)
        for name, one in (("after", result), ("earlier", self._earlier)):
            if one is None:
                self._show(name, _TITLES[name], None, None)
            else:
                now = None if one.scores is None else one.scores[1]
                self._show(name, one.method, one.after, now)
        self.psf.show_grey(_logarithmic(result.psf))
        self.psf.show()
        self.pictures["coded"].fit()
        self.note.setText(
            "PSNR and SSIM are against the neutral picture, over the central 90 %; its white is "
            f"their peak and range, and white on the screen. Inset: PSF over {_DECADES} decades. "
            "Zoom one and all follow; double-click to fit."
        )

    def _show(
        self,
        name: str,
        title: str,
        picture: NDArray[np.uint8] | None,
        score: tuple[float, float] | None,
    ) -> None:
        """A picture in its place; black where there is none."""
        assert self._last is not None
        shown = np.zeros_like(self._last.before) if picture is None else picture
        self.pictures[name].show_indices(shown, tone.palette(marked=False))
        title = title[0].upper() + title[1:]
        if picture is None:
            title += ": none"
        if score is not None:
            title += f":&nbsp; <b>{score[0]:.1f} dB</b> PSNR,&nbsp; <b>{score[1]:.3f}</b> SSIM"
        self.titles[name].setText(title)


def _titled(title: QLabel, picture: Picture) -> QWidget:
    widget = QWidget()
    layout = QVBoxLayout(widget)
    layout.setContentsMargins(0, 2, 0, 0)
    layout.setSpacing(2)
    layout.addWidget(title)
    layout.addWidget(picture, 1)
    return widget


def _logarithmic(psf: NDArray[np.float32]) -> NDArray[np.uint8]:
    share = np.maximum(psf / psf.max(), 10.0**-_DECADES)
    return np.rint(255 * (np.log10(share) / _DECADES + 1)).astype(np.uint8)
