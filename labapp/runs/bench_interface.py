"""What a run needs of a bench: open devices, and their description."""

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

if TYPE_CHECKING:
    # These are imported for types only: they load much that a user's own bench may not need.
    from drivers.supervised import SupervisedDevice
    from labapp.common.frame_delays import FrameDelays
    from labapp.files.bench_file import BenchFile
    from labapp.files.scene_file import SceneFile
    from optics.camera import Camera as CameraDescription
    from simulator.world import World


class Bench(Protocol):
    """Open devices, and the description of their camera.

    labapp.bench opens one from a bench file. A user's own script may implement another.
    """

    @property
    def file(self) -> BenchFile:
        """The bench file as it was at the start; the record keeps it."""

    @property
    def scene_file(self) -> SceneFile | None:
        """The scene before simulated devices; None without any."""

    @property
    def description(self) -> CameraDescription:
        """The description of the camera, with its calibration."""

    frame_delays: FrameDelays | None
    """What frames take beyond what the devices document; None until it is measured."""

    @property
    def clock(self) -> Clock: ...

    @property
    def world(self) -> World | None:
        """The state that the simulated devices share; None without any."""

    @property
    def slm(self) -> SLM: ...

    @property
    def filter(self) -> SpectralFilter: ...

    @property
    def wheel(self) -> FilterWheel | None:
        """The filter if it is a wheel, else None."""

    @property
    def camera(self) -> Camera: ...

    @property
    def targets(self) -> TargetChanger: ...

    @property
    def devices(self) -> Mapping[str, Device]:
        """All devices by role."""

    @property
    def supervised_devices(self) -> Mapping[str, SupervisedDevice]:
        """All devices by role, with what is needed to open them again."""

    @property
    def simulated_devices(self) -> list[str]:
        """Roles of the simulated devices."""

    def calibration_warnings_at(self, wavelengths: Iterable[float]) -> tuple[str, ...]:
        """Return why the calibration may not hold at these wavelengths.

        wavelengths: metres.
        """

    def cancellable_by(self, cancelled: Callable[[], bool]) -> AbstractContextManager[None]:
        """Return a context in which device calls end soon after `cancelled` returns true."""

    def failed_devices(self) -> list[str]:
        """Return the devices that were given up, and why."""

    def make_safe(self) -> list[DeviceError]:
        """Set the SLM to neutral, park the filter and stop the camera; return the errors."""

    def device_error(self, role: str, command: str, reply: str) -> DeviceError:
        """Return the error of a device that failed, with its role on the bench."""
