"""Devices of the virtual bench, which speak the drivers' interfaces in-process."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Self

import numpy as np
import torch
from numpy.typing import NDArray

from drivers.errors import DeviceError
from drivers.interfaces import Frame, Identity, Setting, Surroundings
from optics.edge import require_positive
from optics.sensor import expose
from optics.slm import require_grey
from simulator.world import World


def require_duration(name: str, milliseconds: float) -> None:
    """Raise ValueError for a duration that is negative or not finite."""
    if not 0 <= milliseconds < math.inf:
        raise ValueError(f"{name} is {milliseconds}; it must be finite and not negative")


class _Simulated:
    """What all simulated devices share: a world, a clock, and no pretence."""

    model = ""

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

    @property
    def identity(self) -> Identity:
        return Identity(self.model, "simulated", simulated=True)

    def make_safe(self) -> None:
        """Nothing of a simulated device is left to be made safe, unless it says so."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.make_safe()

    def _refuse(self, command: str, reply: str, remedy: str) -> DeviceError:
        return DeviceError(self.model, command, reply, remedy)


class SimulatedSLM(_Simulated):
    """A liquid-crystal panel whose pixels are the world's."""

    model = "simulated SLM"

    def __init__(self, surroundings: Surroundings) -> None:
        super().__init__(surroundings)
        self._shown = "neutral"

    @property
    def shape(self) -> tuple[int, int]:
        return self._world.camera.panel.shape

    @property
    def shown(self) -> str:
        return self._shown

    def show(self, identifier: str, grey: NDArray[np.uint8]) -> Setting[str]:
        try:
            require_grey(self._world.camera.panel, grey)
        except (TypeError, ValueError) as error:
            raise self._refuse(f"show {identifier}", str(error), "Compute it again") from error
        self._world.grey = grey
        self._shown = identifier
        ready = self._clock.now() + self._world.camera.panel.settling
        return Setting(identifier, identifier, ready)

    def make_safe(self) -> None:
        self.show("neutral", np.zeros(self.shape, dtype=np.uint8))


class SimulatedFilter(_Simulated):
    """A liquid-crystal tunable filter with a Gaussian band.

    range_nm: lowest and highest wavelength. bandwidth_nm: full width at half maximum.
    settling_ms: time until a new wavelength stands.
    """

    model = "simulated tunable filter"

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
        self._settling = settling_ms * 1e-3
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
        if not low <= wavelength <= high:
            raise self._refuse(
                f"tune to {wavelength * 1e9:.1f} nm",
                f"out of range, {low * 1e9:.0f} to {high * 1e9:.0f} nm",
                "Choose a wavelength in the range",
            )
        # A VariSpec resolves 0.01 nm; integer picometres keep the value exact in files.
        actual = round(wavelength * 1e11) / 1e11
        self._world.wavelength = actual
        return Setting(wavelength, actual, self._clock.now() + self._settling)

    def make_safe(self) -> None:
        self.set_wavelength(self._range[0])


class SimulatedCamera(_Simulated):
    """A camera whose every picture follows from the state of the world and a seed.

    readout_ms: time from the end of an exposure to a picture in memory.
    """

    model = "simulated camera"

    def __init__(self, surroundings: Surroundings, readout_ms: float = 8.0) -> None:
        super().__init__(surroundings)
        require_duration("readout_ms", readout_ms)
        self._readout = readout_ms * 1e-3
        self._exposure = 0.01
        self._number = 0
        self._generator = torch.Generator()
        self.reseed(0, 0, 0)

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

    def reseed(self, run: int, step: int, frame: int) -> None:
        state = np.random.SeedSequence([run, step, frame]).generate_state(2)
        self._generator.manual_seed(int(state[0]) << 31 ^ int(state[1]))

    def set_exposure(self, exposure: float) -> Setting[float]:
        low, high = self.exposure_range
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
        began = self._clock.now()
        try:
            rate, plan = self._world.light()
        except ValueError as error:
            raise self._refuse("capture", str(error), "Change the scene or the bench") from error
        sensor = self._world.camera.sensor
        numbers = expose(
            rate,
            self._exposure,
            sensor,
            self._generator,
            shot_noise=plan.is_on("shot noise"),
            read_noise=plan.is_on("read noise"),
            dark_current=plan.is_on("dark current"),
        )
        self._clock.wait_until(began + self._exposure + self._readout, cancelled)
        self._number += 1
        image = numbers.numpy().astype(np.uint16)
        return Frame(image, self._exposure, sensor.gain, began, self._number)


class SimulatedTargets(_Simulated):
    """A changer that puts the scene's targets before the camera, one at a time."""

    model = "simulated target changer"

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(self._world.scene.targets)

    @property
    def placed(self) -> str:
        return self._world.target

    def place(self, name: str) -> Setting[str]:
        if name not in self.names:
            raise self._refuse(
                f"place {name}", "no such target", f"Choose one of {', '.join(self.names)}"
            )
        self._world.target = name
        return Setting(name, name, self._clock.now())
