"""The simulated camera's own figures, measured from its frames as EMVA 1288 does."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from drivers.interfaces import Surroundings
from figures import Figure
from optics.camera import Camera, Lens, Panel, Sensor
from optics.measuring import CameraNoise, PairedFrames, characterise_camera
from optics.threads import single_threaded
from simulator.devices.simulated_camera import SimulatedCamera
from simulator.scene import Dark, Flat, Scene
from simulator.world import World

Frames = tuple[NDArray[np.uint16], ...]

_GOAL = 0.02
_TOL = 1e-3

SENSOR = Sensor(
    shape=(256, 256), bits=12, full_well=9500.0, gain=2.6, read_noise=2.4, dark_current=50.0,
    black_level=64.0, prnu=0.012, dsnu=1.6,
)  # fmt: skip

_PANEL = Panel(shape=(24, 32), pitch=40e-6, fill_factor=1.0, unmodulated=0.0)

_LONGEST = 0.2
"""Seconds of exposure, at which the even light overfills the wells."""

_SHARES = (0.002, *(float(share) for share in np.linspace(0.02, 1.0, 25)))
"""Of that, the exposures of the photon transfer curve. In the first hardly any dark current adds
to the read noise."""


@dataclass(frozen=True)
class Bench:
    """A camera before a lamp, and without it."""

    world: World
    camera: SimulatedCamera

    def frames(self, target: str, exposure: float, count: int) -> Frames:
        self.world.target = target
        self.camera.set_exposure(exposure)
        return tuple(self.camera.capture(lambda: False).image for _ in range(count))


@single_threaded
def emva_figures(folder: Path) -> list[Figure]:
    """Gain, noise, dark current, linearity and non-uniformity, as they were put in."""
    bench, rate = _bench()
    found = _measured(bench)
    sensor = bench.world.camera.sensor
    assert found.prnu is not None
    assert found.linearity is not None
    pairs = {
        "gain": (found.gain.value, sensor.gain),
        "read noise": (found.read_noise.value, sensor.read_noise),
        "dark current": (found.dark_current.value, sensor.dark_current),
        "electrons by time": (found.linearity.rate * found.gain.value, rate),
        "PRNU": (found.prnu.value, sensor.prnu),
        "DSNU": (found.dsnu.value, sensor.dsnu),
    }
    errors = {name: value / put_in - 1 for name, (value, put_in) in pairs.items()}
    errors["linearity"] = found.linearity.error.value
    return [
        Figure(
            "simulated frames measured as EMVA 1288 does, against what was put in",
            f"within {_GOAL:.0%}",
            ", ".join(f"{name} {error:+.1%}" for name, error in errors.items()),
            all(abs(error) <= _GOAL for error in errors.values()),
        )
    ]


def _bench() -> tuple[Bench, float]:
    """With even light that fills the wells a little before the longest exposure; the
    electrons per second that were asked for, as the world tells them before any frame."""
    lens = Lens(0.125, 40.0, 2.0)
    camera = Camera(_PANEL, lens, SENSOR)
    unit = World(camera, Scene({"even": Flat(2.0, 1.0)}), tol=_TOL).electron_rates()[0]
    wanted = 1.1 * SENSOR.full_well / _LONGEST
    radiance = wanted / float(unit.mean())
    scene = Scene({"dark": Dark(), "even": Flat(2.0, radiance)})
    world = World(camera, scene, tol=_TOL)
    return Bench(world, SimulatedCamera(Surroundings(world.clock, world))), wanted


def _measured(bench: Bench) -> CameraNoise:
    exposures = [round(share * _LONGEST, 6) for share in _SHARES]
    frames: list[NDArray[np.uint16]] = []
    for target in ("dark", "even"):
        for time in exposures:
            frames += bench.frames(target, time, 2)
    return characterise_camera(
        PairedFrames(
            frames,
            np.tile(np.repeat(exposures, 2), 2),
            np.repeat([False, True], 2 * len(exposures)),
            2**SENSOR.bits - 1,
        )
    )


MEASUREMENTS = {"emva": emva_figures}
