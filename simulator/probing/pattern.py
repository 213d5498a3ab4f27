"""What is known of the PSF of what is shown, before any is computed."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import torch
from numpy.typing import NDArray

from optics.camera import Camera, Panel
from optics.edge import as_number
from optics.fourier import fft
from optics.plane import centred_pad, origin_to_centre, origin_to_corner
from optics.pupil import lens_distance, pupil_amplitude
from optics.slm import Modulator
from optics.slm.dispersion import max_phase
from optics.zernike import zernike
from simulator.formation.panels import modulator_at
from simulator.shown import Shown

Array = NDArray[np.float64]

_MOST_PICTURES = 4
"""Of a video, that are looked at: evenly among them."""

_BINS = 96
"""By which a transfer function is known."""


@dataclass(frozen=True, eq=False)
class Transfer:
    """H by cycles per metre on the sensor: the mean square of |H| over directions, its least, and
    the most that |1 - H| is up to a bin.

    low, high: of each bin; above the last there is nothing.
    """

    low: Array
    high: Array
    mean_square: Array
    least: Array
    lost: Array

    def lost_at(self, frequency: Array) -> Array:
        """|1 - H| at most up to a frequency; 2 beyond what is known."""
        index = np.searchsorted(self.high, frequency)
        return np.append(self.lost, 2.0)[index]

    def least_between(self, low: Array, high: Array) -> Array:
        return _least(self, self.least, low, high)

    def mean_square_between(self, low: Array, high: Array) -> Array:
        return _least(self, self.mean_square, low, high)


def _least(of: Transfer, values: Array, low: Array, high: Array) -> Array:
    """The least value of the bins that a range meets, and of those beside it; 0 where it goes
    beyond the last."""
    found = np.zeros(len(low))
    for k, (a, b) in enumerate(zip(low, high, strict=True)):
        if b > of.high[-1]:
            continue
        first = max(int(np.searchsorted(of.high, a)) - 1, 0)
        last = int(np.searchsorted(of.low, b, side="right")) if b > 0 else 0
        found[k] = values[first : last + 1].min()
    return found


class PatternProbe:
    """A shown pattern, or video, behind a camera's panel at a wavelength; metres.

    The far field of what leaves the panel, with everything that the panel does to it, and with
    the lens' wave for the nearest and the farthest of some distances. Each property is computed
    when it is first asked for.
    """

    def __init__(
        self, camera: Camera, shown: Shown, wavelength: float, distances: tuple[float, ...]
    ) -> None:
        if not distances:
            raise ValueError("distances is empty; give that of one layer at least")
        self.camera, self.shown, self.wavelength = camera, shown, wavelength
        self.distances = tuple(sorted({min(distances), max(distances)}))

    @property
    def panel(self) -> Panel:
        return self.camera.panel

    @cached_property
    def modulator(self) -> Modulator:
        return modulator_at(self.camera.panel, self.wavelength)

    @cached_property
    def greys(self) -> list[torch.Tensor]:
        """Different pictures that are shown, (rows, columns) uint8; of many, some."""
        names = sorted(self.shown.pictures)
        step = max(1, math.ceil(len(names) / _MOST_PICTURES))
        return [torch.from_numpy(self.shown.pictures[name].copy()) for name in names[::step]]

    @cached_property
    def phases(self) -> list[torch.Tensor]:
        """Radians of each picture, settled, float64."""
        return [torch.as_tensor(self.modulator.phase(grey)) for grey in self.greys]

    @cached_property
    def straight_reach(self) -> float:
        """Radians at the highest level, if the phase grew evenly with it."""
        return max_phase(self.modulator.panel, self.wavelength)

    @cached_property
    def fields(self) -> list[torch.Tensor]:
        """What leaves the panel for each picture, complex64."""
        return [self.modulator.modulation(one.to(torch.float32)) for one in self.phases]

    @cached_property
    def field(self) -> torch.Tensor:
        """What leaves the panel for the first of the pictures, complex64."""
        return self.fields[0]

    @cached_property
    def opened(self) -> torch.Tensor:
        """Share of each pixel that the stop, or its shadow from the middle distance, leaves open,
        (rows, columns) float64."""
        camera = replace(self.camera, separation=0.0)
        spread = 1 + as_number(self.camera.separation) / self.distances[0]
        lens = replace(camera.lens, f_number=camera.lens.f_number * spread)
        return pupil_amplitude(replace(camera, lens=lens))

    @cached_property
    def power(self) -> float:
        """Light that leaves the open pixels of the dimmest picture, over that of even ones of
        amplitude 1: a phase that is blurred within pixels sends less."""
        weight = self.opened**2
        light = [(field.abs().double() ** 2 * weight).sum() for field in self.fields]
        return float(min(light) / weight.sum()) if bool(weight.any()) else 0.0

    @property
    def period(self) -> float:
        """Metres on the sensor from one order of the panel's pixels to the next."""
        return self.wavelength * as_number(self.camera.lever) / self.panel.pitch

    def wave(self, distance: float) -> torch.Tensor:
        """Radians that the lens leaves on the panel's light of a point, (rows, columns)."""
        camera, lens = self.camera, self.camera.lens
        spread = 1 + as_number(camera.separation) / distance
        vergence = 1 / lens_distance(camera, distance) - 1 / lens.focus_distance
        y, x = self.panel.plane.mesh()
        bent = spread * lens.image_distance / as_number(camera.lever) * vergence
        path = bent / 2 * (y**2 + x**2)
        radius = as_number(lens.stop_diameter) / 2 / spread
        for n, m, strength in lens.aberrations:
            path = path + as_number(strength) * zernike(n, m, y / radius, x / radius)
        return torch.where(self.opened > 0, 2 * math.pi / self.wavelength * path, 0.0)

    @cached_property
    def lights(self) -> list[torch.Tensor]:
        """Far fields over one period of the panel's orders, the origin in the middle, each with
        a sum of 1: of every picture, and of light that ignores it, at every distance."""
        straight = torch.ones(self.panel.shape, dtype=torch.complex64)
        found = []
        for distance in self.distances:
            wave = self.wave(distance)
            lens = torch.polar(self.opened, wave).to(torch.complex64)
            found += [_far(lens * field) for field in (*self.fields, straight)]
        return found

    @cached_property
    def _envelopes(self) -> tuple[torch.Tensor, torch.Tensor]:
        """What one pixel makes of a period's light in the middle order, along each axis."""
        side = math.sqrt(self.panel.fill_factor)
        axes = []
        for n in self.lights[0].shape:
            place = (torch.arange(n, dtype=torch.float64) - n // 2) / n
            axes.append((side * torch.sinc(side * place) ** 2).to(torch.float32))
        return axes[0], axes[1]

    def _central(self, light: torch.Tensor) -> torch.Tensor:
        down, along = self._envelopes
        return light * down[:, None] * along

    @cached_property
    def order_light(self) -> float:
        """Share of the light that the panel's pixels send beside the middle order, at most."""
        least = min(float(self._central(light).double().sum()) for light in self.lights)
        return max(0.0, 1 - least)

    def beyond_orders(self, most: int) -> float:
        """Share of the light in orders beyond the first `most` on each side, at most."""
        if most == 0:
            return self.order_light
        side, found = math.sqrt(self.panel.fill_factor), []
        for light in self.lights:
            shares = []
            for n in light.shape:
                place = (torch.arange(n, dtype=torch.float64) - n // 2) / n
                orders = torch.arange(-most, most + 1, dtype=torch.float64)
                shares.append((side * torch.sinc(side * (place[:, None] + orders)) ** 2).sum(1))
            held = (light.double() * shares[0][:, None] * shares[1]).sum()
            found.append(float(held))
        return max(0.0, 1 - min(found))

    @cached_property
    def mean_turn(self) -> float:
        """Metres from a point's image to where a ray lands, in the mean: of any picture or light
        that ignores it, at any distance."""
        opened, lever = self.opened, as_number(self.camera.lever) * self.wavelength
        worst = 0.0
        straight = torch.ones(self.panel.shape, dtype=torch.complex64)
        for distance in self.distances:
            wave = self.wave(distance)
            for field in (*self.fields, straight):
                turns = []
                for axis in (0, 1):
                    n = field.shape[axis] - 1
                    step = torch.angle(field.narrow(axis, 1, n) * field.narrow(axis, 0, n).conj())
                    step = step.double() + wave.diff(dim=axis)
                    both = opened.narrow(axis, 1, n) * opened.narrow(axis, 0, n)
                    turns.append(float((step.abs() * both).sum() / both.sum().clamp(min=1e-9)))
                worst = max(worst, math.hypot(*turns) * 1.5)
        return worst / (2 * math.pi * self.panel.pitch) * lever

    @cached_property
    def _within(self) -> Array:
        """Least share of the middle order's light within squares around the axis, by half their
        side: k + 1/2 samples of a far field, whose shorter axis counts."""
        curves = [self._growing(self._central(light)) for light in self.lights]
        spread = 1 - self._scattered_beyond(len(curves[0]))
        return np.minimum(np.min(curves, axis=0), spread)

    def _growing(self, light: torch.Tensor) -> Array:
        rows, columns = light.shape
        # Both axes span one period: half sides are told in shares of it.
        y = (torch.arange(rows) - rows // 2).abs() / rows
        x = (torch.arange(columns) - columns // 2).abs() / columns
        away = torch.maximum(y[:, None], x[None, :])
        steps = min(rows, columns) // 2
        index = (away * 2 * steps).ceil().to(torch.int64).clamp(max=steps)
        sums = torch.bincount(index.flatten(), light.double().flatten(), minlength=steps + 1)
        total = sums.cumsum(0)
        return (total / total[-1]).numpy()

    def _scattered_beyond(self, count: int) -> Array:
        """What jitter spreads evenly over the period and leaves beyond each square."""
        share = self.modulator.scattered
        half = np.linspace(0, 1, count)
        return share * (1 - half**2)

    def beyond(self, half_side: float) -> float:
        """Share of the middle order's light beyond a square of so many metres to each side, at
        most: of any picture, at any distance, or of light that ignores the pattern."""
        steps = len(self._within) - 1
        # A sample's light may lie anywhere within it.
        index = math.floor(half_side / (self.period / 2) * steps - 0.5)
        if index >= steps - 1:
            return 0.0
        return 1.0 if index < 0 else float(max(0.0, 1 - self._within[index]))

    def reach(self, share: float) -> float:
        """Metres from a point's image beyond which less than a share of its light falls."""
        if not 0 < share <= 1:
            raise ValueError(f"share is {share:g}; give one above 0, up to 1")
        steps = len(self._within) - 1
        enough = np.flatnonzero(1 - self._within <= share)
        index = int(enough[0]) if len(enough) else steps
        return min((index + 1.5) / steps, 1.0) * self.period / 2

    @cached_property
    def peak(self) -> float:
        """Largest share of the light that a square metre of the sensor gets, of any picture at
        any distance, or of light that ignores the pattern."""
        return max(self._peak(light) for light in self.lights)

    @cached_property
    def peak_shown(self) -> float:
        """The same of the pictures alone."""
        each = len(self.fields) + 1
        return max(self._peak(one) for k, one in enumerate(self.lights) if (k + 1) % each)

    def _peak(self, light: torch.Tensor) -> float:
        rows, columns = light.shape
        # Samples may miss the top of a fringe, half a sample away: sinc(1/4)^-4 of it.
        return 1.6 * float(light.max()) * self.panel.fill_factor * rows * columns / self.period**2

    @cached_property
    def transfer(self) -> Transfer:
        """Least of all pictures and distances, with what ignores the pattern in it."""
        each = len(self.fields) + 1
        share = self.modulator.unmodulated
        shown = []
        for k in range(0, len(self.lights), each):
            straight = self.lights[k + each - 1]
            # Of a video, the mean.
            mean = torch.stack(self.lights[k : k + each - 1]).mean(0)
            shown.append((1 - share) * (1 - self.modulator.scattered) * mean + share * straight)
        found = [self._transfer(self._central(light)) for light in shown]
        return Transfer(
            found[0].low,
            found[0].high,
            np.min([one.mean_square for one in found], axis=0),
            np.min([one.least for one in found], axis=0),
            np.max([self._transfer(self._central(one)).lost for one in self.lights], axis=0),
        )

    def _transfer(self, light: torch.Tensor) -> Transfer:
        rows, columns = light.shape
        spectrum = _spectrum(light)
        squared = spectrum.abs().double() ** 2
        # Frequencies step by one over the period on both axes.
        fy = torch.fft.fftfreq(rows, 1 / rows, dtype=torch.float64)
        fx = torch.fft.fftfreq(columns, 1 / columns, dtype=torch.float64)
        radius = torch.hypot(fy[:, None], fx[None, :]) / self.period
        highest = 0.5 * min(rows, columns) / self.period
        edges = torch.from_numpy(np.geomspace(0.999 / self.period, highest, _BINS + 1))
        index = torch.bucketize(radius, edges)
        kept = index <= _BINS
        index, squared = index[kept], squared[kept]
        away = (1 - spectrum[kept]).abs().double()
        count = torch.bincount(index, minlength=_BINS + 1).clamp(min=1)
        mean = torch.bincount(index, squared, minlength=_BINS + 1) / count
        least = torch.full((_BINS + 1,), math.inf, dtype=torch.float64)
        least.scatter_reduce_(0, index, squared, "amin")
        filled = torch.isfinite(least)
        low = np.concatenate([[0.0], edges[:-1].numpy()])
        high = np.concatenate([[0.0], edges[1:].numpy()])
        on = filled.numpy()
        most = torch.zeros(_BINS + 1, dtype=torch.float64)
        lost = np.maximum.accumulate(most.scatter_reduce(0, index, away, "amax").numpy()[on])
        return Transfer(low[on], high[on], mean.numpy()[on], least.sqrt().numpy()[on], lost)


def _far(field: torch.Tensor) -> torch.Tensor:
    """Light of a field at twice its Nyquist rate, the origin in the middle, summing up to 1."""
    rows, columns = (2 * n for n in field.shape)
    padded = centred_pad(field, (rows, columns))
    light = fft(fft(padded, columns, -1), rows, -2).abs() ** 2
    return origin_to_centre(light / light.double().sum().to(torch.float32))


def _spectrum(light: torch.Tensor) -> torch.Tensor:
    rows, columns = light.shape
    around = origin_to_corner(light).to(torch.complex64)
    return fft(fft(around, columns, -1), rows, -2)
