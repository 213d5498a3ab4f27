"""The window's live view: the picture, its settings, its pixel values and its histogram."""

from __future__ import annotations

import time
from collections import deque
from dataclasses import dataclass

import numpy as np
from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QHBoxLayout, QVBoxLayout, QWidget

from labapp.window import tone_mapping
from labapp.window.histogram_view import HistogramView
from labapp.window.messages import LiveFrame
from labapp.window.picture_view import PictureView
from labapp.window.widgets import fill_layout, make_label


@dataclass(frozen=True)
class LiveViewSettings:
    """Set how often the live view updates its histogram and over what it averages its frame rate.

    Attributes
    ----------
    histogram_interval : float
        Least seconds between drawings of the histogram. The picture's contrast follows every
        frame. Chosen.
    rate_frames : int
        Most frames over which the frame rate is averaged. Chosen.
    rate_span : float
        Seconds before the last frame from which on frames count for the frame rate. Chosen.
    """

    histogram_interval: float = 0.1
    rate_frames: int = 20
    rate_span: float = 1.0


_SETTINGS = LiveViewSettings()


class LiveView(QWidget):
    """Show live frames; every text about a frame uses values that came with that frame.

    `auto_contrast_changed` is emitted with False when dragging a level ends the auto contrast.
    """

    auto_contrast_changed = Signal(bool)

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.picture = PictureView(self)
        self.caption = make_label(self.picture, "no picture yet", look="caption")
        self.caption.move(8, 8)
        self.caption.ensurePolished()
        self.caption.adjustSize()
        self.caption.setAttribute(Qt.WidgetAttribute.WA_TransparentForMouseEvents)
        self.cursor_reading = make_label(self, look="readings")
        self.frame_reading = make_label(self, look="readings")
        self._histogram = HistogramView(self)
        self._histogram.levels_dragged.connect(self.set_levels)
        self._scale = tone_mapping.DigitalScale()
        self.levels = (0.0, float(self._scale.full_scale))
        self._auto = True
        self._running = True
        self._palette = tone_mapping.build_palette(mark_clipping=True)
        self._frame: LiveFrame | None = None
        self._arrivals: deque[float] = deque(maxlen=_SETTINGS.rate_frames)
        self._drawn = 0.0
        self._under_mouse = (-1, -1)
        self.picture.pixel_hovered.connect(self._hover)
        readings = fill_layout(QHBoxLayout(), (self.cursor_reading, 1), self.frame_reading)
        fill_layout(QVBoxLayout(self), (self.picture, 1), readings, self._histogram, spacing=2)

    def set_scale(self, scale: tone_mapping.DigitalScale) -> None:
        self._scale = scale

    def set_auto_contrast(self, on: bool) -> None:
        """Set whether the contrast of the window's live view follows every frame or stays."""
        self._auto = on
        self._redraw()

    def set_clipping_marks(self, on: bool) -> None:
        """Set whether the window's live view shows saturated and black pixels in colour."""
        self._palette = tone_mapping.build_palette(mark_clipping=on)
        self._redraw()

    def set_running(self, on: bool) -> None:
        """Set whether the window's live view runs; if not, the last frame is marked "STOPPED"."""
        self._running = on
        if self._frame is not None:
            self._describe(self._frame)

    def show_frame(self, frame: LiveFrame) -> None:
        self._frame, self._running = frame, True
        self._arrivals.append(time.monotonic())
        self._redraw()
        self._describe(frame)
        self._hover(*self._under_mouse)

    def _redraw(self) -> None:
        if self._frame is None:
            return
        image = self._frame.image
        counts, width = tone_mapping.histogram(image, self._scale)
        if self._auto:
            self.levels = tone_mapping.auto_levels(counts, width)
        indices = tone_mapping.index_picture(image, self.levels, self._scale)
        visible = tone_mapping.spread_saturated(indices, self.picture.reduction)
        self.picture.show_indices(visible, self._palette)
        now = time.monotonic()
        if now - self._drawn >= _SETTINGS.histogram_interval:
            self._drawn = now
            self._histogram.show_counts(counts, width)
            self._histogram.show_levels(*self.levels)

    def _describe(self, frame: LiveFrame) -> None:
        """Write the live frame's settings over the window's picture, and saturation and rate below.

        The saturation is the share of saturated pixels.
        """
        self.caption.setText(
            f"{frame.target}  ·  {frame.pattern}  ·  {frame.wavelength * 1e9:.2f} nm  ·  "
            f"{frame.exposure * 1e3:.3f} ms" + ("" if self._running else "  ·  STOPPED")
        )
        self.caption.adjustSize()
        clipped = int(np.count_nonzero(frame.image >= self._scale.full_scale))
        share = 100 * clipped / frame.image.size
        rate = f"   {self._rate():4.1f} fps" if self._running else ""
        self.frame_reading.setText(
            f"saturated {share:.3f} % ({clipped} px)   frame {frame.number}{rate}"
        )

    def _rate(self) -> float:
        """Return the window's live frames per second, averaged over about a second.

        After a pause, the count starts anew.
        """
        recent = [t for t in self._arrivals if self._arrivals[-1] - t < _SETTINGS.rate_span]
        span = recent[-1] - recent[0]
        return (len(recent) - 1) / span if span > 0 else 0.0

    def set_levels(self, low: float, high: float) -> None:
        self.levels = (low, high)
        if self._auto:
            self._auto = False
            self.auto_contrast_changed.emit(False)
        self._redraw()

    def _hover(self, row: int, column: int) -> None:
        self._under_mouse = (row, column)
        if self._frame is None or not self._is_inside(row, column):
            self.cursor_reading.setText("")
            return
        value = int(self._frame.image[row, column])
        share = 100 * value / self._scale.full_scale
        self.cursor_reading.setText(f"x {column}  y {row}   {value} DN   {share:.1f} %")

    def _is_inside(self, row: int, column: int) -> bool:
        """Return whether the window's live frame has this pixel; frame sizes differ by bench."""
        rows, columns = self._frame.image.shape if self._frame is not None else (0, 0)
        return 0 <= row < rows and 0 <= column < columns
