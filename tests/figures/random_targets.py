"""Targets of every kind by chance, about as large as the frame of a camera."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import torch

from figures.problems import log_uniform
from optics.camera import Camera
from optics.light import Spectrum, Waveform, blackbody, broadband, halogen, monochromatic
from simulator.scene import (
    Cube,
    Dark,
    Display,
    Drawable,
    Flat,
    PhotographPrint,
    Pinhole,
    Relief,
    Sheet,
    Sheets,
    Star,
    Target,
    UniformLight,
    display_primaries,
)
from simulator.scene.charts import checker, siemens_star, slanted_edge, usaf_1951
from simulator.scene.polygons import brick

_NODES = tuple(float(w) for w in np.linspace(380e-9, 780e-9, 9))


class Chance:
    """Draws targets before one camera. distance: metres; about where it is looked for."""

    def __init__(self, rng: np.random.Generator, camera: Camera, distance: float) -> None:
        self._rng, self._distance = rng, distance
        scale = camera.magnification(distance)
        self._frame = tuple(n * camera.sensor.pitch / scale for n in camera.sensor.shape)

    @property
    def _side(self) -> float:
        """Metres on the object, of the frame's shorter side."""
        return float(min(self._frame))

    def target(self, wavelength: float) -> Target:
        """Of any kind, in any lamp, which may flicker; it may move, and be polarised."""
        rng = self._rng
        kinds: tuple[Callable[[], Target], ...] = (
            self._star, self._pinhole, self._flat, self._photograph, self._cube, self._checker,
            self._edge, self._siemens, self._usaf, self._bricks, self._relief, self._display,
        )  # fmt: skip
        drawn = Dark() if rng.random() < 0.03 else kinds[rng.integers(len(kinds))]()
        more: dict[str, Any] = {}
        if not isinstance(drawn, Display):
            more["light"] = self._lamp(wavelength)
        if rng.random() < 0.3:
            more["lamp"] = self._waveform()
        if rng.random() < 0.2:
            more["velocity"] = tuple(rng.normal(0, self._side, 2))
        if rng.random() < 0.15:
            more["polarisation_angle"] = rng.uniform(0, math.pi)
        return replace(drawn, **more)

    def _lamp(self, wavelength: float) -> Spectrum | None:
        rng = self._rng
        lamps = (
            lambda: None,
            lambda: halogen(),
            lambda: blackbody(rng.uniform(2500, 6500)),
            lambda: broadband(),
            lambda: monochromatic(wavelength, 2e-9),
        )
        return lamps[rng.integers(len(lamps))]()

    def _waveform(self) -> Waveform:
        rng = self._rng
        shape = str(rng.choice(["sine", "square", "filament"]))
        return Waveform(
            shape,  # type: ignore[arg-type]
            float(rng.choice([50.0, 100.0, 120.0, 1000.0])),
            log_uniform(rng, 1e-3, 1.0),
            rng.uniform(0, 2 * math.pi),
            rng.uniform(0.2, 0.8),
        )

    def _place(self, share: float) -> tuple[float, float]:
        y, x = (float(self._rng.uniform(-share, share) * side / 2) for side in self._frame)
        return y, x

    def _paint(self) -> Spectrum:
        return Spectrum(_NODES, tuple(self._rng.uniform(0.02, 0.98, len(_NODES))))

    def _image(self, bands: int = 3) -> torch.Tensor:
        """Blots of many sizes."""
        rng = self._rng
        shape = (int(rng.integers(6, 40)), int(rng.integers(6, 40)))
        noise = torch.from_numpy(rng.random((1, bands, *shape)).astype(np.float32))
        smooth = torch.nn.functional.avg_pool2d(noise, int(rng.choice([1, 3, 5])), 1, 0)
        return smooth[0].permute(1, 2, 0).contiguous()

    def _star(self) -> Target:
        diameter = self._side * log_uniform(self._rng, 0.01, 0.3)
        return Star(diameter, self._distance, 1.0, self._place(1.1))

    def _pinhole(self) -> Target:
        return Pinhole(self._side * 0.2, self._distance, 1.0, self._place(0.5))

    def _flat(self) -> Target:
        return Flat(self._distance, 1.0)

    def _photograph(self) -> Target:
        cover = log_uniform(self._rng, 0.4, 2.0)
        return PhotographPrint(self._image(), self._distance, 1.0, cover=cover)

    def _cube(self) -> Target:
        image = self._image(len(_NODES))
        return Cube(image, _NODES, self._distance, 1.0, cover=log_uniform(self._rng, 0.4, 2.0))

    def _sheet(self, picture: Drawable) -> Target:
        return Sheets((Sheet(self._distance, ((None, picture),)),), 1.0)

    def _checker(self) -> Target:
        chart = checker([self._paint() for _ in range(24)], self._side, self._place(0.3))
        return Sheets((Sheet(self._distance, chart),), 1.0)

    def _edge(self) -> Target:
        rng, side = self._rng, 3 * self._side
        level = bool(rng.random() < 0.5)
        return self._sheet(slanted_edge(side, rng.uniform(-0.7, 0.7), horizontal=level))

    def _siemens(self) -> Target:
        return self._sheet(siemens_star(self._side * 0.8, int(self._rng.integers(3, 30))))

    def _usaf(self) -> Target:
        # Groups whose sheet is about as large as the frame: line pairs a metre double with each.
        first = round(math.log2(0.004 / self._side)) if self._side < 1 else -4
        first = min(max(first, -4), 8)
        return self._sheet(usaf_1951((first, first + 1)))

    def _bricks(self) -> Target:
        """Two or three before a wall, each farther away than the one before."""
        rng, side = self._rng, self._side
        count = int(rng.integers(2, 4))
        steps = np.sort(rng.uniform(0.7, 1.2, count))
        sheets = []
        for step in steps:
            size = (side * rng.uniform(0.15, 0.5), side * rng.uniform(0.2, 0.6))
            picture, cover = brick(size, int(rng.integers(1, 4)), self._place(0.8))
            paint = ((self._paint(), picture),)
            sheets.append(Sheet(float(step * self._distance), paint, cover))
        if rng.random() < 0.7:
            wall = Sheet(1.3 * self._distance, ((self._paint(), UniformLight()),))
            sheets.append(wall)
        return Sheets(tuple(sheets), 1.0)

    def _relief(self) -> Target:
        image = self._image()
        rows, columns = image.shape[:2]
        slope = torch.linspace(0.8, 1.3, columns).expand(rows, columns).clone()
        slope[rows // 3 : 2 * rows // 3, columns // 4 : columns // 2] = 0.7
        return Relief(image, slope * self._distance, 1.0, levels=int(self._rng.integers(2, 6)))

    def _display(self) -> Target:
        image = self._image()
        pitch = self._side / max(image.shape[:2]) * log_uniform(self._rng, 0.5, 2)
        return Display(image, pitch, self._distance, 1.0, display_primaries())
