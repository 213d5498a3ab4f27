"""Before and after: neutral, coded and restored photographs side by side, zoomed together."""

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
    "richardson-lucy": "Richardson-Lucy",
    "total-variation": "Total variation",
}
_PLACES = {"neutral": (0, 0), "coded": (0, 1), "richardson-lucy": (1, 0), "total-variation": (1, 1)}
_GAMMA = 2.2
_DECADES = 4
_INSET = 104
_EMPTY = "Nothing is reconstructed yet: acquire a bracket (F6), then reconstruct it (F7)."


class ReconstructionView(QWidget):
    """Four pictures on one scale, figures of merit beside each, and the measured PSF.

    The PSF stands in a corner of the coded picture, which it explains.
    """

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.pictures = {name: Picture(self) for name in _TITLES}
        self.titles = {name: label(self, title) for name, title in _TITLES.items()}
        self.psf = Thumbnail(QSize(_INSET, _INSET), self.pictures["coded"])
        self.psf.setFixedSize(_INSET, _INSET)
        self.psf.setToolTip(f"Measured PSF, {_DECADES} decades from its peak")
        self.psf.move(6, 6)
        self.psf.hide()
        self.note = label(self, _EMPTY, look="faint", wrap=True)
        grid = QGridLayout(self)
        grid.setContentsMargins(0, 0, 0, 0)
        grid.setSpacing(4)
        for name, (row, column) in _PLACES.items():
            grid.addWidget(_titled(self.titles[name], self.pictures[name]), row, column)
            grid.setRowStretch(row, 1)
            grid.setColumnStretch(column, 1)
            if name != "neutral":
                self.pictures[name].link(self.pictures["neutral"])
        grid.addWidget(self.note, 2, 0, 1, 2)

    def show_result(self, result: Reconstructed) -> None:
        palette = tone.palette(marked=False)
        for name, picture in self.pictures.items():
            picture.show_indices(_visible(result.images[name]), palette)
            self.titles[name].setText(_title(name, result.scores))
        self.psf.show_grey(_logarithmic(result.psf))
        self.psf.show()
        self.pictures["neutral"].fit()
        self.note.setText(
            "PSNR (peak 1) and SSIM (range 1) are against the neutral picture. All from 0 to 1, "
            f"gamma {_GAMMA}. Inset: measured PSF over {_DECADES} decades. Zoom one and all "
            "follow; double-click to fit."
        )


def _title(name: str, scores: dict[str, tuple[float, float]]) -> str:
    if name not in scores:
        return _TITLES[name]
    psnr, ssim = scores[name]
    return f"{_TITLES[name]}:&nbsp; <b>{psnr:.1f} dB</b> PSNR,&nbsp; <b>{ssim:.3f}</b> SSIM"


def _titled(title: QLabel, picture: Picture) -> QWidget:
    widget = QWidget()
    layout = QVBoxLayout(widget)
    layout.setContentsMargins(0, 2, 0, 0)
    layout.setSpacing(2)
    layout.addWidget(title)
    layout.addWidget(picture, 1)
    return widget


def _visible(image: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Linear light from 0 to 1 as the screen shows it."""
    return np.rint(255 * np.clip(image, 0, 1) ** (1 / _GAMMA)).astype(np.uint8)


def _logarithmic(psf: NDArray[np.float32]) -> NDArray[np.uint8]:
    share = np.maximum(psf / psf.max(), 10.0**-_DECADES)
    return np.rint(255 * (np.log10(share) / _DECADES + 1)).astype(np.uint8)
