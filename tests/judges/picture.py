"""A situation's mean picture as plain loops over everything there is, in double precision.

It shares nothing with `simulator.formation` but PSFOperator and Modulator: no cache, no recipe, no
ledger, no transform of a picture that isn't a whole one.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray
from scipy import constants

from optics.camera import Camera, Panel
from optics.camera.pupil import open_area, pupil_amplitude
from optics.gauss_legendre import gauss_legendre
from optics.light import Spectrum
from optics.plane import Plane
from optics.psf import PSFOperator
from optics.slm import Modulator
from optics.slm.dynamics import first_start_phase, relaxed_phase
from optics.slm.modulator import (
    front_reflection_share,
    scattered_share,
    transmitted_unmodulated_share,
)
from optics.slm.panel import PhaseResponse, max_phase
from simulator.scene.drawable import Drawable
from simulator.scene.target import Layer
from simulator.situation import Situation

Array = NDArray[np.float64]
Weighted = Iterator[tuple[float, float]]


@dataclass(frozen=True)
class Finest:
    """How fine the loops are.

    band, leak: Gauss-Legendre nodes of wavelength over the band and over the leak, and four at
    least between any two kinks of the spectra. times: nodes in every stretch of time. finer:
    samples a pixel. tol: of every PSF. orders: of the panel's pixels that light is looked for in.
    """

    band: int = 32
    leak: int = 32
    times: int = 12
    finer: int = 4
    tol: float = 1e-6
    orders: int = 1


def reference(
    s: Situation, check: Callable[[], None] = lambda: None, finest: Finest | None = None
) -> torch.Tensor:
    """Photo-electrons on each pixel over the exposure, (rows, columns) float64, in the mean.

    Made for pictures of some ten thousand pixels and panels of as many; check: as in
    expected_electrons().
    """
    return _Reference(s, finest or Finest(), check).picture()


class _Reference:
    def __init__(self, s: Situation, finest: Finest, check: Callable[[], None]) -> None:
        self._s, self._finest, self._check = s, finest, check
        if s.camera.separation:
            raise ValueError("the reference has no panel apart from its lens; give separation 0")
        self._target = s.target.for_camera(s.camera)
        self._camera = replace(s.camera, lens=s.mount.lens_in_panel_axes(s.camera.lens))
        sensor = s.camera.sensor
        self._half = self._window_half()
        rows, columns = (n + 2 * self._half for n in sensor.shape)
        self._plane = Plane((rows, columns), (sensor.pitch, sensor.pitch)).with_finer_pitch(
            finest.finer
        )

    def _window_half(self) -> int:
        """Pixels from a point to the end of its outermost order, of the longest wavelength."""
        longest = max(w for w, _ in self._wavelengths())
        camera = self._s.camera
        period = longest * float(camera.ray_matrix_b) / camera.panel.pitch
        return math.ceil((self._finest.orders + 0.5) * period / camera.sensor.pitch) + 1

    def picture(self) -> torch.Tensor:
        sensor = self._s.camera.sensor
        channels = [self._efficiency(k) for k in range(self._channels)]
        total = np.zeros((len(channels), *sensor.shape))
        for wavelength, passed in self._wavelengths():
            psfs: dict[tuple[float, int, float], Array] = {}
            photons = passed * wavelength / (constants.h * constants.c)
            for rows, moment in self._rows():
                for begin, end, frame in self._stretches(moment):
                    for time, seconds in _gauss(begin, end, self._nodes_in_time):
                        self._check()
                        light = self._on_pixels(self._composited(time, frame, wavelength, psfs))
                        light *= seconds * self._lamp(time) * photons
                        for channel, curve in enumerate(channels):
                            total[channel, rows] += float(curve.at(wavelength)) * light[rows]
        if sensor.colour is None:
            return torch.from_numpy(total[0])
        which = sensor.colour.channel_map(sensor.shape).numpy()
        return torch.from_numpy(np.take_along_axis(total, which[None], 0)[0])

    @property
    def _channels(self) -> int:
        colour = self._s.camera.sensor.colour
        return len(colour.channels) if colour else 1

    def _efficiency(self, channel: int) -> Spectrum:
        sensor = self._s.camera.sensor
        if sensor.colour is not None:
            return sensor.colour.efficiencies[sensor.colour.channels[channel]]
        return sensor.spectral_efficiency or Spectrum.flat(sensor.quantum_efficiency)

    # Time.

    def _rows(self) -> Iterator[tuple[slice, float]]:
        """Rows that are exposed together, and when."""
        sensor, moment = self._s.camera.sensor, self._s.exposure_start
        if sensor.shutter == "global":
            yield slice(0, sensor.shape[0]), moment
            return
        for row in range(sensor.shape[0]):
            yield slice(row, row + 1), moment + row * sensor.line_time

    @property
    def _nodes_in_time(self) -> int:
        lamp = self._target.lamp
        still = lamp is None or lamp.is_constant
        return (
            1 if still and not self._target.is_moving and not self._follows else self._finest.times
        )

    @property
    def _follows(self) -> bool:
        return bool(self._s.camera.panel.response_time) and self._s.panel_content.is_changing

    def _lamp(self, time: float) -> float:
        return 1.0 if self._target.lamp is None else float(self._target.lamp.at(time))

    def _stretches(self, moment: float) -> Iterator[tuple[float, float, int]]:
        """Parts of an exposure in which one frame is shown, and the frame."""
        shown, end = self._s.panel_content, moment + self._s.exposure
        if not shown.is_changing:
            yield moment, end, 0
            return
        count = math.floor(moment / shown.frame_time)
        while count * shown.frame_time < end:
            low = max(count * shown.frame_time, moment)
            high = min((count + 1) * shown.frame_time, end)
            if high > low:
                yield low, high, count % len(shown.names)
            count += 1

    # One moment.

    def _composited(
        self,
        time: float,
        frame: int,
        wavelength: float,
        psfs: dict[tuple[float, int, float], Array],
    ) -> Array:
        """Watts on samples of one wavelength, of all layers, the nearer before the farther."""
        light = np.zeros(self._plane.shape)
        for layer in reversed(self._target.layers):
            # What is on its way never stands twice the same.
            causes = (time if self._follows else 0.0, frame, layer.distance)
            if causes not in psfs:
                psfs[causes] = self._psf(time, frame, wavelength, layer.distance)
            psf = psfs[causes]
            front = np.zeros(self._plane.shape)
            for part in layer.parts:
                strength = float(part.spectrum.at(wavelength)) * self._collected(layer)
                if strength:
                    front += strength * self._sharp(layer, part.picture, time)
            front = front * self._attenuation(layer)
            light = light * (1 - self._hidden(layer, psf, time)) + _convolved(front, psf)
        return light

    def _hidden(self, layer: Layer, psf: Array, time: float) -> Array | float:
        """The share of the light from behind that the layer stops, of what the PSF carries."""
        if layer.cover is None:
            return 0.0
        carried = _convolved(np.ones(self._plane.shape), psf).max()
        return np.clip(_convolved(self._sharp(layer, layer.cover, time), psf) / carried, 0, 1)

    def _sharp(self, layer: Layer, picture: Drawable, time: float) -> Array:
        """A picture on samples, as its spectrum has it; it is in its place as the exposure
        begins."""
        vy, vx = self._target.velocity
        time -= self._s.exposure_start
        scale = self._s.camera.magnification(layer.distance)
        spectrum = picture.spectrum(self._plane, scale, (vy * time, vx * time))
        light = np.fft.irfft2(spectrum.numpy().astype(np.complex128), self._plane.shape)
        return np.fft.fftshift(light)

    def _collected(self, layer: Layer) -> float:
        camera = self._s.camera
        spread = 1 + camera.separation / layer.distance
        seen = open_area(self._camera) * spread**2 / camera.lens.image_distance**2
        return seen * camera.panel.reflectivity * camera.transmission * camera.sensor.pitch**2

    def _attenuation(self, layer: Layer) -> Array:
        y, x = (one.numpy() for one in self._plane.mesh())
        del layer
        angle = np.arctan(np.hypot(y, x) / self._s.camera.lens.image_distance)
        return np.cos(angle) ** 4

    def _on_pixels(self, light: Array) -> Array:
        """The mean over every pixel, of what the samples' Fourier series goes through."""
        finer, (rows, columns) = self._finest.finer, self._s.camera.sensor.shape
        fy = np.fft.fftfreq(light.shape[0], 1 / finer)[:, None]
        fx = np.fft.fftfreq(light.shape[1], 1 / finer)[None, :]
        light = np.fft.ifft2(np.fft.fft2(light) * np.sinc(fy) * np.sinc(fx)).real
        first = [
            n // 2 - (m // 2) * finer for n, m in zip(light.shape, (rows, columns), strict=True)
        ]
        return light[first[0] :: finer, first[1] :: finer][:rows, :columns]

    # Wavelengths.

    def _wavelengths(self) -> Weighted:
        """Nodes in the band and in the leak, and how much of their light passes."""
        band = self._s.band
        for wavelength, width in self._between(*band.support, self._finest.band):
            yield wavelength, width * float(band.transmission(wavelength))
        if band.leak:
            for wavelength, width in self._between(*band.leak_range, self._finest.leak):
                yield wavelength, width * band.leak

    def _between(self, low: float, high: float, count: int) -> Weighted:
        curves = [self._efficiency(k) for k in range(self._channels)]
        curves += [part.spectrum for layer in self._target.layers for part in layer.parts]
        table = self._s.band.table
        curves += [table] if table else []
        kinks = {low, high}
        for curve in curves:
            kinks.update(x for x in curve.wavelengths if low < x < high)
        ends = sorted(kinks)
        each = max(4, math.ceil(count / (len(ends) - 1)))
        for a, b in itertools.pairwise(ends):
            yield from _gauss(a, b, each)

    # Points.

    def _psf(self, time: float, frame: int, wavelength: float, distance: float) -> Array:
        camera, tol = self._camera, self._finest.tol
        side = 2 * self._half + 1
        upright = camera.sensor.window_plane((side, side)).with_finer_pitch(self._finest.finer)
        plane = upright if self._s.mount.is_aligned else self._s.mount.plane_in_panel_axes(upright)
        operator = PSFOperator(
            camera, distance, wavelength, plane, integrate=False, unmodulated=0.0, tol=tol
        )
        panel = _panel_at(camera.panel, wavelength)
        modulator = Modulator(panel, wavelength)
        phase = self._phase(modulator, frame, time)
        light = np.zeros(plane.shape)
        front, unturned = front_reflection_share(panel), transmitted_unmodulated_share(panel)
        scattered = scattered_share(panel.jitter)
        swing = panel.flicker
        turns = 32 if swing else 1
        for k in range(turns):
            factor = 1 + swing * math.cos(math.pi * (2 * k + 1) / (2 * turns))
            field = modulator.modulation(factor * phase)
            part = (1 - scattered) * operator(None, field).double().numpy()
            if scattered:
                part = part + scattered * _one_pixel(camera, wavelength, plane, field)
            light += (1 - front - unturned) / turns * part
            light += self._beats(operator, modulator, field, scattered) / turns
        for share, straight in modulator.unmodulated_fields:
            light += share * operator(None, _like(straight, panel.shape)).double().numpy()
        light = light * self._in_orders(plane, wavelength)
        if self._s.mount.is_aligned:
            return light
        return self._s.mount.to_sensor_axes(torch.from_numpy(light), upright).numpy()

    def _beats(
        self, operator: PSFOperator, modulator: Modulator, field: torch.Tensor, scattered: float
    ) -> Array | float:
        """Of modulated light with what the panel doesn't turn, by four intensities."""
        if self._s.path is None or not abs(complex(self._s.path.interference)):
            return 0.0
        strength = complex(self._s.path.interference)
        strength *= (1 - front_reflection_share(modulator.panel)) * math.sqrt(1 - scattered)
        other = _like(modulator.unmodulated_fields[-1][1], modulator.panel.shape).to(field)
        # 4 Re(a conj(p) q) = |p + a' q|² - |p - a' q|², with a' of modulus 1.
        turn = strength / abs(strength)
        both = operator(None, field + turn * other) - operator(None, field - turn * other)
        return abs(strength) / 4 * both.double().numpy()

    def _in_orders(self, plane: Plane, wavelength: float) -> Array:
        """Light of the orders that count."""
        most = (self._finest.orders + 0.5) * wavelength * float(self._camera.ray_matrix_b)
        most /= self._camera.panel.pitch
        y, x = (one.abs().numpy() for one in plane.mesh())
        return ((y < most) & (x < most)).astype(np.float64)

    def _phase(self, modulator: Modulator, frame: int, time: float) -> torch.Tensor:
        """What stands on the panel, or is on its way, radians."""
        shown, tau = self._s.panel_content, modulator.panel.response_time
        settled = [
            torch.as_tensor(modulator.phase(torch.from_numpy(shown.pictures[name].copy())))
            for name in shown.names
        ]
        if not self._follows:
            return settled[frame]
        start = first_start_phase(torch.stack(settled), shown.frame_time, tau)
        for end in settled[:frame]:
            start = relaxed_phase(end, start, shown.frame_time, tau)
        since = time - math.floor(time / shown.frame_time) * shown.frame_time
        return relaxed_phase(settled[frame], start, since, tau)


