"""What every kind of laboratory device can do, as small protocols, and the data that they exchange.

All quantities are in SI units. A device is a context manager; leaving it closes it. Every call ends
within the device's documented time or raises a DeviceError. A call that sets a value returns the
value that was really set and the time at which it stands. A measurement waits for the latest of
these times, so that devices settle at the same time.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable
from dataclasses import dataclass
from types import TracebackType
from typing import Any, Generic, Protocol, Self, TypeAlias, TypeVar, runtime_checkable

import numpy as np
from numpy.typing import NDArray

T = TypeVar("T")

Region: TypeAlias = "tuple[int, int, int, int]"
"""x, y, width and height of a part of a camera's frames, in pixels."""


@dataclass(frozen=True)
class Identity:
    """Model and serial number, and whether the device is simulated."""

    model: str
    serial: str
    simulated: bool


@dataclass(frozen=True)
class Setting(Generic[T]):
    """A requested value, the value that was really set, and the clock's time at which it stands."""

    request: T
    actual: T
    ready_at: float


@dataclass(frozen=True)
class Frame:
    """A raw picture and the settings that it was really taken with.

    image: (rows, columns), uint16. exposure: seconds. gain: electrons per digital number. time: the
    clock's time at which the exposure began. number: count by the camera, which reveals lost and
    repeated frames. checksum: CRC-32 of the image's bytes as they left the camera, None if the
    camera gives none.
    """

    image: NDArray[np.uint16]
    exposure: float
    gain: float
    time: float
    number: int
    checksum: int | None = None


def checksum(image: NDArray[np.uint16]) -> int:
    """Return an image's CRC-32, row by row, as Frame.checksum holds it."""
    return zlib.crc32(np.ascontiguousarray(image).data)


class Clock(Protocol):
    """Time in seconds; in a simulation it may run faster than real time."""

    def now(self) -> float: ...

    def wait_until(self, time: float, cancelled: Callable[[], bool]) -> None:
        """Wait until `time`, or until soon after `cancelled()` is true."""
        ...


class Device(Protocol):
    """What every device can do.

    Five members are optional. A device whose calls may hang has a method kill(), which may be
    called from any thread: it ends the hanging call and the device; __exit__() is called after it.
    A device whose work takes longer than it can document has an attribute `alive_at`, the
    time.monotonic() of its last progress; it counts as hanging when its reply time has passed since
    then. A device that can detect unplugging without disturbing anything has a method
    unplugged_reason(), which may be called from any thread at any time. It returns why the device
    counts as unplugged, an empty string while it is there, and None if that is unknown. The
    application then waits until the device is there again. A driver that changes something which
    isn't the device's own, such as a connector's properties, has a property `notices`, a tuple of
    sentences for the records of runs, which may be read from any thread. A driver whose device is
    left safe even if its process is killed, by a process of the driver's own or by the system, has
    the class attribute `is_left_safe_when_killed`, which is true. Of others, a guard does it: it
    opens the device with the same options and calls make_safe().
    """

    @property
    def identity(self) -> Identity: ...

    @property
    def reply_time(self) -> float:
        """Documented seconds within which a call is answered, in addition to an exposure."""
        ...

    @property
    def settling(self) -> float:
        """Longest time in seconds until a new setting stands."""
        ...

    def make_safe(self) -> None:
        """Go into a state that may be left alone; may be called twice."""
        ...

    def __enter__(self) -> Self: ...

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None: ...


class SLM(Device, Protocol):
    """Spatial light modulator that shows uint8 grey levels unaltered; its safe state is grey 0."""

    @property
    def shape(self) -> tuple[int, int]: ...

    @property
    def displayed_pattern(self) -> str:
        """Identifier of the pattern that is shown now."""
        ...

    def show(self, identifier: str, grey: NDArray[np.uint8]) -> Setting[str]: ...

    @property
    def frame_time(self) -> float:
        """Seconds for which each frame of a video is shown."""
        ...

    def play(self, identifier: str, video: NDArray[np.uint8]) -> Setting[str]:
        """Show a video's frames (n, rows, columns) in an endless loop."""
        ...


