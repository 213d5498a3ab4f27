"""Devices of the virtual bench, which speak the drivers' interfaces in-process."""

from __future__ import annotations

import math
import time
import zlib
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from drivers.errors import DeviceError
from drivers.interfaces import Frame, Identity, Setting, Slot, Surroundings
from optics.edge import require_positive
from optics.sensor import expose
from optics.slm import require_grey
from simulator.faults import Faulty
from simulator.world import World


def require_duration(name: str, milliseconds: float) -> None:
    """Raise ValueError for a duration that is negative or not finite."""
    if not 0 <= milliseconds < math.inf:
        raise ValueError(f"{name} is {milliseconds}; it must be finite and not negative")


class _Simulated:
    """What all simulated devices share: a world, a clock, bad luck, and no pretence."""

    model = ""
    role = ""
    settling = 0.0
    reply_time = 0.5

    def __init__(self, surroundings: Surroundings) -> None:
        if not isinstance(surroundings.world, World):
            raise DeviceError(
                self.model,
                "open",
                "this bench has no virtual world",
                "Name a scene in the bench file",
            )
        self._world = surroundings.world
        self._clock = surroundings.clock
        self._luck = Faulty(self._world.faults, self.role, self.model, self._clock)

    @property
    def identity(self) -> Identity:
        return Identity(self.model, "simulated", simulated=True)

    def make_safe(self) -> None:
        """Nothing of a simulated device is left to be made safe, unless it says so."""

    def kill(self) -> None:
        """End a call that hangs."""
        self._luck.kill()

    def __enter__(self) -> Self:
        self._luck.require_plugged()
        return self

    def __exit__(self, *error: object) -> None:
        self.make_safe()

    def _refuse(self, command: str, reply: str, remedy: str) -> DeviceError:
        return DeviceError(self.model, command, reply, remedy)


class SimulatedSLM(_Simulated):
    """A liquid-crystal panel whose pixels are the world's.

    frame_rate_hz: frames of a video in a second.
    """

    model = "simulated SLM"
    role = "slm"

    def __init__(self, surroundings: Surroundings, frame_rate_hz: float = 60.0) -> None:
        super().__init__(surroundings)
        require_positive("frame_rate_hz", frame_rate_hz, "Hz")
        self._frame_time = 1 / frame_rate_hz
        self._shown = "neutral"

    def __enter__(self) -> Self:
        super().__enter__()
        # Whatever was shown before it was opened.
        self._world.grey = np.zeros(self.shape, dtype=np.uint8)
        return self

    @property
    def shape(self) -> tuple[int, int]:
        return self._world.camera.panel.shape

    @property
    def shown(self) -> str:
        return self._shown

    @property
    def frame_time(self) -> float:
        return self._frame_time

    @property
    def settling(self) -> float:  # type: ignore[override]
        return self._world.camera.panel.settling

    def show(self, identifier: str, grey: NDArray[np.uint8]) -> Setting[str]:
        return self._present(f"show {identifier}", identifier, np.asarray(grey)[None])

    def play(self, identifier: str, video: NDArray[np.uint8]) -> Setting[str]:
        if video.ndim != 3 or not len(video):
            reply = f"a video of shape {video.shape}; it needs frames, rows and columns"
            raise self._refuse(f"play {identifier}", reply, "Compute it again")
        return self._present(f"play {identifier}", identifier, video)

    def make_safe(self) -> None:
        self.show("neutral", np.zeros(self.shape, dtype=np.uint8))

    def _present(self, command: str, identifier: str, frames: NDArray[np.uint8]) -> Setting[str]:
        self._luck.begin(command, self.reply_time)
        try:
            for grey in frames:
                require_grey(self._world.camera.panel, grey)
        except (TypeError, ValueError) as error:
            raise self._refuse(command, str(error), "Compute it again") from error
        self._world.play(frames, self._frame_time)
        self._shown = identifier
        return Setting(identifier, identifier, self._clock.now() + self.settling)


