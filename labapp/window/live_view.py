"""The live picture with its settings, its pixel values and its histogram."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

from PySide6.QtCore import Qt, QTimer, Signal
from PySide6.QtWidgets import QHBoxLayout, QLabel, QVBoxLayout, QWidget

from labapp.window import tone_mapping
from labapp.window.duration_text import format_duration
from labapp.window.frame_rate import FrameRate
from labapp.window.frame_reduction import FrameView, ReducedFrame, reduce_frame
from labapp.window.histogram_view import HistogramView
from labapp.window.live_picture_view import LivePictureView
from labapp.window.messages import LiveFrame, LivePicture, PictureAwaited
from labapp.window.widgets import fill_layout, make_label


@dataclass(frozen=True)
class LiveViewSettings:
    """Tune how often things are drawn that a person can't read faster, and how long to wait.

    histogram_interval: least seconds between drawings of the histogram. The picture's contrast
        follows every frame. Chosen.
    rate_interval: milliseconds between the descriptions of the frame rate. Chosen.
    patience: milliseconds that a changed view waits for a frame that the engine reduced to it,
        before the window reduces the frame that it has. Chosen: two frames at 30 frames a second.
    painting_time: milliseconds after which a frame counts as shown although nothing was painted, as
        under another window. Chosen.
    """

    histogram_interval: float = 0.1
    rate_interval: int = 250
    patience: int = 60
    painting_time: int = 100


_SETTINGS = LiveViewSettings()

_EDGE = 8
"""Pixels between the view's edges and the texts over the picture. Chosen."""


