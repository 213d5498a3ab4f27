"""What is known of a target's picture without any blur."""

from __future__ import annotations

import math
from collections.abc import Hashable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import torch

from optics.camera import Camera
from optics.formation import spectrum_of_samples
from optics.light.bands import Band
from optics.light.spectrum import Spectrum
from optics.plane import Plane
from simulator.probing.radial import Gain, RadialProfile
from simulator.probing.rates import electron_rates
from simulator.probing.sampled_frequencies import SampledFrequencies
from simulator.scene.disc import Disc
from simulator.scene.merging import merge_pictures
from simulator.scene.target import Layer, Target

MARGIN = 128
"""Sensor pixels around the frame that are looked at: their light may be blurred into it."""

_COVERED = 1e-3
"""Share of a pixel from which on what it covers it with is told by its light."""


@dataclass(frozen=True, eq=False)
class PictureProbe:
    """The geometric picture of a target, on a camera's pixels, in electrons per second.

    Nothing is blurred or lost on the way but what the aperture takes near the axis; the filter's
    leak is in it; of a colour sensor, each part counts with the channel that sees it best. The
    lamp is as it is on average. shift: (y, x) metres on the object by which it has moved.

    What is said "however blurred" holds for any PSFs whose light sums up to one or less, of
    layers of which each hides what is behind it.
    """

    target: Target
    camera: Camera
    band: Band
    shift: tuple[float, float] = (0.0, 0.0)
    results: dict[Hashable, Any] = field(default_factory=dict, repr=False)
    """What somebody has found out by it, by its other causes."""

    @property
    def distances(self) -> tuple[float, ...]:
        """Metres from the panel, of each layer, the nearest first."""
        return tuple(layer.distance for layer in self.target.layers)

    @cached_property
    def plane(self) -> Plane:
        """Samples of the size of pixels, with the margin around the frame."""
        sensor = self.camera.sensor
        rows, columns = sensor.shape
        return Plane((rows + 2 * MARGIN, columns + 2 * MARGIN), sensor.plane.pitch)

    @cached_property
    def rates(self) -> tuple[tuple[float, ...], ...]:
        """Electrons per second on a pixel that a picture of 1 fills, of each layer's parts."""
        area = self.camera.sensor.pitch**2
        return tuple(
            tuple(
                area * max(electron_rates(part.spectrum, self.band, self.camera, layer.distance))
                for part in layer.parts
            )
            for layer in self.target.layers
        )

    @cached_property
    def lights(self) -> tuple[torch.Tensor, ...]:
        """Each layer's light, hidden or not, (rows, columns) of the plane."""
        pairs = zip(self.target.layers, self.rates, strict=True)
        return tuple(self._layer_light(layer, rates) for layer, rates in pairs)

    @cached_property
    def covers(self) -> tuple[torch.Tensor | None, ...]:
        """Share of each pixel that a layer hides from what is behind it; None hides nothing.

        The farthest has nothing behind it.
        """
        near = self.target.layers[:-1]
        return (*(self._covering(layer) for layer in near), None)

    @cached_property
    def sharp_picture(self) -> torch.Tensor:
        """All layers, sharp, the near before the far: (rows, columns) of the plane."""

        seen = self.lights[-1]
        for light, cover in zip(self.lights[-2::-1], self.covers[-2::-1], strict=True):
            seen = seen + light if cover is None else seen * (1 - cover) + light
        return seen

    @cached_property
    def extent(self) -> tuple[float, float]:
        """How far from the axis anything shines, (y, x) metres on the sensor."""
        sides = [(0.0, 0.0)]
        for layer, rates in zip(self.target.layers, self.rates, strict=True):
            scale = self._scale(layer)
            pictures = [p.picture for p, rate in zip(layer.parts, rates, strict=True) if rate]
            sides += [one.extent(scale, self.shift) for one in pictures]
        return max(y for y, _ in sides), max(x for _, x in sides)

    @cached_property
    def dim_decile(self) -> float:
        """Electrons per second below which a tenth of the frame's pixels have."""
        inside = self.sharp_picture[MARGIN:-MARGIN, MARGIN:-MARGIN]
        # Of many pixels, some tell.
        every = max(1, math.isqrt(inside.numel() // 65536))
        return max(float(torch.quantile(inside[::every, ::every].flatten(), 0.1)), 0.0)

    def excess_over(self, level: float) -> tuple[float, float]:
        """What the sharp picture has above a level of electrons per second: the sum over frame and
        margin, and that of the squares."""
        rest = (self.sharp_picture - level).clamp(min=0)
        return float(rest.sum(dtype=torch.float64)), float(rest.double().square().sum())

    @cached_property
    def total_with_margin(self) -> float:
        """Electrons per second on the frame and its margin."""
        return float(self.sharp_picture.double().sum())

    @cached_property
    def total(self) -> float:
        """Electrons per second on the frame."""
        rows, columns = self.camera.sensor.shape
        inside = self.sharp_picture[MARGIN : MARGIN + rows, MARGIN : MARGIN + columns]
        return float(inside.double().sum())

    @cached_property
    def brightest(self) -> float:
        """Electrons per second of a pixel, at most, however blurred."""
        return self.brightest_behind(0) + self.off_plane_star_rate

    def brightest_behind(self, first: int) -> float:
        """The same of the layers from a number on: 0 is the nearest.

        Of layers that hide, a pixel sees shares that add up to one at most (their covers blurred
        as they are), and of each no more than the brightest of its surface.
        """
        hiding, adding = [0.0], 0.0
        for number in range(first, len(self.lights)):
            light, cover = self.lights[number], self.covers[number]
            if cover is not None:
                seen = cover > _COVERED
                surface = light[seen] / cover[seen]
                hiding.append(float(surface.max()) if surface.numel() else 0.0)
            elif number == len(self.lights) - 1:
                hiding.append(float(light.max()))
            else:
                adding += max(float(light.max()), 0.0)
        return max(hiding) + adding

    @cached_property
    def norm_bound(self) -> float:
        """Root of the sum of squares over the frame, electrons per second, at most, however
        blurred: no blur adds light (Young)."""
        if len(self.lights) == 1:
            apart = self.power_spectrum.norm
        else:
            apart = sum(float(light.double().norm()) for light in self.lights)
        return min(apart + self.off_plane_star_rate, self._uniform_norm)

    @property
    def _uniform_norm(self) -> float:
        """The same of a frame that is everywhere as bright as it may be."""
        return self.brightest * math.sqrt(math.prod(self.camera.sensor.shape))

    @cached_property
    def power_spectrum(self) -> RadialProfile:
        """By cycles per metre on the sensor, (electrons per second)² a pixel."""
        return self._profile(self.sharp_picture)

    @cached_property
    def layer_power_spectra(self) -> tuple[RadialProfile, ...]:
        """Of each layer's light, hidden or not."""
        if len(self.lights) == 1:
            return (self.power_spectrum,)
        return tuple(self._profile(light) for light in self.lights)

    @cached_property
    def powers_by_spectrum(self) -> list[tuple[list[int], torch.Tensor]]:
        """For each different spectrum, the numbers of the parts that have it, through all layers,
        and |spectrum|² by frequency of what shines with it, hidden or not, (electrons per
        second)², on the rfft2 grid of the plane."""
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
        """By which all of its light is told apart."""
        squared = torch.stack([squared for _, squared in self.powers_by_spectrum]).sum(0)
        return SampledFrequencies.of(squared, self.plane)

    @cached_property
    def cover_powers(self) -> tuple[RadialProfile | None, ...]:
        """Of what each layer hides; no unit."""
        return tuple(None if one is None else self._profile(one) for one in self.covers)

    def change_bound(self, gains: Sequence[Gain]) -> float:
        """The most that the picture changes, L2 in electrons per second, where each layer's
        light, and what it hides, changes by a gain in every frequency, one for each layer.

        From C = F + (1 - a) C', a layer's light F and cover a before all that is behind:
        |ΔC| is no more than |ΔF|, and |Δa| times the brightest C', and |ΔC'|.
        """
        total = 2 * self.off_plane_star_rate
        for number, gain in enumerate(gains):
            total += self.layer_power_spectra[number].filtered_norm_bound(gain)
            hidden = self.cover_powers[number]
            if hidden is not None:
                total += hidden.filtered_norm_bound(gain) * self.brightest_behind(number + 1)
        # Neither of two pictures is brighter than the brightest.
        return min(total, self._uniform_norm)

    @cached_property
    def edge_length(self) -> float:
        """Metres on the sensor of edges at which something near hides something far.

        Counted along rows and columns, and so never too short, and by √2 too long at most.
        """
        covers = [one for one in self.covers if one is not None]
        steps = sum(
            float(torch.diff(cover, dim=axis).abs().double().sum())
            for cover in covers
            for axis in (0, 1)
        )
        return steps * self.camera.sensor.pitch

    @cached_property
    def off_plane_star_rate(self) -> float:
        """Electrons per second of stars that aren't on the plane, and whose blur may be: all that
        they send counts, for one pixel may get it."""
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
        """Whether no light comes from the target at all."""
        return not any(rate for rates in self.rates for rate in rates)

    def _profile(self, picture: torch.Tensor) -> RadialProfile:
        return RadialProfile.of(spectrum_of_samples(picture), self.plane)

    def _scale(self, layer: Layer) -> float:
        return self.camera.magnification(layer.distance)

    def _covering(self, layer: Layer) -> torch.Tensor | None:
        if layer.cover is None:
            return None
        return layer.cover.light(self.plane, self._scale(layer), self.shift)

    def _layer_light(self, layer: Layer, rates: tuple[float, ...]) -> torch.Tensor:
        light = torch.zeros(self.plane.shape)
        pictures = ((part.picture, rate) for part, rate in zip(layer.parts, rates, strict=True))
        for picture, weight in merge_pictures(pictures):
            drawn = picture.light(self.plane, self._scale(layer), self.shift)
            light.add_(drawn, alpha=weight)
        return light