class SimulatedFilter(_Simulated):
    """A liquid-crystal tunable filter with a Gaussian band.

    range_nm: lowest and highest wavelength. bandwidth_nm: full width at half maximum.
    settling_ms: time until a new wavelength stands.
    """

    model = "simulated tunable filter"
    role = "filter"

    def __init__(
        self,
        surroundings: Surroundings,
        range_nm: tuple[float, float] = (420.0, 720.0),
        bandwidth_nm: float = 7.0,
        settling_ms: float = 50.0,
    ) -> None:
        super().__init__(surroundings)
        if not 0 < range_nm[0] < range_nm[1]:
            raise ValueError(f"range_nm is {range_nm}; give a lowest and a higher wavelength")
        require_positive("bandwidth_nm", bandwidth_nm, "nm")
        require_duration("settling_ms", settling_ms)
        self._range = (range_nm[0] * 1e-9, range_nm[1] * 1e-9)
        self.settling = settling_ms * 1e-3
        self._world.bandwidth = bandwidth_nm * 1e-9

    @property
    def wavelength_range(self) -> tuple[float, float]:
        return self._range

    @property
    def bandwidth(self) -> float:
        return self._world.bandwidth

    @property
    def wavelength(self) -> float:
        return self._world.wavelength

    def set_wavelength(self, wavelength: float) -> Setting[float]:
        low, high = self._range
        self._luck.begin(f"tune to {wavelength * 1e9:.1f} nm", self.reply_time)
        if not low <= wavelength <= high:
            raise self._refuse(
                f"tune to {wavelength * 1e9:.1f} nm",
                f"out of range, {low * 1e9:.0f} to {high * 1e9:.0f} nm",
                "Choose a wavelength in the range",
            )
        # A VariSpec resolves 0.01 nm; integer picometres keep the value exact in files.
        actual = round(wavelength * 1e11) / 1e11
        self._world.wavelength = actual
        return Setting(wavelength, actual, self._clock.now() + self.settling)

    def make_safe(self) -> None:
        self.set_wavelength(self._range[0])


