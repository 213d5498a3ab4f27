"""A GigE Vision or USB3 Vision camera."""

from __future__ import annotations

import contextlib
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from typing import Any, Self

from drivers.aravis.link import Gone, Link, opened
from drivers.aravis.options import Options, Trigger
from drivers.aravis.pixels import FORMATS, PixelFormat
from drivers.aravis.taking import ASKING, Taken, Taking, microseconds
from drivers.errors import DeviceError
from drivers.interfaces import Frame, Identity, Setting, Surroundings

_PATIENCE = 2.0
"""Seconds for which a camera is tried to be opened: one forgets its last owner after 1.5."""

_OFF = 0.1
"""Part of an exposure by which a camera may miss it: they count in lines or microseconds."""


class AravisCamera:
    """A GigE Vision or USB3 Vision camera through Aravis 0.8, the same code for both.

    address: serial number, IP address, or Aravis' id; the first camera found if empty, which
    takes a second to find. pixel_format: a name of GenICam's, such as Mono12p or BayerRG8; the
    camera's own if empty. Mosaics are given as they are, `bayer` tells their pattern. gain_db,
    roi [x, y, width, height], binning [across, down]: as the camera can. trigger: "software",
    each picture when asked; "hardware", at the camera's input `trigger_line`; "free", one
    after the other, at `frame_rate` a second if that isn't 0. packet_size: bytes; negotiated
    if 0. buffers: frames that may wait. latency_frames: how many frames after a change of
    exposure may still be of the old one; they are thrown away, unless the camera tells the
    exposure of each (chunk data), when nothing needs to be thrown away. Set it to 0 for a
    camera that is known to obey at once. frame_timeout_ms: beyond exposure and frame time,
    after which a frame counts as missing. trigger_wait_s: for a hardware trigger.
    electrons_per_number: at 0 dB, from the data sheet.

    The library has a process of its own, which is killed when it hangs; the next call starts
    another and opens the camera anew, which must have the same serial number. A frame is taken
    only as `Taking` tells.
    """

    settling = 0.0

    def __init__(
        self,
        surroundings: Surroundings,
        address: str = "",
        pixel_format: str = "",
        gain_db: float = 0.0,
        roi: Sequence[int] = (),
        binning: Sequence[int] = (1, 1),
        trigger: Trigger = "software",
        trigger_line: str = "Line0",
        frame_rate: float = 0.0,
        packet_size: int = 0,
        buffers: int = 8,
        latency_frames: int = 3,
        frame_timeout_ms: float = 1000.0,
        trigger_wait_s: float = 5.0,
        electrons_per_number: float = 1.0,
    ) -> None:
        self._options = Options(
            address,
            pixel_format,
            gain_db,
            roi,
            binning,
            trigger,
            trigger_line,
            frame_rate,
            packet_size,
            buffers,
            latency_frames,
            frame_timeout_ms,
            trigger_wait_s,
            electrons_per_number,
        )
        self._clock = surroundings.clock
        self._model = f"camera {address}".strip()
        self._link: Link | None = None
        self._made: Taking | None = None
        self._facts: dict[str, Any] = {}
        self._asked: float | None = None
        self._counts: Counter[str] = Counter()
        self._number = self._camera_number = 0
        self.alive_at = 0.0
        waits = trigger_wait_s if trigger == "hardware" else 0.0
        self.reply_time = 5.0 + frame_timeout_ms * 1e-3 + waits

    @property
    def identity(self) -> Identity:
        model = f"{self._facts.get('vendor', '')} {self._facts.get('model', '')}".strip()
        return Identity(model or self._model, self._facts.get("serial", ""), simulated=False)

    @property
    def shape(self) -> tuple[int, int]:
        return self._taking.shape

    @property
    def pixel_format(self) -> str:
        return self._taking.form.name

    @property
    def bayer(self) -> str:
        """Colours of the mosaic's first two pixels, such as RG; empty if it has none."""
        return self._taking.form.bayer

    @property
    def full_scale(self) -> int:
        return self._taking.form.full_scale

    @property
    def exposure_range(self) -> tuple[float, float]:
        low, high = self._facts["exposure_us"]
        return low * 1e-6, high * 1e-6

    @property
    def gain_range(self) -> tuple[float, float] | None:
        """Decibels; None if it has no gain."""
        gain = self._facts["gain_db"]
        return None if gain is None else (gain[0], gain[1])

    @property
    def exposure(self) -> float:
        """Seconds, as the camera itself reads it back."""
        return self._taking.exposure

    @property
    def frame_time(self) -> float:
        return self._taking.frame_time

    @property
    def counts(self) -> Counter[str]:
        """Frames since it was made: taken, thrown away, stale, missing, incomplete, ..."""
        return Counter(self._counts)

    def set_exposure(self, exposure: float) -> Setting[float]:
        command = f"expose {exposure * 1e3:g} ms"
        with self._watched(command):
            taking = self._ready()
            low, high = self.exposure_range
            if not low <= exposure <= high:
                reply = f"out of range, {low * 1e3:g} to {high * 1e3:g} ms"
                raise self._error(command, reply, "Choose an exposure in the range")
            actual = self._set(taking.link, microseconds(exposure))
            taking.exposure = actual
            taking.changed()
            if abs(actual - exposure) > _OFF * exposure:
                reply = f"it has set {actual * 1e3:g} ms"
                raise self._error(command, reply, "Look at its frame rate and its other limits")
            self._asked = exposure
            return Setting(exposure, actual, self._clock.now())

    def set_gain(self, gain_db: float) -> Setting[float]:
        """Decibels; the gain that stands when it is opened is the option's."""
        with self._watched("set gain"):
            taking = self._ready()
            self._gain = self._set_gain(taking.link, gain_db)
            taking.changed()
            return Setting(gain_db, self._gain, self._clock.now())

    def capture(self, cancelled: Callable[[], bool]) -> Frame:
        """A picture whose exposure begins after this is called."""
        with self._watched("capture"):
            return self._frame(self._ready().take(cancelled))

    def next_frame(self, cancelled: Callable[[], bool]) -> Frame:
        """The next picture of a free-running camera, none left out that wasn't counted.

        Its exposure may have begun before the call, but after anything was set.
        """
        if self._options.trigger == "software":
            raise self._error("next frame", "it isn't free-running", "Use capture()")
        with self._watched("next frame"):
            return self._frame(self._ready().following(cancelled))

    def health(self) -> dict[str, str]:
        with self._watched("health"):
            link = self._ready().link
            told = {name: str(self._facts[name]) for name in ("vendor", "model", "serial")}
            told["protocol"] = self._facts["protocol"]
            told["pixel format"] = self.pixel_format
            told["packet size"] = str(self._packets)
            told["tells exposure"] = "yes" if self._taking.tells else "no"
            told |= link.ask("health", within=ASKING)
            told |= {f"frames {kind}": str(count) for kind, count in self._counts.items()}
            counted = link.ask("counts", within=ASKING)
            return told | {name.replace("_", " "): str(n) for name, n in counted.items()}

    def make_safe(self) -> None:
        """Stop exposing."""
        if self._link is None:
            return
        with self._watched("stop"):
            self._taking.stop()

    def kill(self) -> None:
        """End the library's process; from any thread. The next call starts another one."""
        link = self._link
        if link is not None:
            link.kill()

    def gone(self) -> str | None:
        """Why it counts as unplugged, empty while it is there; see Device."""
        link = self._link
        return None if link is None else link.gone()

    def __enter__(self) -> Self:
        with self._watched("open"):
            self._ready()
        return self

    def __exit__(self, *error: object) -> None:
        link, self._link = self._link, None
        if link is not None:
            link.close()

    @property
    def _taking(self) -> Taking:
        if self._made is None:
            raise self._error("ask", "it is not open", "Open it")
        return self._made

    def _ready(self) -> Taking:
        """The camera as it was set, opened again if it had gone."""
        if self._link is not None:
            return self._taking
        link = opened(self._model, self._options.address, _PATIENCE)
        try:
            self._made = self._set_up(link)
        except BaseException:
            link.kill()
            link.close()
            raise
        self._link = link
        return self._made

    def _set_up(self, link: Link) -> Taking:
        def ask(name: str, *given: Any) -> Any:
            return link.ask(name, *given, within=ASKING)

        facts, o = ask("facts"), self._options
        if self._facts and facts["serial"] != self._facts["serial"]:
            reply = f"it has serial number {facts['serial']}, not {self._facts['serial']}"
            raise self._error("open", reply, "Plug the right one in, or open the bench again")
        self._facts = facts
        self._model = link.model = self.identity.model
        if stubborn := ask("automatic_off"):
            reply = f"{', '.join(stubborn)} can't be turned off"
            raise self._error("open", reply, "Turn it off in the camera's own settings")
        form = self._set_format(ask)
        self._set_binning(ask)
        region = ask("set_region", *(o.roi or (0, 0, 0, 0)))
        if o.roi and region != list(o.roi):
            raise self._error(f"roi {list(o.roi)}", f"it has set {region}", "Give one it can set")
        self._gain = self._set_gain(link, o.gain_db)
        self._set_trigger(ask)
        self._packets = ask("set_packets", o.packet_size)
        tells = bool(self._facts["chunks"] and ask("set_chunks"))
        us = ask("exposure") if self._asked is None else microseconds(self._asked)
        exposure = self._set(link, us)
        return Taking(
            link, o, form, region, exposure, tells, self.reply_time, self._got_on, self._counts
        )

    def _set_format(self, ask: Callable[..., Any]) -> PixelFormat:
        wanted, there = self._options.pixel_format, self._facts["pixel_formats"]
        known = [name for name in there if name in FORMATS]
        if wanted and wanted not in known:
            raise self._error(f"pixel format {wanted}", "it has none", f"Give {', '.join(known)}")
        actual = ask("set_pixel_format", wanted)
        if actual not in FORMATS or (wanted and actual != wanted):
            reply = f"it sends {actual}"
            raise self._error("pixel format", reply, f"Give one of {', '.join(known)}")
        return FORMATS[actual]

    def _set_binning(self, ask: Callable[..., Any]) -> None:
        wanted = list(self._options.binning)
        if self._facts["binning"] is None:
            if wanted != [1, 1]:
                raise self._error(f"binning {wanted}", "it has none", "Leave it out")
            return
        if (actual := ask("set_binning", *wanted)) != wanted:
            raise self._error(f"binning {wanted}", f"it has set {actual}", "Give another one")

    def _set_gain(self, link: Link, gain_db: float) -> float:
        bounds = self.gain_range
        if bounds is None:
            if gain_db:
                raise self._error(f"gain {gain_db:g} dB", "it has none", "Leave it out")
            return 0.0
        if not bounds[0] <= gain_db <= bounds[1]:
            reply = f"out of range, {bounds[0]:g} to {bounds[1]:g} dB"
            raise self._error(f"gain {gain_db:g} dB", reply, "Choose one in the range")
        return float(link.ask("set_gain", gain_db, within=ASKING))

    def _set(self, link: Link, us: float) -> float:
        """Set the exposure; in seconds, what the camera has made of it."""
        return float(link.ask("set_exposure", us, within=ASKING)) * 1e-6

    def _set_trigger(self, ask: Callable[..., Any]) -> None:
        o = self._options
        wanted = {"software": "Software", "hardware": o.trigger_line, "free": ""}[o.trigger]
        there = self._facts["trigger_sources"]
        if wanted and wanted not in there:
            reply = f"it has no trigger {wanted}"
            raise self._error("trigger", reply, f"Choose of {', '.join(there) or 'none'}")
        if (actual := ask("set_trigger", wanted)) != wanted:
            raise self._error("trigger", f"it has set {actual}", "Choose another one")
        if o.frame_rate and not wanted:
            rate = float(ask("set_rate", o.frame_rate))
            if abs(rate - o.frame_rate) > _OFF * o.frame_rate:
                reply = f"it has set {rate:g}"
                raise self._error(f"frame rate {o.frame_rate:g}", reply, "Ask for less")

    def _frame(self, taken: Taken) -> Frame:
        began = self._clock.now() - (time.monotonic() - taken.began)
        gain = self._options.electrons_per_number / 10 ** (self._gain / 20)
        number = self._counted(taken.number)
        return Frame(taken.image, self._taking.exposure, gain, began, number)

    def _counted(self, number: int) -> int:
        """The camera's count, which may end at 65535 (GigE Vision 1) or begin anew, going on.

        What has the number of the frame before isn't taken in the first place.
        """
        step = number - self._camera_number
        self._number += step if step > 0 else 1
        self._camera_number = number
        return self._number

    def _got_on(self, seconds: float) -> None:
        """It goes on, and will be busy for some seconds."""
        self.alive_at = time.monotonic() + seconds

    @contextlib.contextmanager
    def _watched(self, command: str) -> Iterator[None]:
        """What is gone is opened again at the next call."""
        try:
            yield
        except Gone:
            link, self._link = self._link, None
            if link is not None:
                link.close()
            raise
        except (OSError, EOFError, ValueError, KeyError, TypeError) as error:
            self.kill()
            link, self._link = self._link, None
            if link is not None:
                link.close()
            reply = f"{type(error).__name__}: {error}"
            raise self._error(command, reply, "Take it again") from error

    def _error(self, command: str, reply: str, remedy: str) -> DeviceError:
        return DeviceError(self._model, command, reply, remedy)
