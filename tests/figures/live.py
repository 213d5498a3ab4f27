"""Live pictures of a large sensor: frames a second, and the first after a change of pattern."""

from __future__ import annotations

import statistics
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from drivers.interfaces import Surroundings
from figures import Figure
from labapp.bench.opening import BenchFiles, read_scene
from labapp.files.bench_file import BenchFile
from labapp.files.reading import bundled_path, read_file
from optics.patterns import fresnel_lens
from optics.slm import phase_to_grey
from simulator.devices.simulated_camera import SimulatedCamera
from simulator.world import World

_SHAPE = (2048, 2448)
_ELECTRONS = 1e4
_FRAMES = 60
_PATTERNS = (40.0, -60.0, 25.0)
"""Metres, of the focal lengths of lenses that are shown one after the other."""

_RATE_GOAL, _FIRST_GOAL = 20.0, 1.5
_TOL = 1e-2
_TRIAL = 1e-3


@dataclass(frozen=True)
class Live:
    """rate: frames a second by the wall. cpu: seconds of processor time a frame. first: seconds
    from a new pattern to its first frame."""

    rate: float
    cpu: float
    first: float


def live_figures(folder: Path) -> list[Figure]:
    """The bundled bench with a sensor of 5 megapixels before the bundled photograph, at the
    simulated camera: on two cores, as users have it."""
    before = torch.get_num_threads()
    torch.set_num_threads(2)
    try:
        found = measured(_world(_SHAPE), _FRAMES)
    finally:
        torch.set_num_threads(before)
    return [
        Figure(
            "live frames 2448 x 2048, 1e4 electrons, nothing changed",
            f"≥ {_RATE_GOAL:g} frames/s",
            f"{found.rate:.0f} frames/s, {1e3 * found.cpu:.0f} ms of processor time each",
            found.rate >= _RATE_GOAL,
        ),
        Figure(
            "first frame after a change of pattern, 2448 x 2048, tol 1e-2",
            f"≤ {_FIRST_GOAL:g} s",
            f"{found.first:.2f} s",
            found.first <= _FIRST_GOAL,
        ),
    ]


def measured(world: World, frames: int) -> Live:
    """Frames that are taken one after the other, and the median first one of three patterns.

    world: with a photograph.
    """
    camera = SimulatedCamera(Surroundings(world.clock, world))
    world.target = "photograph"
    exposure = _exposure(world)
    camera.set_exposure(exposure)
    camera.capture(_never)
    began, cpu = time.perf_counter(), time.process_time()
    for _ in range(frames):
        camera.capture(_never)
    rate = frames / (time.perf_counter() - began)
    cpu = (time.process_time() - cpu) / frames
    firsts = []
    for focal_length in _PATTERNS:
        grey = _lens(world, focal_length)
        began = time.perf_counter()
        world.grey = grey
        camera.capture(_never)
        firsts.append(time.perf_counter() - began)
    return Live(rate, cpu, statistics.median(firsts))


def _world(shape: tuple[int, int]) -> World:
    files = BenchFiles.with_defaults()
    data = read_file(bundled_path("bench.toml"), BenchFile).model_dump(mode="json")
    # A well that holds the electrons that are asked for.
    changes = {"height": shape[0], "width": shape[1], "full_well_electrons": 6 * _ELECTRONS}
    data["sensor"] |= changes | {"gain_electrons_per_dn": 1.0, "bits": 16}
    camera = BenchFile.model_validate(data).build_camera()
    return World(camera, read_scene(files).build(), tol=_TOL)


def _exposure(world: World) -> float:
    """At which the mean pixel holds as many electrons as are asked for, or the brightest as many
    as are read without clipping."""
    rate = world.electron_rates(_TRIAL)[0]
    well = world.camera.sensor.full_well
    return min(_ELECTRONS / float(rate.mean()), 0.95 * well / float(rate.max()))


def _lens(world: World, focal_length: float) -> np.ndarray:
    panel = world.camera.panel
    phase = fresnel_lens(panel, focal_length, world.wavelength)
    return phase_to_grey(panel, phase, world.wavelength).numpy()


def _never() -> bool:
    return False


MEASUREMENTS = {"live": live_figures}