class SimulatedWheel(_Simulated):
    """A wheel of interference filters with Gaussian bands.

    slots_nm: centre and full width at half maximum of each slot. step_ms: time that the
    wheel needs from a slot to the next one; it turns the shorter way.
    """

    model = "simulated filter wheel"
    role = "filter"

    def __init__(
        self,
        surroundings: Surroundings,
        slots_nm: Sequence[tuple[float, float]] = ((450, 10), (532, 10), (550, 10), (633, 10)),
        step_ms: float = 200.0,
    ) -> None:
        super().__init__(surroundings)
        if not slots_nm:
            raise ValueError("slots_nm is empty; a wheel has one slot at least")
        for centre, width in slots_nm:
            require_positive("slots_nm's centre", centre, "nm")
            require_positive("slots_nm's width", width, "nm")
        require_duration("step_ms", step_ms)
        self._slots = tuple(
            Slot(f"{centre:g} nm", round(centre * 1e3) * 1e-12, width * 1e-9)
            for centre, width in slots_nm
        )
        self._step = step_ms * 1e-3
        self.settling = self._step * (len(self._slots) // 2)
        self._slot = 1

    def __enter__(self) -> Self:
        super().__enter__()
        self._turn_to(1)
        return self

    @property
    def slots(self) -> tuple[Slot, ...]:
        return self._slots

    @property
    def slot(self) -> int:
        return self._slot

    @property
    def wavelength_range(self) -> tuple[float, float]:
        centres = [slot.wavelength for slot in self._slots]
        return min(centres), max(centres)

    @property
    def bandwidth(self) -> float:
        return self._slots[self._slot - 1].bandwidth

    @property
    def wavelength(self) -> float:
        return self._slots[self._slot - 1].wavelength

    def set_slot(self, number: int) -> Setting[int]:
        self._luck.begin(f"turn to slot {number}", self.reply_time)
        if not 1 <= number <= len(self._slots):
            raise self._refuse(
                f"turn to slot {number}", "no such slot", f"Choose 1 to {len(self._slots)}"
            )
        around = abs(number - self._slot)
        steps = min(around, len(self._slots) - around)
        self._turn_to(number)
        return Setting(number, number, self._clock.now() + steps * self._step)

    def set_wavelength(self, wavelength: float) -> Setting[float]:
        """Turn to the slot whose centre is within a picometre."""
        for number, slot in enumerate(self._slots, start=1):
            if abs(slot.wavelength - wavelength) < 1e-12:
                setting = self.set_slot(number)
                return Setting(wavelength, slot.wavelength, setting.ready_at)
        raise self._refuse(
            f"tune to {wavelength * 1e9:.1f} nm",
            "no slot passes it",
            f"Choose one of {', '.join(slot.name for slot in self._slots)}",
        )

    def make_safe(self) -> None:
        self.set_slot(1)

    def _turn_to(self, number: int) -> None:
        self._slot = number
        self._world.wavelength, self._world.bandwidth = self.wavelength, self.bandwidth


class SimulatedCamera(_Simulated):
    """A camera whose every picture follows from the state of the world and a seed.

    readout_ms: time from the end of an exposure to a picture in memory. reply_s: seconds,
    beyond the exposure, that a step of a picture's computation may take; by default 5, and
    5 more a megapixel.
    """

    model = "simulated camera"
    role = "camera"

    def __init__(
        self, surroundings: Surroundings, readout_ms: float = 8.0, reply_s: float | None = None
    ) -> None:
        super().__init__(surroundings)
        require_duration("readout_ms", readout_ms)
        if reply_s is not None:
            require_positive("reply_s", reply_s, "s")
        self.reply_time = reply_s or 5.0 + 5e-6 * math.prod(self.shape)
        self.alive_at = 0.0
        self._readout = readout_ms * 1e-3
        self._exposure = 0.01
        self._number = 0
        self._queue: list[Frame] = []
        self._last: Frame | None = None

    @property
    def shape(self) -> tuple[int, int]:
        return self._world.camera.sensor.shape

    @property
    def full_scale(self) -> int:
        return self._world.camera.sensor.full_scale

    @property
    def exposure_range(self) -> tuple[float, float]:
        return self._world.camera.sensor.exposure_range

    @property
    def frame_time(self) -> float:
        return self._readout

    def set_exposure(self, exposure: float) -> Setting[float]:
        low, high = self.exposure_range
        self._luck.begin(f"expose {exposure * 1e3:g} ms", self.reply_time)
        if not low <= exposure <= high:
            raise self._refuse(
                f"expose {exposure * 1e3:g} ms",
                f"out of range, {low * 1e3:g} to {high * 1e3:g} ms",
                "Choose an exposure in the range",
            )
        # Whole microseconds, as cameras count.
        self._exposure = round(exposure * 1e6) / 1e6
        return Setting(exposure, self._exposure, self._clock.now())

    def capture(self, cancelled: Callable[[], bool]) -> Frame:
        """The next picture in the host's queue, which is this one unless one came too late."""
        fault = self._luck.begin("capture", self.reply_time, frame=True)
        kind = fault.kind if fault else ""
        if fault and kind == "stale frame":
            if self._last is not None:
                return self._last
            # A first frame can't be an old one; the next one can.
            self._luck.put_off(fault)
        frame = self._expose(cancelled, self._wrong_exposure() if kind == "wrong exposure" else 0)
        if kind == "dropped frame":
            raise self._refuse("capture", f"frame {frame.number} was lost", "Check the network")
        self._queue.append(_corrupted(frame) if kind == "corrupt frame" else frame)
        if kind == "late frame":
            raise self._refuse("capture", f"frame {frame.number} is late", "Check the network")
        self._last = self._queue.pop(0)
        return self._last

    def _expose(self, cancelled: Callable[[], bool], other: float) -> Frame:
        """A picture of the set exposure, or of another one if that isn't 0."""
        began, seconds = self._clock.now(), other or self._exposure

        def check() -> None:
            self.alive_at = time.monotonic()
            if cancelled():
                raise self._refuse("capture", "it was cancelled", "Take it again")
            self._luck.require_alive("capture")

        try:
            rate, plan = self._world.light(seconds, check)
        except ValueError as error:
            raise self._refuse("capture", str(error), "Change the scene or the bench") from error
        # The world's chance is for those who are alive.
        self._luck.require_alive("capture")
        sensor = self._world.camera.sensor
        numbers = expose(
            rate,
            seconds,
            sensor,
            self._world.chance(),
            shot_noise=plan.is_on("shot noise"),
            read_noise=plan.is_on("read noise"),
            dark_current=plan.is_on("dark current"),
        )
        self._clock.wait_until(
            began + seconds + self._readout, lambda: cancelled() or self._luck.killed
        )
        self._luck.require_alive("capture")
        self._number += 1
        image = numbers.numpy().astype(np.uint16)
        return Frame(image, seconds, sensor.gain, began, self._number, _checksum(image))

    def _wrong_exposure(self) -> float:
        """What a camera exposes that hasn't heard of its new setting yet."""
        low, high = self.exposure_range
        return self._exposure * 2 if self._exposure * 2 <= high else max(low, self._exposure / 2)


def _checksum(image: NDArray[np.uint16]) -> int:
    return zlib.crc32(np.ascontiguousarray(image).data)


def _corrupted(frame: Frame) -> Frame:
    """A frame of which the lower half is what was in memory before: a packet was lost."""
    image = frame.image.copy()
    lower = image[len(image) // 2 :]
    lower[:] = 0 if lower.any() else 1
    return replace(frame, image=image)


class SimulatedTargets(_Simulated):
    """A changer that puts the scene's targets before the camera, one at a time."""

    model = "simulated target changer"
    role = "targets"
    by_hand = False

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(self._world.scene.targets)

    @property
    def placed(self) -> str:
        return self._world.target

    def place(self, name: str) -> Setting[str]:
        self._luck.begin(f"place {name}", self.reply_time)
        if name not in self.names:
            raise self._refuse(
                f"place {name}", "no such target", f"Choose one of {', '.join(self.names)}"
            )
        self._world.target = name
        return Setting(name, name, self._clock.now())
