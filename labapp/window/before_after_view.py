"""A photograph before and after reconstruction, with a divider to drag."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyqtgraph as pg
from numpy.typing import NDArray
from PySide6.QtCore import QSignalBlocker
from PySide6.QtWidgets import QWidget

from labapp.window import tone_mapping
from labapp.window.picture_view import PictureView
from labapp.window.theme import ACCENT
from labapp.window.widgets import make_label


class BeforeAfterView(PictureView):
    """Show the photograph before reconstruction left of a divider, and the restored one right."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._before: NDArray[np.uint8] | None = None
        self._after: NDArray[np.uint8] | None = None
        self._palette = tone_mapping.build_palette(mark_clipping=False)
        self._only_before = False
        pen, grabbed = (pg.mkPen(ACCENT, width=width) for width in (2, 4))
        self.divider = pg.InfiniteLine(0, angle=90, movable=True, pen=pen, hoverPen=grabbed)
        self.divider.setZValue(10)
        self.divider.hide()
        self.box.addItem(self.divider, ignoreBounds=True)
        self.divider.sigPositionChanged.connect(self._redraw)
        self.captions = [make_label(self, text, look="caption") for text in ("before", "after")]
        for caption in self.captions:
            caption.adjustSize()
            caption.hide()

    def show_before_after(self, before: NDArray[np.uint8], after: NDArray[np.uint8]) -> None:
        """Show two pictures of one shape, (rows, columns[, 3]) uint8, beside a divider."""
        columns = before.shape[1]
        self._before, self._after = before, after
        with QSignalBlocker(self.divider):
            self.divider.setBounds((0, columns))
            self.divider.setValue(columns / 2)
        self.divider.show()
        for caption in self.captions:
            caption.show()
        self._redraw()
        self.fit()

    def show_single(self, picture: NDArray[np.uint8]) -> None:
        """Show one picture that hasn't been restored, (rows, columns) uint8."""
        self.show_before_after(picture, picture)
        self.divider.hide()
        for caption in self.captions:
            caption.hide()

    def show_only_before(self, on: bool) -> None:
        """Show only the picture before reconstruction, or both pictures again."""
        self._only_before = on
        self._redraw()

    def resizeEvent(self, event: Any) -> None:
        super().resizeEvent(event)
        self.captions[0].move(8, 8)
        self.captions[1].move(self.width() - self.captions[1].width() - 8, 8)

    def _redraw(self) -> None:
        if self._before is None or self._after is None:
            return
        at = self._before.shape[1] if self._only_before else round(self.divider.value())
        both = np.concatenate([self._before[:, :at], self._after[:, at:]], axis=1)
        self.show_indices(both, self._palette)
        self.captions[1].setVisible(self.divider.isVisible() and not self._only_before)
