"""A bench in numpy, with a truth of its own, that calibrations are judged by.

It shares nothing with the code under test: light on turned and mirrored pixels is a sum over
the panel's pixels (finufft), the phase of a level comes from a table, noise from numpy.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import finufft
import numpy as np
from scipy import ndimage

from optics.measuring.registration import Registration

LEVELS = 256


def mapped(centre, matrix, wavelength=532e-9):
    """A registration that is known beforehand."""
    none = np.zeros((0, 2)), np.zeros(0, dtype=bool)
    return Registration(wavelength, centre, matrix, np.eye(3), (0.0, 0.0), *none)


def curve(reach, gamma=1.0, wiggle=0.0, bend=0.0):
    """A distorted response: radians of all levels, from 0 to about reach."""
    x = np.linspace(0, 1, LEVELS)
    y = x**gamma + wiggle * np.sin(4 * np.pi * x) + bend * np.sin(2 * np.pi * x)
    return reach * np.maximum.accumulate(y)


def turned(degrees, flip_x=False, flip_y=False, scale=190.0, stretch=1.0):
    """A matrix from cycles per panel pixel to sensor pixels, (y, x) of both: first the mirror,
    then the scale, then the turn from x towards y."""
    angle = np.radians(degrees)
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    size = np.diag([scale * stretch * (-1 if flip_y else 1), scale * (-1 if flip_x else 1)])
    # (y, x): y' = cos y + sin x, x' = cos x - sin y.
    return turn @ size


@dataclass
class NumpyBench:
    """phases: (region rows, region columns, levels) radians. matrix, centre: from cycles per
    panel pixel to sensor pixels, (y, x). path: (rows, columns) radians that the panel adds.
    unmodulated: share of the light. blur: of the phase by neighbours, panel pixels. star:
    sensor pixels across. electrons: per second in all. finer: samples in a pixel along an axis."""

    phases: np.ndarray
    matrix: np.ndarray
    centre: tuple = (61.3, 78.4)
    panel: tuple = (96, 128)
    sensor: tuple = (120, 160)
    path: np.ndarray | float = 0.0
    unmodulated: float = 0.0
    blur: float = 0.0
    star: float = 1.0
    electrons: float = 4e6
    finer: int = 3
    gain: float = 2.6
    read_noise: float = 2.4
    black: float = 64.0
    full_well: float = 10500.0
    hot: tuple = ((20, 30, 3000.0), (100, 120, 900.0), (70, 140, 20000.0))
    rng: np.random.Generator = field(default_factory=lambda: np.random.default_rng(5))

    def shown_phase(self, grey):
        rows, columns = self.phases.shape[:2]
        phase = np.empty(self.panel)
        for r, band in enumerate(np.array_split(np.arange(self.panel[0]), rows)):
            for c, part in enumerate(np.array_split(np.arange(self.panel[1]), columns)):
                block = np.ix_(band, part)
                phase[block] = self.phases[r, c][grey[block]]
        return phase

    def _places(self):
        """(y, x) pixels of samples inside every pixel, (sensor rows, columns, samples)."""
        finer = self.finer
        inside = (np.arange(finer) + 0.5) / finer - 0.5
        y = np.arange(self.sensor[0])[:, None, None, None] + inside[:, None]
        x = np.arange(self.sensor[1])[None, :, None, None] + inside[None, :]
        y, x = np.broadcast_arrays(y, x)
        return np.stack([y, x], -1).reshape(*self.sensor, finer * finer, 2)

    def _intensity(self, wave, places):
        vectors = (places - np.asarray(self.centre)) @ np.linalg.inv(self.matrix).T
        finer = wave.shape[0] / self.panel[0]
        ky, kx = (2 * np.pi * vectors[..., axis].ravel() / finer for axis in (0, 1))
        field_ = finufft.nufft2d2(ky, kx, wave.astype(complex), isign=-1, eps=1e-9)
        total = wave.size * np.sum(np.abs(wave) ** 2)
        share = np.abs(field_) ** 2 / total
        # One cycle per pixel each way holds all light.
        area = abs(np.linalg.det(self.matrix)) * finer**2
        return (share * wave.size / area).reshape(places.shape[:-1])

    def shares(self, grey):
        """Share of the light on each sensor pixel."""
        phase = self.shown_phase(grey)
        path = np.broadcast_to(self.path, self.panel)
        if self.blur:
            phase = ndimage.gaussian_filter(phase.repeat(4, 0).repeat(4, 1), 4 * self.blur)
            path = path.repeat(4, 0).repeat(4, 1)
        spots = [(0.0, 0.0)]
        if self.star:
            angles = np.arange(6) * np.pi / 3
            r = 0.35 * self.star
            spots = [(r * np.sin(a), r * np.cos(a)) for a in angles]
        light = np.zeros(self.sensor)
        for dy, dx in spots:
            places = self._places() - np.array([dy, dx])
            light += (1 - self.unmodulated) * self._intensity(
                np.exp(1j * (phase + path)), places
            ).mean(-1)
            if self.unmodulated:
                straight = self._intensity(np.exp(1j * path), places).mean(-1)
                light += self.unmodulated * straight
        return light / len(spots)

    def exposed(self, shares, seconds):
        """Digital numbers of a frame, with noise, hot pixels and an end to the scale."""
        mean = shares * self.electrons * seconds
        electrons = self.rng.poisson(mean).astype(float)
        for y, x, extra in self.hot:
            electrons[y, x] += extra
        electrons = np.minimum(electrons, self.full_well)
        electrons += self.read_noise * self.rng.standard_normal(self.sensor)
        return np.clip(np.round(electrons / self.gain + self.black), 0, 4095)

    def frame(self, grey, seconds):
        return self.exposed(self.shares(grey), seconds)

    def dark(self):
        return self.exposed(np.zeros(self.sensor), 1.0)
