"""A thread that reduces live frames and hands them to the window in shared memory."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from labapp.window.commands import AcknowledgeFrame
from labapp.window.engine.channel import Channel
from labapp.window.engine.frame_tally import FrameTally
from labapp.window.frame_memory import SLOT_COUNT, FrameMemoryWriter, SlotHeader
from labapp.window.frame_reduction import FrameView, reduce_frame
from labapp.window.messages import LiveFrame, LivePicture
from labapp.window.tone_mapping import DigitalScale

_COUNTS_BYTES = 1 << 16
"""Bytes for the histogram of a frame, which has 4096 bins of 4 bytes at most."""


@dataclass(frozen=True)
class _Waiting:
    """A frame that waits to be shown, and what it was taken for."""

    frame: LiveFrame
    request: int = 0
    is_prediction: bool = False
    on_sent: Callable[[LiveFrame], None] = lambda _: None


class FrameSender:
    """Reduce frames to the window's view in a thread, while the next one is taken.

    A frame is sent once the one before is on the window's screen. Only the newest frame waits for
    that; one that a newer frame replaces counts as dropped.
    """

    def __init__(self, channel: Channel, scale: DigitalScale) -> None:
        self._channel, self._scale = channel, scale
        self._memory = FrameMemoryWriter(channel.memory)
        self._condition = threading.Condition()
        self._view = FrameView()
        self._waiting: _Waiting | None = None
        self._is_working = False
        self._discards = 0
        self._sent: deque[int] = deque()
        self.tally = FrameTally()
        self._is_shown = True
        self.on_room: Callable[[], None] = lambda: None
        self.on_failure: Callable[[Exception], None] = lambda _: None
        threading.Thread(target=self._work, name="frame-sender", daemon=True).start()

    @property
    def has_room(self) -> bool:
        """Return whether no frame waits to be shown, so that another one is worth taking."""
        return self._waiting is None

    def set_view(self, view: FrameView) -> None:
        """Reduce later frames to another view; any thread may call this."""
        self._view = view

    def offer(
        self,
        frame: LiveFrame,
        request: int = 0,
        on_sent: Callable[[LiveFrame], None] = lambda _: None,
    ) -> None:
        """Have a frame shown, taken after the person's change number `request`.

        `on_sent` is called with the frame just before the window gets it, in the sender's thread;
        not if another frame takes its place.
        """
        with self._condition:
            self.tally.count_taken(frame.number)
            if self._waiting is not None:
                self.tally.count_dropped()
            self._waiting = _Waiting(frame, request, on_sent=on_sent)
            self._condition.notify_all()

    def offer_prediction(self, frame: LiveFrame, is_wanted: Callable[[], bool]) -> None:
        """Have a coarse prediction shown, if it is still wanted and nothing waits."""
        with self._condition:
            if self._waiting is None and is_wanted():
                self._waiting = _Waiting(frame, is_prediction=True)
                self._condition.notify_all()

    def skip(self, number: int) -> None:
        """Count a frame that was taken but isn't shown."""
        with self._condition:
            self.tally.count_taken(number)
            self.tally.count_dropped()

    def discard(self) -> None:
        """Drop all frames offered before, which then never reach the window, and count anew."""
        with self._condition:
            self._waiting = None
            self._discards += 1
            self._condition.notify_all()
            self._condition.wait_for(lambda: not self._is_working or self._channel.closed)
            self.tally = FrameTally()

    def acknowledge(self, report: AcknowledgeFrame) -> None:
        """Note that a frame is on the screen: slots of earlier ones are free again."""
        with self._condition:
            while self._sent and self._sent[0] != report.slot:
                self._sent.popleft()
            self._is_shown = True
            self._condition.notify_all()

    def close(self) -> None:
        """Wake the thread, which ends once the window is gone."""
        with self._condition:
            self._condition.notify_all()

    def _work(self) -> None:
        while not self._channel.closed:
            with self._condition:
                self._condition.wait_for(lambda: self._waiting is not None or self._channel.closed)
                if self._waiting is None:
                    return
                waiting, self._waiting = self._waiting, None
                self._is_working, discards = True, self._discards
            self.on_room()
            try:
                self._send(self._write(waiting), waiting, discards)
            except Exception as error:
                # The thread must go on: the next frame may be a sound one.
                self.on_failure(error)
            finally:
                with self._condition:
                    self._is_working = False
                    self._condition.notify_all()

    def _write(self, waiting: _Waiting) -> SlotHeader:
        """Write a frame and the view of it into a slot that isn't in use."""
        frame = replace(waiting.frame, image=np.ascontiguousarray(waiting.frame.image))
        shown = reduce_frame(frame.image, self._view, self._scale)
        # A view has at most as many bytes as the frame has pixels.
        self._memory.reserve(frame.image.nbytes + frame.image.size + _COUNTS_BYTES)
        with self._condition:
            slot = next(slot for slot in range(SLOT_COUNT) if slot not in self._sent)
            tally = self.tally
        picture = LivePicture(
            frame, shown, waiting.request, tally.dropped, tally.missed, waiting.is_prediction
        )
        return self._memory.write(slot, picture)

    def _send(self, header: SlotHeader, waiting: _Waiting, discards: int) -> None:
        """Send a frame once the one before is on the screen, unless it is discarded."""

        def is_due() -> bool:
            return self._is_shown or self._discards != discards or self._channel.closed

        with self._condition:
            self._condition.wait_for(is_due)
            if self._discards != discards or self._channel.closed:
                return
            waiting.on_sent(waiting.frame)
            self._is_shown = False
            self._sent.append(header.slot)
        self._channel.send(header)