class SpectralFilter(Device, Protocol):
    """Tunable filter, in metres; its safe state is its first wavelength."""

    @property
    def wavelength_range(self) -> tuple[float, float]: ...

    @property
    def bandwidth(self) -> float:
        """Full width at half maximum of the passed band, in metres."""
        ...

    @property
    def wavelength(self) -> float: ...

    def set_wavelength(self, wavelength: float) -> Setting[float]: ...


@dataclass(frozen=True)
class Slot:
    """A filter in a wheel: name, centre and full width at half maximum in metres."""

    name: str
    wavelength: float
    bandwidth: float


@runtime_checkable
class FilterWheel(SpectralFilter, Protocol):
    """Wheel of filters whose slots count from 1; a wavelength selects a slot."""

    @property
    def slots(self) -> tuple[Slot, ...]: ...

    @property
    def slot(self) -> int: ...

    def set_slot(self, number: int) -> Setting[int]: ...


class Camera(Device, Protocol):
    """Camera that takes one picture per call; its safe state is stopped.

    Other members are optional. For a camera that may obey a new exposure some frames late, a method
    measure_latency(exposures) takes two exposures in seconds, finds by their light how many frames
    after a change to discard, discards so many from then on, and returns the number. The attribute
    `latency_option` is the name of the driver's option that tells this number.

    A camera whose gain a plan may set has `gain_db`, the present one, `gain_range`, both in
    decibels, and set_gain(gain_db), which returns the Setting. One whose pixels a plan may choose
    has set_region(region, binning): region is x, y, width, height in pixels of the frames that the
    opened camera takes, binning how many of them each way are averaged into one; `shape` follows.
    Both methods take None for what the camera has when it's opened, and make_safe() restores that.
    """

    @property
    def shape(self) -> tuple[int, int]: ...

    @property
    def full_scale(self) -> int:
        """Digital number at which a pixel counts as clipped."""
        ...

    @property
    def exposure_range(self) -> tuple[float, float]: ...

    @property
    def frame_time(self) -> float:
        """Seconds from the end of an exposure to the picture in memory."""
        ...

    def set_exposure(self, exposure: float) -> Setting[float]: ...

    def capture(self, cancelled: Callable[[], bool]) -> Frame: ...


@dataclass(frozen=True)
class Spectrum:
    """Spectral radiance that a spectroradiometer measured.

    wavelengths: metres, (n,), ascending. radiance: W/(sr m² m) at each wavelength, (n,), which is
    10⁹ times the number per nanometre. integration_time: seconds for which light was collected.
    nd_filter_used: whether the instrument used its internal neutral-density filter, for which the
    radiance is corrected. angle: of the measured field, in radians. time: the clock's time at which
    the measurement began.
    """

    wavelengths: NDArray[np.float64]
    radiance: NDArray[np.float64]
    integration_time: float
    nd_filter_used: bool
    angle: float
    time: float


class Spectroradiometer(Device, Protocol):
    """Instrument that measures the spectral radiance of a spot.

    Its safe state is not to measure. measure() takes longer for dimmer light, in addition to the
    reply time; meanwhile it updates `alive_at`.
    """

    @property
    def wavelengths(self) -> NDArray[np.float64]:
        """Wavelengths at which it measures, in metres, (n,)."""
        ...

    def measure(self, cancelled: Callable[[], bool]) -> Spectrum: ...


class TargetChanger(Device, Protocol):
    """Changer that puts a named target before the camera; any state is safe."""

    @property
    def by_hand(self) -> bool:
        """Whether a person, who must be asked and waited for, places the targets."""
        ...

    @property
    def names(self) -> tuple[str, ...]: ...

    @property
    def current_target(self) -> str: ...

    def place(self, name: str) -> Setting[str]: ...


@dataclass(frozen=True)
class Surroundings:
    """What a device is opened in: the bench's clock and the simulated world.

    world: shared state of simulated devices, None on a real bench. A device's entry point is a
    callable `factory(surroundings, **options)` in the group "labapp.devices"; the options are the
    keys of its table in the bench file.
    """

    clock: Clock
    world: Any = None
