"""What the application asks of devices: small protocols, and the data they exchange.

SI units throughout. A device is a context manager; leaving it closes it. Every call
ends within the device's own documented time or raises a DeviceError. A set-call gives
back what was really set and when it will stand; whoever measures waits for all of them,
so that settling overlaps.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable
from dataclasses import dataclass
from types import TracebackType
from typing import Any, Generic, Protocol, Self, TypeVar, runtime_checkable

import numpy as np
from numpy.typing import NDArray

T = TypeVar("T")


@dataclass(frozen=True)
class Identity:
    """Who a device is; simulated devices say so, and nothing hides it."""

    model: str
    serial: str
    simulated: bool


@dataclass(frozen=True)
class Setting(Generic[T]):
    """What was asked, what was really set, and the clock's time at which it stands."""

    request: T
    actual: T
    ready_at: float


@dataclass(frozen=True)
class Frame:
    """A raw picture and the settings that it was really taken with.

    image: (rows, columns), uint16. exposure: seconds. gain: electrons per digital
    number. time: the clock's time at which the exposure began. number: counted by the
    camera, so that a lost or repeated frame shows. checksum: CRC-32 of the image's bytes
    as they left the camera, None where the camera tells none.
    """

    image: NDArray[np.uint16]
    exposure: float
    gain: float
    time: float
    number: int
    checksum: int | None = None


def checksum(image: NDArray[np.uint16]) -> int:
    """CRC-32 of a picture's bytes, row by row."""
    return zlib.crc32(np.ascontiguousarray(image).data)


class Clock(Protocol):
    """The bench's time in seconds; it may run faster than the wall's in a simulation."""

    def now(self) -> float: ...

    def wait_until(self, time: float, cancelled: Callable[[], bool]) -> None:
        """Return at `time`, or soon after `is_cancelled()` turns true."""
        ...


class Device(Protocol):
    """What every device tells and does.

    A device whose calls may hang has a method kill() besides: it ends the call that hangs,
    from any thread, and the device with it; __exit__() comes after it. One whose work takes
    longer than it can document has an attribute `alive_at`, the time.monotonic() at which it
    last got on: it counts as hanging only its reply time after that. One that can tell so without
    disturbing anything has a method unplugged_reason(), for any thread and at any time: why it
    counts as unplugged, empty while it is there, None where that can't be told now. Who has heard
    of it may wait for it to be there again.
    """

    @property
    def identity(self) -> Identity: ...

    @property
    def reply_time(self) -> float:
        """Seconds within which it answers any call, as documented; an exposure comes on top."""
        ...

    @property
    def settling(self) -> float:
        """Seconds that a new setting needs at most until it stands."""
        ...

    def make_safe(self) -> None:
        """Leave the device so that it may be walked away from; may be called twice."""
        ...

    def __enter__(self) -> Self: ...

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None: ...


class SLM(Device, Protocol):
    """A panel that shows uint8 grey levels unaltered; safe is the neutral grey 0."""

    @property
    def shape(self) -> tuple[int, int]: ...

    @property
    def displayed_pattern(self) -> str:
        """The identifier of the pattern that is on the panel now."""
        ...

    def show(self, identifier: str, grey: NDArray[np.uint8]) -> Setting[str]: ...

    @property
    def frame_time(self) -> float:
        """Seconds for which each frame of a video stands."""
        ...

    def play(self, identifier: str, video: NDArray[np.uint8]) -> Setting[str]:
        """Show frames (n, rows, columns) one after the other, again and again."""
        ...


class SpectralFilter(Device, Protocol):
    """A tunable filter; safe is parked at its first wavelength. Wavelengths in metres."""

    @property
    def wavelength_range(self) -> tuple[float, float]: ...

    @property
    def bandwidth(self) -> float:
        """Full width at half maximum, in metres."""
        ...

    @property
    def wavelength(self) -> float: ...

    def set_wavelength(self, wavelength: float) -> Setting[float]: ...


@dataclass(frozen=True)
class Slot:
    """One opening of a filter wheel: centre and full width at half maximum, in metres."""

    name: str
    wavelength: float
    bandwidth: float


@runtime_checkable
class FilterWheel(SpectralFilter, Protocol):
    """A wheel of filters, counted from 1; a wavelength is set by the slot that passes it."""

    @property
    def slots(self) -> tuple[Slot, ...]: ...

    @property
    def slot(self) -> int: ...

    def set_slot(self, number: int) -> Setting[int]: ...


class Camera(Device, Protocol):
    """A camera that takes one picture when asked; safe is stopped."""

    @property
    def shape(self) -> tuple[int, int]: ...

    @property
    def full_scale(self) -> int:
        """The digital number at which a pixel counts as clipped."""
        ...

    @property
    def exposure_range(self) -> tuple[float, float]: ...

    @property
    def frame_time(self) -> float:
        """Seconds from the end of an exposure to a picture in memory."""
        ...

    def set_exposure(self, exposure: float) -> Setting[float]: ...

    def capture(self, cancelled: Callable[[], bool]) -> Frame: ...


@dataclass(frozen=True)
class Spectrum:
    """Light as a spectroradiometer measured it.

    wavelengths: metres, (n,), ascending. radiance: W/(sr m² m) at each, (n,); a thousand
    million times what is told per nanometre. integration_time: seconds for which light was taken.
    nd_filter_used: whether the instrument put a filter of its own before its sensor, whose effect
    is made up for. angle: of the field that it looked at, in radians. time: the clock's time at
    which the measurement began.
    """

    wavelengths: NDArray[np.float64]
    radiance: NDArray[np.float64]
    integration_time: float
    nd_filter_used: bool
    angle: float
    time: float


class Spectroradiometer(Device, Protocol):
    """Measures the spectral radiance of a spot when asked; safe is not measuring.

    measure() takes as long as the light is dim, which comes on top of its reply time: it tells
    `alive_at` meanwhile.
    """

    @property
    def wavelengths(self) -> NDArray[np.float64]:
        """At which it measures, in metres, (n,)."""
        ...

    def measure(self, cancelled: Callable[[], bool]) -> Spectrum: ...


class TargetChanger(Device, Protocol):
    """Whatever puts one of several named targets before the camera; safe is any."""

    @property
    def by_hand(self) -> bool:
        """Whether a person places them, who must be asked and waited for."""
        ...

    @property
    def names(self) -> tuple[str, ...]: ...

    @property
    def current_target(self) -> str: ...

    def place(self, name: str) -> Setting[str]: ...


@dataclass(frozen=True)
class Surroundings:
    """What a device is opened in: the bench's clock, and the world of simulated devices.

    A device's entry point is a callable `factory(surroundings, **options)` in the group
    "labapp.devices"; the options are the keys of its table in the bench file.
    """

    clock: Clock
    world: Any = None
