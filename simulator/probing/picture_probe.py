"""The sharp picture of a target, probed for bounds that hold after any blur."""

from __future__ import annotations

import math
from collections.abc import Hashable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from scipy import constants

from optics.camera import Camera, Sensor
from optics.camera.pupil import open_area
from optics.formation import spectrum_of_samples
from optics.light.bands import Band
from optics.light.spectrum import Spectrum
from optics.plane import Plane
from simulator.filter_angles import some_angles
from simulator.probing.sampled_frequencies import Gain, RadialProfile, SampledFrequencies
from simulator.scene.disc import Disc
from simulator.scene.polygons import merge_pictures
from simulator.scene.target import Layer, Target


def _efficiencies(sensor: Sensor) -> tuple[Spectrum | None, ...]:
    """Return the electrons per photon of each channel; None for the same at all wavelengths."""
    if sensor.colour is not None:
        return tuple(sensor.colour.efficiencies[name] for name in sensor.colour.channels)
    return (sensor.spectral_efficiency,)


def electron_rates(
    spectrum: Spectrum, band: Band, camera: Camera, distance: float, *, leak: bool = True
) -> tuple[float, ...]:
    """Return the electrons per second and square metre of sensor that a spectrum frees, by channel.

    The rate is that near the axis, by the camera equation of
    optics.camera.system_mtf.electron_rate(), integrated over wavelengths.
    spectrum: radiance, W / (sr m² m).
    distance: metres to the panel.
    leak: whether light that the filter passes outside its band is included.
    """
    nodes = _nodes(spectrum, band, camera.sensor, leak)
    passed = band.total_transmission(nodes) if leak else band.transmission(nodes)
    photons = spectrum.at(nodes) * passed * nodes / (constants.h * constants.c)
    even, gathered = camera.sensor.quantum_efficiency, irradiance_per_radiance(camera, distance)
    curves = (
        np.full_like(nodes, even) if one is None else one.at(nodes)
        for one in _efficiencies(camera.sensor)
    )
    return tuple(float(np.trapezoid(photons * one, nodes)) * gathered for one in curves)


def irradiance_per_radiance(camera: Camera, distance: float) -> float:
    """Return the sensor's irradiance near the axis over a scene's radiance, sr."""
    spread = 1 + camera.separation / distance
    gathered = open_area(camera) * spread**2 / camera.lens.image_distance**2
    return gathered * camera.panel.reflectivity * camera.transmission


def _nodes(spectrum: Spectrum, band: Band, sensor: Sensor, leak: bool) -> NDArray[np.float64]:
    """Return the wavelengths at which a spectrum behind a filter is integrated.

    These are the nodes of all curves, both sides of every jump, and a fine grid over the band and
    its leak.
    """
    ranges = [band.support, *([band.leak_range] if leak and band.leak else [])]
    curves = [one for one in (spectrum, band.table, *_efficiencies(sensor)) if one is not None]
    jumps = np.array([*(end for one in ranges for end in one), *(
        end for one in curves for end in (one.low, one.high)
    )])  # fmt: skip
    # With 1001 wavelengths, the integral over a smooth band is within 1e-6.
    fine = [np.linspace(*one, 1001) for one in ranges]
    bends = [np.asarray(one.wavelengths) for one in curves]
    beside = [jumps * (1 - 1e-12), jumps * (1 + 1e-12)]
    return np.unique(np.concatenate([*fine, *bends, *beside]))


MARGIN = 128
"""Width in sensor pixels of the margin around the frame, whose light may be blurred into it."""

PROBED_ANGLES = 5
"""Angles at the filter, evenly spaced in sin², for which the light is probed. Chosen."""