class LiveView(QWidget):
    """Show live frames; every text about a frame uses values that came with that frame.

    `auto_contrast_changed` is emitted with False when dragging a level ends the auto contrast.
    `view_changed` is emitted with what the engine should send, and `frame_shown` when a frame is
    on the screen, so that the next one may come.
    """

    auto_contrast_changed = Signal(bool)
    view_changed = Signal(object)
    frame_shown = Signal()

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.picture = LivePictureView(self)
        self.caption = self._make_caption("no picture yet")
        self.caption.move(_EDGE, _EDGE)
        self.awaited = self._make_caption("", look="awaited")
        self.awaited.hide()
        self.rate_caption = self._make_caption("")
        self.rate_caption.hide()
        self.cursor_reading = make_label(self, look="readings")
        self.frame_reading = make_label(self, look="readings")
        self.histogram = HistogramView(self)
        self.histogram.levels_dragged.connect(self.set_levels)
        self._scale = tone_mapping.DigitalScale()
        self.levels = (0.0, float(self._scale.full_scale))
        self._auto = self._is_live = True
        self._is_stopped = False
        self._palette = tone_mapping.build_palette(mark_clipping=True)
        self._picture: LivePicture | None = None
        self._view = FrameView()
        self._rate = FrameRate()
        self._is_painting = False
        self._awaited_request = 0
        self._drawn = 0.0
        self._under_mouse = (-1, -1)
        self._make_timers()
        self.picture.pixel_hovered.connect(self._hover)
        self.picture.view_changed.connect(self._change_view)
        self.picture.painted.connect(self._note_painted)
        readings = fill_layout(QHBoxLayout(), (self.cursor_reading, 1), self.frame_reading)
        fill_layout(QVBoxLayout(self), (self.picture, 1), readings, self.histogram, spacing=2)

    @property
    def view(self) -> FrameView:
        """Return what is shown of live frames."""
        return self._view

    @property
    def frame(self) -> LiveFrame | None:
        """Return the raw frame shown, to be copied if kept; None if no camera has taken it."""
        picture = self._picture
        return None if picture is None or picture.is_prediction else picture.frame

    def set_scale(self, scale: tone_mapping.DigitalScale) -> None:
        self._scale = scale

    def set_auto_contrast(self, on: bool) -> None:
        """Set whether the contrast follows every frame or stays."""
        self._auto = on
        self._change_view()

    def set_clipping_marks(self, on: bool) -> None:
        """Set whether saturated and black pixels are shown in colour."""
        self._palette = tone_mapping.build_palette(mark_clipping=on)
        if self._picture is not None:
            self._show(self._picture.shown)

    def set_live(self, on: bool, *, in_run: bool = False) -> None:
        """Set whether live view is on, and whether a run is taking frames.

        Without either, no picture comes, and the last one is marked "STOPPED". One that was on its
        way changes nothing about that.
        """
        if not on:
            self.awaited.hide()
        self._is_live, self._is_stopped = on, not (on or in_run)
        if self._picture is not None:
            self._describe(self._picture)

    def show_picture(self, picture: LivePicture) -> None:
        """Show a live frame that the engine has reduced to the present view."""
        self._picture = picture
        if picture.request >= self._awaited_request and not picture.is_prediction:
            self.awaited.hide()
        self._show(picture.shown)
        self._describe(picture)
        self._hover(*self._under_mouse)
        self._is_painting = True
        if self.picture.isVisible():
            self._painting.start()
        else:
            self._note_painted()
        if picture.shown.view != self._view:
            self._patience.start()

    def show_awaited(self, awaited: PictureAwaited) -> None:
        """Say over the picture that it isn't that of the settings any more."""
        shown = 0 if self._picture is None else self._picture.request
        if not self._is_live or shown >= awaited.request:
            return
        self._awaited_request = awaited.request
        left = awaited.seconds_left
        if left is not None:
            rest = f", {format_duration(left)} left"
        else:
            rest = f", {awaited.elapsed:.0f} s so far" if awaited.elapsed >= 1 else ""
        old = self.frame is not None
        until = "  ·  this picture is of earlier settings" if old else ""
        self.awaited.setText(f"{awaited.activity} …{rest}{until}")
        self.awaited.adjustSize()
        self.awaited.move(_EDGE, self.caption.geometry().bottom() + 5)
        self.awaited.show()

    def _make_caption(self, text: str, look: str = "caption") -> QLabel:
        """Create a text over the picture, which the mouse doesn't feel."""
        caption = make_label(self.picture, text, look=look)
        caption.ensurePolished()
        caption.adjustSize()
        caption.setAttribute(Qt.WidgetAttribute.WA_TransparentForMouseEvents)
        return caption

    def _make_timers(self) -> None:
        self._patience = QTimer(self, singleShot=True, interval=_SETTINGS.patience)
        self._patience.timeout.connect(self._reduce_again)
        self._painting = QTimer(self, singleShot=True, interval=_SETTINGS.painting_time)
        self._painting.timeout.connect(self._note_painted)
        self._ageing = QTimer(self, interval=_SETTINGS.rate_interval)
        self._ageing.timeout.connect(self._describe_rate)
        self._ageing.start()

    def _change_view(self) -> None:
        """Tell the engine what is visible now, and with which contrast."""
        region, size = self.picture.visible_region
        view = FrameView(region, size, None if self._auto else self.levels)
        if view != self._view:
            self._view = view
            self.view_changed.emit(view)
            self._patience.start()

    def _reduce_again(self) -> None:
        """Reduce the present frame to a changed view: the next one may be far off."""
        picture = self._picture
        if picture is not None and picture.shown.view != self._view:
            shown = reduce_frame(picture.frame.image, self._view, self._scale)
            self._picture = replace(picture, shown=shown)
            self._show(shown)

    def _show(self, shown: ReducedFrame) -> None:
        assert self._picture is not None, "only a picture's part is shown"
        rows, columns = self._picture.frame.image.shape
        self.picture.show_reduced(shown, (rows, columns), self._palette)
        # A level that a person drags leads; frames on their way still have the one before.
        if self._auto or shown.view == self._view:
            self.levels = shown.levels
        now = time.monotonic()
        if now - self._drawn >= _SETTINGS.histogram_interval:
            self._drawn = now
            self.histogram.show_counts(shown.counts, shown.bin_width)
            self.histogram.show_levels(*self.levels)

    def _note_painted(self) -> None:
        """Note that the newest frame is on the screen."""
        if self._is_painting:
            self._is_painting = False
            self._painting.stop()
            if self.frame is not None:
                self._rate.count(time.monotonic())
            self.frame_shown.emit()

    def _describe(self, picture: LivePicture) -> None:
        """Write the frame's settings over the picture, and its share of saturated pixels below."""
        frame = picture.frame
        self.caption.setText(
            f"{frame.target}  ·  {frame.pattern}  ·  {frame.wavelength * 1e9:.2f} nm  ·  "
            f"{frame.exposure * 1e3:.3f} ms"
            + ("  ·  COARSE PREDICTION" if picture.is_prediction else "")
            + ("  ·  STOPPED" if self._is_stopped else "")
        )
        self.caption.adjustSize()
        clipped = picture.shown.saturated
        share = 100 * clipped / frame.image.size
        text = f"saturated {share:.3f} % ({clipped} px)   frame {frame.number}"
        self.frame_reading.setText("predicted, not measured" if picture.is_prediction else text)
        self._describe_rate()

    def _describe_rate(self) -> None:
        """Write how often frames come to the screen, and how many it doesn't get to see.

        The text stands over the picture, where it takes no room from the readings on small screens.
        """
        picture = self._picture
        self.rate_caption.setVisible(not self._is_stopped and picture is not None)
        if picture is None:
            return
        rate = self._rate.describe(time.monotonic())
        lost = f"dropped {picture.dropped}  ·  missed {picture.missed}"
        self.rate_caption.setText(f"{rate}  ·  {lost}" if rate else lost)
        self.rate_caption.adjustSize()
        below = self.picture.height() - self.rate_caption.height() - _EDGE
        self.rate_caption.move(_EDGE, below)

    @property
    def shown_number(self) -> int | None:
        """Return the camera's number of the picture that is shown; None without one."""
        return None if self.frame is None else self.frame.number

    def set_levels(self, low: float, high: float) -> None:
        self.levels = (low, high)
        if self._auto:
            self._auto = False
            self.auto_contrast_changed.emit(False)
        self._change_view()

    def _hover(self, row: int, column: int) -> None:
        self._under_mouse = (row, column)
        if self.frame is None or not self._is_inside(row, column):
            self.cursor_reading.setText("")
            return
        value = int(self.frame.image[row, column])
        share = 100 * value / self._scale.full_scale
        self.cursor_reading.setText(f"x {column}  y {row}   {value} DN   {share:.1f} %")

    def _is_inside(self, row: int, column: int) -> bool:
        """Return whether the live frame has this pixel; frame sizes differ by bench."""
        rows, columns = self.frame.image.shape if self.frame is not None else (0, 0)
        return 0 <= row < rows and 0 <= column < columns
