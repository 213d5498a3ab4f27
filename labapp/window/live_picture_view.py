"""A view of live frames, which knows what part of a frame it shows, and how large."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from PySide6.QtCore import Signal
from PySide6.QtWidgets import QWidget

from labapp.window.frame_item import FrameItem
from labapp.window.frame_reduction import ReducedFrame, Region
from labapp.window.picture_view import PictureView


class LivePictureView(PictureView):
    """Show frames that were reduced to what is visible of them.

    `view_changed` is emitted when another part of the frame is visible, or another size of it.
    `painted` is emitted when a frame is on the screen.
    """

    view_changed = Signal()
    painted = Signal()

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._frame = FrameItem()
        self.box.removeItem(self._item)
        self.box.addItem(self._frame)
        self._frame.painted.connect(self.painted)
        self.box.sigRangeChanged.connect(self.view_changed)
        self.box.sigResized.connect(self.view_changed)

    def set_frame_shape(self, shape: tuple[int, int]) -> None:
        """Make room for frames of some rows and columns; another shape is fitted to the view."""
        if shape != self._shape:
            self._shape = shape
            self.fit()

    def show_reduced(
        self, shown: ReducedFrame, shape: tuple[int, int], palette: NDArray[np.uint8]
    ) -> None:
        """Show what is visible of a frame; the whole one has `shape` (rows, columns)."""
        self._frame.show_reduced(shown, shape, palette)
        self.set_frame_shape(shape)

    @property
    def visible_region(self) -> tuple[Region | None, tuple[int, int]]:
        """Return the visible part of the frame, and its size in screen pixels.

        The part is None if it is the whole frame, or if there is no frame.
        """
        (left, right), (top, bottom) = self.box.viewRange()
        rows, columns = self._shape
        first_row, first_column = max(0, math.floor(top)), max(0, math.floor(left))
        high = min(rows, math.ceil(bottom)) - first_row
        wide = min(columns, math.ceil(right)) - first_column
        if high <= 0 or wide <= 0:
            return None, (1, 1)
        across, down = self.box.viewPixelSize()
        density = self.devicePixelRatioF()
        size = max(1, round(high * density / down)), max(1, round(wide * density / across))
        whole = (high, wide) == self._shape
        return None if whole else (first_row, first_column, high, wide), size
