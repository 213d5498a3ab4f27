"""Which frames of a camera are taken: those that really are of what was set, and no other."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from drivers.aravis.arrivals import Arrivals, Bad
from drivers.aravis.link import Link
from drivers.aravis.options import Options
from drivers.aravis.pixels import PixelFormat, unpack
from drivers.errors import DeviceError

ASKING = 3.0
"""Seconds in which the library must have answered anything but a wait for a frame."""

_LOOK = 0.05
"""Seconds between looks at whether a wait was cancelled."""

_TRIES = 3
"""Bad frames after which one gives up; fewer where there is no time for more."""

_LAG = 8
"""Frames after which a camera that tells their exposures must have obeyed."""

_AGREE_US = 1.0
"""Microseconds by which what a frame tells of its exposure may differ from what was set..."""

_AGREE = 1e-3
"""...and the part of it, whichever is more."""

_REMEDY = "Take it again; if it goes on, look at the network, the packet size and the cable"


class Taken(NamedTuple):
    """A frame's pixels, its number, and the time.monotonic() at which its exposure began."""

    image: NDArray[np.uint16]
    number: int
    began: float


class _Old(Bad):
    """A frame that tells itself that it is of another exposure."""


@dataclass
class Taking:
    """Takes frames of an open camera, as it is set.

    region: x, y, width, height. exposure: seconds, as the camera has read it back. tells: it
    says of each frame how long that was exposed. patience: seconds beyond a frame's own time
    in which a call must have ended. A frame is taken only if it is complete, of the region and
    format that were set, next in number, begun after it was asked for, told to be of the
    exposure that was set if the camera tells that, or else not one of the first `latency`
    after a change, which some cameras still expose as before; and if the camera, asked after
    it, still has that exposure.
    """

    link: Link
    options: Options
    form: PixelFormat
    region: list[int]
    exposure: float
    tells: bool
    patience: float
    got_on: Callable[[float], None]
    counts: Counter[str] = field(default_factory=Counter)

    def __post_init__(self) -> None:
        self._arrivals = Arrivals()
        self._running = False
        self._changed = 0.0
        self._old = 0
        self._back = -1
        self.changed()

    @property
    def shape(self) -> tuple[int, int]:
        return self.region[3], self.region[2]

    @property
    def readout(self) -> float:
        """Seconds from the end of an exposure to a picture in memory, through 1 Gbit/s."""
        return 0.02 + self.form.size(self.shape) / 100e6

    @property
    def frame_time(self) -> float:
        """The same, and what frames take that are thrown away first."""
        return self.readout + self._old * (self.exposure + self.readout)

    def changed(self) -> None:
        """Frames from before, and the first ones after, are of another exposure or gain."""
        self._changed = time.monotonic()
        # A free-running camera exposes the next frame already while it reads one.
        ahead = self.options.trigger != "software"
        self._old = 0 if self.tells else self.options.latency_frames + ahead
        if ahead:
            # Nor can it be said of frames on their way when they left.
            self._running = False

    def start(self) -> None:
        self._running = False
        memory = self.link.ask("start", self.options.buffers, within=ASKING)
        self._size, self._length = memory["size"], memory["length"]
        self._running, self._arrivals, self._back = True, Arrivals(), -1
        # Who knows what had been begun, or set by others, before this?
        self._old = max(self._old, 0 if self.tells else self.options.latency_frames)
        if not self._agrees(float(self.link.ask("exposure", within=ASKING))):
            self._set_again()

    def stop(self) -> None:
        self._running = False
        self.link.ask("stop", within=ASKING)

    def take(self, cancelled: Callable[[], bool]) -> Taken:
        """A frame whose exposure begins after this is called; DeviceError if there is none."""
        return self._take(cancelled, time.monotonic())

    def following(self, cancelled: Callable[[], bool]) -> Taken:
        """The next frame of a free-running camera whose exposure began after the last change."""
        return self._take(cancelled, self._changed)

    def _take(self, cancelled: Callable[[], bool], since: float) -> Taken:
        late = time.monotonic() + self.exposure + self.frame_time + self.patience
        tries = 0
        while True:
            self.got_on(self.exposure + self.readout)
            try:
                if not self._running:
                    self.start()
                taken = self._one(cancelled, since)
                if self._old:
                    self._old -= 1
                    self.counts["thrown away"] += 1
                    continue
                self._require_exposure()
                self.counts["taken"] += 1
                return taken
            except _Old as old:
                # It says itself that it hasn't obeyed yet: so it is going on.
                self.counts[old.kind] += 1
                most = _LAG
                bad: Bad = old
            except Bad as found:
                self.counts[found.kind] += 1
                # A new stream: whatever is still on its way never arrives there.
                self._running = False
                nobody = self.options.trigger == "hardware" and found.kind == "missing"
                most = 1 if nobody else _TRIES
                bad = found
            tries += 1
            again = self.exposure + self.frame_time + self._waiting
            if tries >= most or time.monotonic() + again > late:
                words = f"{bad.kind} frame: {bad}"
                raise DeviceError(self.link.model, "capture", words, _REMEDY) from bad

    @property
    def _waiting(self) -> float:
        """Seconds beyond its own time for which a frame is waited for."""
        more = self.options.trigger_wait_s if self.options.trigger == "hardware" else 0.0
        return more + self.options.frame_timeout_ms * 1e-3

    def _one(self, cancelled: Callable[[], bool], since: float) -> Taken:
        """The next good frame that was begun after `since`."""
        triggered = self.options.trigger == "software"
        if triggered:
            self._give_back()
            self.counts["stale"] += len(self.link.ask("drain", within=ASKING))
            since = float(self.link.ask("trigger", within=ASKING))
        late = time.monotonic() + self.exposure + self.readout + self._waiting
        if not triggered:
            late += self.exposure + self.readout
        bad = ""
        while True:
            note = self._pop(cancelled, late)
            if note is None:
                raise self._missing(bad)
            began = since
            if not triggered:
                began = self._arrivals.left(note) - self.exposure
                # Reported, not taken for anything.
                self.counts["dropped"] += self._arrivals.gap_before(note)
            if began < since or (triggered and not self._arrivals.is_fresh(note, since)):
                self.counts["stale"] += 1
                continue
            try:
                return Taken(self._image(note), note["number"], began)
            except Bad as found:
                if triggered:
                    raise
                self.counts[found.kind] += 1
                bad = f"; the last was {found.kind}: {found}"

    def _missing(self, but: str) -> Bad:
        what = "good frame" if but else "frame"
        if self.options.trigger == "hardware" and not but:
            what = f"trigger at {self.options.trigger_line}, or no frame,"
        return Bad("missing", f"no {what} within {self._waiting:g} s after its time{but}")

    def _pop(self, cancelled: Callable[[], bool], late: float) -> dict[str, Any] | None:
        while time.monotonic() < late:
            if cancelled():
                self.stop()
                reply = "it was cancelled"
                raise DeviceError(self.link.model, "capture", reply, "Take it again")
            back, self._back = self._back, -1
            wait = min(_LOOK, max(0.0, late - time.monotonic()))
            note: dict[str, Any] | None = self.link.ask("pop", wait, back, within=ASKING)
            if note is not None:
                self._back = note["place"]
                return note
        return None

    def _give_back(self) -> None:
        if self._back >= 0:
            self.link.ask("pop", 0.0, self._back, within=ASKING)
            self._back = -1

    def _image(self, note: dict[str, Any]) -> NDArray[np.uint16]:
        if note["status"] != "success":
            raise Bad("incomplete", f"number {note['number']}: {note['status']}")
        needed = self.form.size(self.shape)
        region = note["region"][2:] == self.region[2:]
        if note["code"] != self.form.code or not region or note["size"] < needed:
            raise Bad(
                "corrupt",
                f"number {note['number']} is {note['region'][2:]} pixels of format "
                f"{note['code']:#x} in {note['size']} bytes, not {self.region[2:]} of "
                f"{self.form.code:#x} in {needed}",
            )
        if self.tells:
            told = note.get("exposure_us")
            if told is None or not self._agrees(told):
                raise _Old("wrong exposure", f"number {note['number']} was exposed {told} us")
        return unpack(
            self.link.bytes_at(note["place"], needed, self._length), self.form, self.shape
        )

    def _set_again(self) -> None:
        self.exposure = set_exposure(self.link, microseconds(self.exposure))

    def _agrees(self, us: float) -> bool:
        asked = self.exposure * 1e6
        return abs(us - asked) <= max(_AGREE_US, _AGREE * asked)

    def _require_exposure(self) -> None:
        """Something else may have set it meanwhile: then it is set again, and taken again."""
        us = float(self.link.ask("exposure", within=ASKING))
        if self._agrees(us):
            return
        self._set_again()
        self.changed()
        raise Bad("wrong exposure", f"the camera exposes {us:g} us by itself")


def microseconds(seconds: float) -> float:
    """What a camera is told: some cut what is a rounding error below a whole number."""
    return round(seconds * 1e6, 3)


def set_exposure(link: Link, us: float) -> float:
    """Set the exposure; in seconds, what the camera has made of it."""
    return float(link.ask("set_exposure", us, within=ASKING)) * 1e-6
