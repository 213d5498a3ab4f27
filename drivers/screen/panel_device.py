"""Serve the calls of `ScreenSLM` in the window's process.

Times are seconds of time.monotonic(). Between two calls, Qt's event loop plays the video and
receives events of screens that are plugged in or out.
"""

from __future__ import annotations

import contextlib
import os
import time
from collections.abc import Iterator
from typing import TYPE_CHECKING, Self

import numpy as np
from numpy.typing import NDArray

from drivers.errors import DeviceError
from drivers.interfaces import Identity, Surroundings
from drivers.screen.panel_screen import PanelScreen, panel_name
from drivers.screen.player import Presentations
from drivers.screen.screen_choice import ScreenRequest
from drivers.screen.session import ServerGone
from drivers.x11 import XError, XServerGone

if TYPE_CHECKING:
    from PySide6.QtGui import QImage

    from drivers.screen.video import VideoPlayback

_NEUTRAL = "neutral"

_LOOK_MS = 200
"""Milliseconds between looks at all that is sent to the SLM. Chosen: the X server reports changes
of most of it."""

_RAMP_LOOK_MS = 20
"""Milliseconds between looks at the gamma ramp under a still. The X server reports no change of it:
RandR has no event for gamma, nor has XF86VidMode. Chosen: one look takes about 0.1 ms."""


