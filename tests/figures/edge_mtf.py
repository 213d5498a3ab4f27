"""The modulation transfer of a simulated slanted edge, against that of pupil and pixels."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import torch

from figures import Figure
from optics.camera import Camera, Lens, Panel, Sensor
from optics.camera.system_mtf import system_mtf
from optics.light import Band
from optics.measuring.slanted_edge import measure_edge_response
from optics.threads import single_threaded
from simulator.imaging import Imaging
from simulator.mount import Mount
from simulator.panel_content import PanelContent
from simulator.scene import Sheet, Sheets, Target
from simulator.scene.charts import slanted_edge as chart
from simulator.situation import Situation

_GOAL = 0.01
_TOL = 1e-3
_ANGLE = math.radians(5)
_FRAMES = 300
_HIGHEST = 0.5
"""Cycles per pixel up to which it is compared: Nyquist's."""

_WAVELENGTH = 550e-9

CAMERA = Camera(
    # Pixels without gaps: the formula counts the panel as one mirror.
    Panel(shape=(48, 64), pitch=60e-6, fill_factor=1.0, unmodulated=0.0),
    Lens(0.125, 20.0, 2.0),
    Sensor(shape=(192, 208), pitch=8e-6, full_well=1e4),
)
"""Its panel, narrower than its stop, blurs more from top to bottom than from side to side."""

_DEFOCUSED = 1.9
"""Metres: a fifth of a wave and more out of focus."""


@single_threaded
def edge_figure(folder: Path) -> list[Figure]:
    """An upright and a level edge, in focus and out of it, from the mean of noisy frames."""
    errors = {
        f"{way}, {focus}": mtf_error(distance, horizontal=horizontal)
        for focus, distance in (("in focus", CAMERA.lens.focus_distance), ("beside", _DEFOCUSED))
        for way, horizontal in (("upright", False), ("level", True))
    }
    return [
        Figure(
            "slanted-edge MTF of simulated frames against pupil, focus and pixels",
            f"within {_GOAL}",
            ", ".join(f"{name} {error:.4f}" for name, error in errors.items()),
            max(errors.values()) <= _GOAL,
        )
    ]


def mtf_error(distance: float, *, horizontal: bool) -> float:
    """The largest deviation up to Nyquist's frequency."""
    found = measure_edge_response(_pictured(_edge(distance, horizontal)))
    inside = found.frequencies <= _HIGHEST
    frequencies = found.frequencies[inside]
    across = (math.pi / 2 if found.horizontal else 0.0) - found.angle
    expected = system_mtf(CAMERA, _WAVELENGTH, frequencies / CAMERA.sensor.pitch, across, distance)
    return float(np.abs(found.mtf[inside] - expected).max())


def _edge(distance: float, horizontal: bool) -> Target:
    side = 3 * max(CAMERA.sensor.shape) * CAMERA.sensor.pitch / CAMERA.magnification(distance)
    edge = chart(side, _ANGLE, dark=0.1, bright=0.9, horizontal=horizontal)
    return Sheets((Sheet(distance, ((None, edge),)),), 1e9)


def _pictured(target: Target) -> np.ndarray:
    """Electrons of each pixel, by frames of an exposure that half fills the wells."""
    neutral = PanelContent.of(np.zeros((1, *CAMERA.panel.shape), np.uint8), math.inf)
    unit = Situation(
        CAMERA, Mount(), target, Band(_WAVELENGTH, 2e-9), neutral, 0.0, 1e-3, numerics=1e-4
    )
    sensor = CAMERA.sensor
    brightest = unit.picture_probe.brightest
    s = Situation(
        CAMERA, Mount(), target, unit.band, neutral, 0.0, 0.5 * sensor.full_well / brightest,
        numerics=1e-4,
    )  # fmt: skip
    imaging, chance = Imaging(_TOL), torch.Generator().manual_seed(0)
    stream = imaging.stream(s, imaging.plan(s))
    total = sum(stream.frame(chance).astype(np.float64) for _ in range(_FRAMES))
    return np.asarray((total / _FRAMES - sensor.black_level) * sensor.gain)


MEASUREMENTS = {"edge": edge_figure}
