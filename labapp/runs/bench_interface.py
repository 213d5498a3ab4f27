"""The interface of a bench that a run needs: open devices, and their description."""

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
    """A bench as a run needs it: open devices, and the description of their camera.

    labapp.bench opens one from a bench file. A user's own script may implement another.
    """

    @property
    def file(self) -> BenchFile:
        """The bench file with which the run began; the run's record keeps it."""

    @property
    def scene_file(self) -> SceneFile | None:
        """The scene that a run photographs with simulated devices; None without any."""

    @property
    def description(self) -> CameraDescription:
        """The description of the run's camera, with its calibration."""

    frame_delays: FrameDelays | None
    """What a run's frames take beyond what the devices document; None until it is measured."""

    @property
    def clock(self) -> Clock: ...

    @property
    def world(self) -> World | None:
        """The state that the simulated devices of a run share; None without any."""

    @property
    def slm(self) -> SLM: ...

    @property
    def filter(self) -> SpectralFilter: ...

    @property
    def wheel(self) -> FilterWheel | None:
        """The filter of a run's shots if it is a wheel, else None."""

    @property
    def camera(self) -> Camera: ...

    @property
    def targets(self) -> TargetChanger: ...

    @property
    def devices(self) -> Mapping[str, Device]:
        """All devices that a run uses, by role."""

    @property
    def supervised_devices(self) -> Mapping[str, SupervisedDevice]:
        """All devices that a run uses, by role, with what is needed to open them again."""

    @property
    def simulated_devices(self) -> list[str]:
        """Roles of the simulated devices that a run uses."""

    def calibration_warnings_at(self, wavelengths: Iterable[float]) -> tuple[str, ...]:
        """Return why the calibration may not hold at a run's wavelengths, in metres."""

    def cancellable_by(self, cancelled: Callable[[], bool]) -> AbstractContextManager[None]:
        """Return a context in which a run's device calls end soon after the run is cancelled.

        The run is cancelled when `cancelled` returns true.
        """

    def failed_devices(self) -> list[str]:
        """Return the devices that were given up during a run, and why."""

    def make_safe(self) -> list[DeviceError]:
        """Leave a run's devices safe, and return the errors.

        The SLM is set to neutral, the filter is parked and the camera stopped.
        """

    def device_error(self, role: str, command: str, reply: str) -> DeviceError:
        """Return the error of a device that failed in a run's shot, with its role on the bench."""