def _one_pixel(camera: Camera, wavelength: float, plane: Plane, field: torch.Tensor) -> Array:
    """Light of every pixel by itself: a square's, summed over what is open of each."""
    side, scale = camera.panel.active_side, wavelength * float(camera.ray_matrix_b)
    y, x = (one.numpy() * side / scale for one in plane.mesh())
    opened = pupil_amplitude(camera).numpy()
    power = float((np.abs(field.numpy()) ** 2 * opened**2).sum() / opened.sum())
    area = plane.pitch[0] * plane.pitch[1]
    return power * (np.sinc(y) * np.sinc(x)) ** 2 * area * side**2 / scale**2


def _panel_at(panel: Panel, wavelength: float) -> Panel:
    """Beyond its table the panel's path stays as it is at the end."""
    known = [w for w, _ in panel.max_phase]
    low, high = 0.9 * min(known), 1.15 * max(known)
    if low <= wavelength <= high:
        return panel
    end = low if wavelength < low else high
    response = panel.response
    if response is not None:
        response = PhaseResponse((wavelength,), response.at(end)[None])
    table = ((wavelength, max_phase(panel, end) * end / wavelength),)
    return replace(panel, max_phase=table, response=response)


def _like(field: torch.Tensor | None, shape: tuple[int, int]) -> torch.Tensor:
    one = torch.ones(shape, dtype=torch.complex128)
    return one if field is None else field.to(torch.complex128)


def _gauss(low: float, high: float, count: int) -> Weighted:
    node, weight = gauss_legendre(count)
    half = (high - low) / 2
    for x, w in zip(node.tolist(), weight.tolist(), strict=True):
        yield (low + high) / 2 + half * x, half * w


def _convolved(light: Array, psf: Array) -> Array:
    """On the light's samples, wrapping around; the PSF's origin is its middle sample."""
    rows, columns = light.shape
    kernel = np.zeros_like(light)
    y, x = (n // 2 for n in psf.shape)
    for j in range(psf.shape[0]):
        index = (np.arange(psf.shape[1]) - x) % columns
        np.add.at(kernel, ((j - y) % rows, index), psf[j])
    return np.fft.ifft2(np.fft.fft2(light) * np.fft.fft2(kernel)).real
