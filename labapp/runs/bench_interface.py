"""What a run asks of a bench: open devices, and what is known of them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from contextlib import AbstractContextManager
from typing import TYPE_CHECKING, Protocol

from drivers.errors import DeviceError
from drivers.interfaces import (
    SLM,
    Camera,
    Clock,
    Device,
    FilterWheel,
    SpectralFilter,
    TargetChanger,
)
from drivers.supervised import SupervisedDevice

if TYPE_CHECKING:
    # Types alone: who takes a run over another kind of bench needs nothing of what these load.
    from labapp.files.bench_file import BenchFile
    from labapp.files.scene_file import SceneFile
    from optics.camera import Camera as CameraDescription
    from simulator.world import World


class Bench(Protocol):
    """Devices that are open, and the camera that they make up.

    labapp.bench opens one from a bench file. A person's own script may bring another.
    """

    @property
    def file(self) -> BenchFile:
        """As it was read; the record keeps it."""

    @property
    def scene_file(self) -> SceneFile | None:
        """What simulated devices see; None without any."""

    @property
    def description(self) -> CameraDescription:
        """The camera, with the calibration in force."""

    @property
    def clock(self) -> Clock: ...

    @property
    def world(self) -> World | None:
        """Behind simulated devices; None without any."""

    @property
    def slm(self) -> SLM: ...

    @property
    def filter(self) -> SpectralFilter: ...

    @property
    def wheel(self) -> FilterWheel | None:
        """The filter, if it is a wheel."""

    @property
    def camera(self) -> Camera: ...

    @property
    def targets(self) -> TargetChanger: ...

    @property
    def devices(self) -> Mapping[str, Device]:
        """All of them by name."""

    @property
    def supervised_devices(self) -> Mapping[str, SupervisedDevice]:
        """The same, as those who open them again see them."""

    @property
    def simulated_devices(self) -> list[str]:
        """The names of those that are simulated."""

    def calibration_warnings_at(self, wavelengths: Iterable[float]) -> tuple[str, ...]:
        """Why the calibration in force may not hold at wavelengths in metres, in words."""

    def cancellable_by(self, cancelled: Callable[[], bool]) -> AbstractContextManager[None]:
        """While the block runs, no call of a device outlasts `cancelled` by much."""

    def failed_devices(self) -> list[str]:
        """The devices that were given up, and why."""

    def make_safe(self) -> list[DeviceError]:
        """SLM neutral, filter parked, camera stopped; what failed of it."""

    def device_error(self, role: str, command: str, reply: str) -> DeviceError:
        """What is wrong with a device, in the words of those who use it."""