class PanelDevice:
    """Show patterns, as a device that `HostedDevice` runs in a child process.

    The options are those of `ScreenSLM`, which has checked them.
    """

    def __init__(
        self,
        surroundings: Surroundings,
        model: str,
        request: ScreenRequest,
        display: str | None,
        allow_ramp: bool,
    ) -> None:
        self._model, self._wanted = model, request
        self._display, self._allow_ramp = display, allow_ramp
        self._stage: PanelScreen | None = None
        self._video: VideoPlayback | None = None
        self._frames: list[NDArray[np.uint8]] = []
        self._images: list[QImage] = []
        self._shown = _NEUTRAL
        self._pending_error: DeviceError | None = None
        self._lost = self._played = self._missed = self._looks = 0

    def __enter__(self) -> Self:
        with self._translate_x_errors("open"):
            self._stage = PanelScreen(self._model, self._wanted, self._display, self._allow_ramp)
            self._frames = [self._stage.neutral]
            self._model = panel_name(self._stage.output)
        return self

    def __exit__(self, *error: object) -> None:
        if self._stage is not None:
            with contextlib.suppress(DeviceError):
                self.make_safe()
            self._stage.close()
            self._stage = None

    @property
    def identity(self) -> Identity:
        return Identity(self._model, self._open_stage.output.monitor.serial, simulated=False)

    @property
    def frame_time(self) -> float:
        return 1 / (self._open_stage.output.refresh or self._wanted.refresh_hz)

    def displayed_pattern(self) -> str:
        """Return the identifier of the pattern that is shown.

        A still pattern is read back. Raises DeviceError if the screen is gone or shows something
        else, or if its signal was changed since the pattern was shown.
        """
        self._require_screen("shown")
        self._raise_pending_error()
        if self._shown:
            with self._translate_x_errors("shown"):
                self._open_stage.check_signal(f"show {self._shown}")
                if self._video is None:
                    self._open_stage.check(f"show {self._shown}", self._frames[0])
        return self._shown

    def settings(self) -> tuple[str, ...]:
        """Return what was set at the connector since it was opened."""
        return tuple(self._open_stage.signal.settings.values())

    def notes(self) -> list[str]:
        """Return what was set or has happened, each once."""
        if self._stage is None:
            return []
        told, self._stage.signal.notes = self._stage.signal.notes, []
        return told

    def prepare_to_show(self, command: str) -> None:
        """Stop the video, and set right what is sent, before a new pattern."""
        self._require_screen(command)
        self._raise_pending_error()
        self._stop()
        with self._translate_x_errors(command):
            self._open_stage.prepare_signal(command)

    def show(self, identifier: str, grey: NDArray[np.uint8]) -> float:
        """Show a pattern and read it back.

        Returns the time by which the pattern is on the screen at the latest.
        """
        command = f"show {identifier}"
        self.prepare_to_show(command)
        return self._display_frames(command, identifier, [grey])

    def play(self, identifier: str, video: NDArray[np.uint8]) -> float:
        """Start a video and read back its first frame.

        Returns the time by which that frame is on the screen at the latest.
        """
        command = f"play {identifier}"
        self.prepare_to_show(command)
        seen = self._display_frames(command, identifier, list(video))
        from drivers.screen.video import VideoPlayback

        with self._translate_x_errors(command):
            place = self._open_stage.x.display, self._open_stage.window
            self._looked = time.monotonic()
            self._drawn = 0
            self._video = VideoPlayback(len(video), self.frame_time, self._draw, *place)
        return seen + self.frame_time

    def presentations(self) -> Presentations | None:
        """Return which video frames were shown, and when; None without a video."""
        self._require_screen("presentations")
        self._raise_pending_error()
        return None if self._video is None else self._video.player.presentations()

    def make_safe(self) -> None:
        self._stop()
        self._pending_error = None
        self._require_screen("make safe")
        self._display_frames("make safe", _NEUTRAL, [self._open_stage.neutral])

    def health(self) -> dict[str, str]:
        self._require_screen("health")
        stage = self._open_stage
        played, missed = self._counts()
        paced = "nothing plays" if self._video is None else self._video.paced_by
        return {
            "screen": str(stage.output),
            "monitor": " ".join(filter(None, vars(stage.output.monitor).values())) or "no EDID",
            "X server": f"{stage.x.display}, {stage.x.setup.vendor}",
            "window's process": str(os.getpid()),
            "gamma ramp": "plain" if stage.signal.has_linear_ramp else "not plain, as allowed",
            "connector": stage.signal.describe(),
            "shown": self._shown,
            "video paced by": paced,
            "video frames presented": str(played),
            "video presentations missed": str(missed),
            "video looked at": f"{self._looks} times",
            "screen lost": f"{self._lost} times",
        }

    def _attend_until_readable(self, end: int) -> None:
        """Run Qt's event loop until the parent process calls or has ended."""
        if self._stage is None:
            return
        from PySide6.QtCore import QEventLoop, QSocketNotifier, QTimer

        loop = QEventLoop()
        looks = QTimer(loop)
        looks.timeout.connect(self._look_at_signal)
        looks.start(_LOOK_MS)
        ramps = QTimer(loop)
        ramps.timeout.connect(self._look_at_ramp)
        if self._video is None and self._shown not in ("", _NEUTRAL):
            ramps.start(_RAMP_LOOK_MS)
        calls = QSocketNotifier(end, QSocketNotifier.Type.Read)
        calls.activated.connect(loop.quit)
        changes = QSocketNotifier(self._stage.changes.fileno(), QSocketNotifier.Type.Read)
        changes.activated.connect(self._screens_changed)
        if self._video is not None:
            self._video.process_refreshes()
        loop.exec()
        looks.stop()
        ramps.stop()
        calls.setEnabled(False)
        changes.setEnabled(False)

    @property
    def _open_stage(self) -> PanelScreen:
        if self._stage is None:
            raise DeviceError(self._model, "use the screen", "it isn't open", "Open it")
        return self._stage

    def _screens_changed(self, *_: object) -> None:
        with contextlib.suppress(DeviceError):
            self._require_screen("follow the screen")

    def _look_at_signal(self) -> None:
        """Look whether a still is sent as before; a video looks between its frames."""
        if self._video is None and self._stage is not None:
            with contextlib.suppress(DeviceError, XError):
                self._stage.look_at_signal()

    def _look_at_ramp(self) -> None:
        if self._stage is not None:
            with contextlib.suppress(DeviceError, XError):
                self._stage.signal.look_at_ramp()

    def _require_screen(self, command: str) -> None:
        """Raise DeviceError while the screen is gone; once it is back, show grey level 0."""
        with self._translate_x_errors(command):
            try:
                stayed = self._open_stage.ensure_covered()
            except DeviceError:
                self._reset_after_loss()
                raise
            if not stayed:
                self._reset_after_loss()

    def _reset_after_loss(self) -> None:
        """Forget the pattern or video that was shown before the loss."""
        if self._shown != _NEUTRAL or self._video is not None:
            self._stop()
            self._shown = _NEUTRAL
            self._images, self._frames = [], [self._open_stage.neutral]
            self._lost += 1
            stage = self._open_stage
            stage.signal.notes.append(f"{stage.output.name} was dark or moved, and shows neutral")

    def _display_frames(
        self, command: str, identifier: str, frames: list[NDArray[np.uint8]]
    ) -> float:
        from drivers.screen.canvas import grey_image

        with self._translate_x_errors(command):
            # Until the pattern has been read back, the screen's content has no identifier.
            self._shown = ""
            self._frames = frames
            self._images = [grey_image(frame) for frame in frames]
            self._open_stage.draw(self._images[0])
            seen = max(time.monotonic() + self.frame_time, self._open_stage.dark_until)
            self._open_stage.verify(command, frames[0])
            self._shown = identifier
            return seen

    def _draw(self, index: int) -> None:
        """Draw a video frame; every half second, check the frame before.

        The check reads back one band of that frame.
        """
        now = time.monotonic()
        if now - self._looked > 0.5:
            self._looked, self._looks = now, self._looks + 1
            try:
                with self._translate_x_errors(f"play {self._shown}"):
                    self._open_stage.look_at_signal()
                    self._open_stage.check_band(f"play {self._shown}", self._frames[self._drawn])
            except DeviceError as error:
                self._pending_error = self._pending_error or error
        self._open_stage.draw(self._images[index])
        self._drawn = index

    def _stop(self) -> None:
        if self._video is not None:
            self._played, self._missed = self._counts()
            self._video.stop()
            self._video = None
            # One of the video's frames is still on the screen.
            self._shown = ""

    def _counts(self) -> tuple[int, int]:
        """Count the video frames that were presented and missed, over all videos."""
        if self._video is None:
            return self._played, self._missed
        told = self._video.player.presentations()
        return self._played + told.count, self._missed + told.missed

    def _raise_pending_error(self) -> None:
        trouble, self._pending_error = self._pending_error, None
        if trouble is not None:
            raise trouble

    @contextlib.contextmanager
    def _translate_x_errors(self, command: str) -> Iterator[None]:
        try:
            yield
        except XError as error:
            kind = ServerGone if isinstance(error, XServerGone) else DeviceError
            remedy = "Look whether the X server is up"
            raise kind(self._model, command, str(error), remedy) from error