@dataclass(frozen=True, eq=False)
class PictureProbe:
    """The geometric picture of a target on a camera's pixels, in electrons per second.

    Nothing is blurred, and the losses are those of the aperture near the axis. The filter's leak is
    included. For a colour sensor, each part of the target counts with its most sensitive channel.
    The lamp has its mean power.

    Bounds that hold "after any blur" hold for all PSFs with a sum of one or less, and for layers
    each of which hides what is behind it.

    shift: (y, x) displacement of the target, metres on the object.
    """

    target: Target
    camera: Camera
    band: Band
    shift: tuple[float, float] = (0.0, 0.0)
    results: dict[Hashable, Any] = field(default_factory=dict, repr=False)
    """Results that effects have computed from this probe, by what else they depend on."""

    @property
    def distances(self) -> tuple[float, ...]:
        """Return the distance in metres of each layer from the panel, nearest first."""
        return tuple(layer.distance for layer in self.target.layers)

    @cached_property
    def plane(self) -> Plane:
        """Return the picture's sample plane: the sensor's pixels with a margin around."""
        sensor = self.camera.sensor
        rows, columns = sensor.shape
        return Plane((rows + 2 * MARGIN, columns + 2 * MARGIN), sensor.plane.pitch)

    @cached_property
    def rates(self) -> tuple[tuple[float, ...], ...]:
        """Return a pixel's electrons/s at picture value 1 and the best angle, by layer and part."""
        area, camera = self.camera.sensor.pitch**2, self.camera
        bands = [self.band.at_angle(one) for one in some_angles(camera, self.band, PROBED_ANGLES)]

        def best(spectrum: Spectrum, distance: float) -> float:
            every = (electron_rates(spectrum, band, camera, distance) for band in bands)
            return max(rate for rates in every for rate in rates)

        return tuple(
            tuple(area * best(part.spectrum, layer.distance) for part in layer.parts)
            for layer in self.target.layers
        )

    @cached_property
    def lights(self) -> tuple[torch.Tensor, ...]:
        """Return the light of each layer on the plane, electrons/s, hidden parts included."""
        return tuple(self._lights_on(self.plane))

    @cached_property
    def covers(self) -> tuple[torch.Tensor | None, ...]:
        """Return the share of each pixel that a layer covers; None for one that hides nothing."""
        covers = [
            None
            if layer.cover is None
            else layer.cover.light(self.plane, self._scale(layer), self.shift)
            for layer in self.target.layers[:-1]
        ]
        return *covers, None

    @cached_property
    def sharp_picture(self) -> torch.Tensor:
        """Return the picture of all layers on the plane, near ones in front, electrons/s."""
        seen = self.lights[-1]
        for light, cover in zip(self.lights[-2::-1], self.covers[-2::-1], strict=True):
            seen = seen + light if cover is None else seen * (1 - cover) + light
        return seen

    @cached_property
    def extent(self) -> tuple[float, float]:
        """Return how far the target's light reaches from the axis, (y, x) in metres."""
        sides = [(0.0, 0.0)]
        for layer, rates in zip(self.target.layers, self.rates, strict=True):
            scale = self._scale(layer)
            pictures = [p.picture for p, rate in zip(layer.parts, rates, strict=True) if rate]
            sides += [one.extent(scale, self.shift) for one in pictures]
        return max(y for y, _ in sides), max(x for _, x in sides)

    @cached_property
    def dim_decile(self) -> float:
        """Return the first decile of the frame's pixels, electrons per second."""
        inside = self.sharp_picture[MARGIN:-MARGIN, MARGIN:-MARGIN]
        # A subset of about 65,536 pixels is enough.
        every = max(1, math.isqrt(inside.numel() // 65536))
        return max(float(torch.quantile(inside[::every, ::every].flatten(), 0.1)), 0.0)

    def excess_over(self, level: float) -> tuple[float, float]:
        """Sum the picture's excess over a level in electrons/s, and its square, margin included."""
        rest = (self.sharp_picture - level).clamp(min=0)
        return float(rest.sum(dtype=torch.float64)), float(rest.double().square().sum())

    @cached_property
    def total_with_margin(self) -> float:
        """Return the electrons per second on the whole frame and its margin."""
        return float(self.sharp_picture.double().sum())

    @cached_property
    def total(self) -> float:
        """Return the electrons per second on the whole frame.

        It is 0 for a frame without light, where rounding leaves a little of either sign.
        """
        rows, columns = self.camera.sensor.shape
        inside = self.sharp_picture[MARGIN : MARGIN + rows, MARGIN : MARGIN + columns]
        return max(float(inside.double().sum()), 0.0)

    @cached_property
    def brightest(self) -> float:
        """Bound the electrons per second of any pixel, after any blur."""
        return self.brightest_behind(0) + self.off_plane_star_rate

    def brightest_behind(self, first: int) -> float:
        """Bound any pixel's electrons per second from the layers `first` and behind.

        0 is the nearest layer. The shares of a pixel that it gets from covering layers add up to
        one at most, because the covers are blurred like the light. Each share is at most as bright
        as the brightest point of that layer's surface.
        """
        hiding, adding = [0.0], 0.0
        for number in range(first, len(self.lights)):
            light, cover = self.lights[number], self.covers[number]
            if cover is not None:
                # Where less than a thousandth of a pixel is covered, the surface's brightness
                # can't be told from the pixel's light.
                seen = cover > 1e-3
                surface = light[seen] / cover[seen]
                hiding.append(float(surface.max()) if surface.numel() else 0.0)
            elif number == len(self.lights) - 1:
                hiding.append(float(light.max()))
            else:
                adding += max(float(light.max()), 0.0)
        return max(hiding) + adding

    @cached_property
    def norm_bound(self) -> float:
        """Bound the picture's L2 norm over the frame after any blur (Young), electrons/s."""
        if len(self.lights) == 1:
            apart = self.power_spectrum.norm
        else:
            apart = sum(float(light.double().norm()) for light in self.lights)
        return min(apart + self.off_plane_star_rate, self._uniform_norm)

    @property
    def _uniform_norm(self) -> float:
        """Return the frame's L2 norm if all pixels had the largest rate."""
        return self.brightest * math.sqrt(math.prod(self.camera.sensor.shape))

    @cached_property
    def power_spectrum(self) -> RadialProfile:
        """Return the sharp picture's power spectrum, (electrons per second)² per pixel."""
        return self._profile(self.sharp_picture)

    @cached_property
    def layer_power_spectra(self) -> tuple[RadialProfile, ...]:
        """Return the power spectrum of each layer's light, hidden parts included."""
        if len(self.lights) == 1:
            return (self.power_spectrum,)
        return tuple(self._profile(light) for light in self.lights)

    @cached_property
    def powers_by_spectrum(self) -> list[tuple[list[int], torch.Tensor]]:
        """Return the target's power spectrum, separately for each spectrum of light.

        Each entry has the numbers of the parts with that spectrum, counted through all layers, and
        the squared modulus of their picture's Fourier transform, hidden parts included, in
        (electrons per second)² on the rfft2 grid of the plane.
        """
        numbers: dict[Spectrum, list[int]] = {}
        lights: dict[Spectrum, torch.Tensor] = {}
        parts = [(layer, part) for layer in self.target.layers for part in layer.parts]
        rates = [rate for of_layer in self.rates for rate in of_layer]
        for number, ((layer, part), rate) in enumerate(zip(parts, rates, strict=True)):
            numbers.setdefault(part.spectrum, []).append(number)
            if rate:
                light = rate * part.picture.light(self.plane, self._scale(layer), self.shift)
                known = lights.get(part.spectrum)
                lights[part.spectrum] = light if known is None else known + light
        return [
            (numbers[spectrum], spectrum_of_samples(light).abs().square())
            for spectrum, light in lights.items()
        ]

    @cached_property
    def sampled_frequencies(self) -> SampledFrequencies:
        """Return the sampled frequencies that represent all light of the target."""
        squared = torch.stack([squared for _, squared in self.powers_by_spectrum]).sum(0)
        return SampledFrequencies.of(squared, self.plane)

    @cached_property
    def cover_powers(self) -> tuple[RadialProfile | None, ...]:
        """Return the power spectrum of each layer's cover, without unit."""
        return tuple(None if one is None else self._profile(one) for one in self.covers)

    def change_bound(self, gains: Sequence[Gain]) -> float:
        """Bound the picture's change if each layer is filtered, as L2 norm in electrons/s.

        A layer with the light F and the cover a, in front of the light C' behind it, gives C = F +
        (1 - a) C'. So |ΔC| is at most |ΔF| + |Δa| max C' + |ΔC'|.
        gains: for each layer, the relative change of its light and cover by frequency.
        """
        total = 2 * self.off_plane_star_rate
        for number, gain in enumerate(gains):
            total += self.layer_power_spectra[number].filtered_norm_bound(gain)
            hidden = self.cover_powers[number]
            if hidden is not None:
                total += hidden.filtered_norm_bound(gain) * self.brightest_behind(number + 1)
        # Neither picture has a pixel above the bound `brightest`, and so nor has their difference.
        return min(total, self._uniform_norm)

    @cached_property
    def edge_length(self) -> float:
        """Return the length of covers' edges along rows and columns, metres on the sensor."""
        edges = (
            torch.diff(cover, dim=axis)
            for cover in self.covers
            if cover is not None
            for axis in (0, 1)
        )
        return sum(float(one.abs().double().sum()) for one in edges) * self.camera.sensor.pitch

    @cached_property
    def off_plane_star_rate(self) -> float:
        """Return the electrons per second of artificial stars outside the plane.

        Their blurred light may fall on the plane. All of it counts, because one pixel may get it.
        """
        total = 0.0
        for layer, light, rates in zip(self.target.layers, self.lights, self.rates, strict=True):
            if not light.any():
                scale = self._scale(layer) / self.camera.sensor.pitch
                for part, rate in zip(layer.parts, rates, strict=True):
                    if isinstance(part.picture, Disc):
                        total += rate * math.pi * (part.picture.diameter * scale) ** 2 / 4
        return total

    @property
    def is_dark(self) -> bool:
        """Whether no light at all comes from the target."""
        return not any(rate for rates in self.rates for rate in rates)

    def _profile(self, picture: torch.Tensor) -> RadialProfile:
        return RadialProfile.of(spectrum_of_samples(picture), self.plane)

    def _scale(self, layer: Layer) -> float:
        return self.camera.magnification(layer.distance)

    def light_on(self, plane: Plane) -> NDArray[np.float64]:
        """Return the light of all layers on another plane, hidden parts included, electrons/s."""
        light = torch.stack(list(self._lights_on(plane)))
        return np.asarray(light.sum(0, dtype=torch.float64))

    def _lights_on(self, plane: Plane) -> Iterator[torch.Tensor]:
        """Yield the light of each layer, hidden parts included."""
        for layer, rates in zip(self.target.layers, self.rates, strict=True):
            light = torch.zeros(plane.shape)
            pictures = ((part.picture, rate) for part, rate in zip(layer.parts, rates, strict=True))
            for picture, weight in merge_pictures(pictures):
                drawn = picture.light(plane, self._scale(layer), self.shift)
                light.add_(drawn, alpha=weight)
            yield light
