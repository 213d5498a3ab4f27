"""What moves light within the image: distortion, and a scale that goes with the colour."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from simulator.effects.electron_bounds import (
    area_change,
    finest_octave_norm,
    light_norm_bound,
    max_light_seconds,
    off_plane_star_electrons,
)
from simulator.effects.light_effects import LightChange
from simulator.effects.psf_bounds import mtf_bound
from simulator.effects.rendering_work import (
    LATERAL_COLOUR,
    channel_count_at,
    picture_samples_at,
    wavelength_count_at,
)
from simulator.effects.spectra import Which, mean_change_bound
from simulator.formation.distorting import DISTORTION_OPERATIONS, distorted_frame, lateral_scales
from simulator.formation.windows import transform_operations
from simulator.situation import Situation

Array = NDArray[np.float64]


class MovedLight(LightChange):
    """A displacement of the image, by which the picture is looked up elsewhere."""

    typical_share = 0.3
    how = "proved: the gradient of coarse detail along the way, and all fine detail; area"

    @abstractmethod
    def lookups(self, levels: Mapping[str, int]) -> int:
        """Return how often a plan with these levels looks up the picture of each channel."""

    def added_operations(self, s: Situation, levels: Mapping[str, int]) -> float:
        lookups = self.lookups(levels) if levels[self.name] else 0
        if not lookups:
            return 0.0
        shape = picture_samples_at(s, levels)
        one = 6 * transform_operations(*shape) + DISTORTION_OPERATIONS * math.prod(shape)
        return one * lookups * channel_count_at(s, levels) * max(1, len(s.panel_content.pictures))


def moved_light_bound(
    s: Situation, phase: Callable[[Array, float], Array], brighter: float
) -> float:
    """Bound the L2 norm of the electrons that move to other places of the sensor.

    A picture m and its moved one differ by the change of brightness, and by m at places that are
    apart. Of detail coarser than any limit the latter is at most the way times its gradient, and of
    finer detail at most both norms. With the best limit, both together are at most √2 times the
    norm of the lesser of the two at each frequency.

    phase: returns the way times numbers in radians per metre, each at most the given one.
    brighter: largest relative change of brightness.
    """
    gain, whole = math.sqrt(area_change(s)), light_norm_bound(s)

    def lesser(k: Array) -> Array:
        along = phase(2 * np.pi * k * gain, 1 + gain)
        return np.asarray(math.sqrt(2) * along * mtf_bound(s, k))

    power, pitch = s.picture_probe.power_spectrum, s.camera.sensor.pitch
    folded = float(phase(np.array([2 * np.pi / pitch]), 2.0)[0]) * finest_octave_norm(s)
    resolved = math.hypot(power.filtered_norm_bound(lesser), folded) * max_light_seconds(s)
    if s.camera.lens.relative_illumination:
        brighter = 0.0
    return min(resolved + 2 * off_plane_star_electrons(s), (1 + gain) * whole) + brighter * whole


class Distortion(MovedLight):
    name = "distortion"
    recipe_field = "distortion"
    physics = "the lens' magnification changes with the image height: straight lines bend"
    source = "Brown 1971, Close-range camera calibration"

    def is_caused(self, s: Situation) -> bool:
        return any(s.camera.lens.distortion)

    def lookups(self, levels: Mapping[str, int]) -> int:
        # What scales each wavelength distorts it as well.
        return 0 if levels.get(LATERAL_COLOUR, 0) else 1

    def explain(self, s: Situation) -> str:
        frame = distorted_frame(s.camera)
        return (
            f"light moves by {frame.reach / s.camera.sensor.pitch:.3g} pixels at most, and areas "
            f"change by {max(frame.largest, 1 / frame.least) - 1:.2g}"
        )

    def change(self, s: Situation) -> float:
        frame = distorted_frame(s.camera)
        gain = max(frame.largest, 1 / frame.least)
        return moved_light_bound(s, lambda k, most: np.minimum(k * frame.reach, most), gain - 1)


class LateralColour(MovedLight):
    name = LATERAL_COLOUR
    recipe_field = "lateral_colour"
    physics = "the lens' glass images each wavelength at another scale: edges get coloured fringes"
    source = "Kingslake, Lens Design Fundamentals, chapter 11"

    def is_caused(self, s: Situation) -> bool:
        return bool(s.camera.lens.lateral_colour)

    def lookups(self, levels: Mapping[str, int]) -> int:
        return wavelength_count_at(levels)

    def explain(self, s: Situation) -> str:
        low, high = lateral_scales(s)
        pixels = (high - low) * _corner(s) / s.camera.sensor.pitch
        return f"in the corners, colours lie up to {pixels:.2g} pixels apart"

    def change(self, s: Situation) -> float:
        lens, corner = s.camera.lens, _corner(s)

        def phase(rate: Array, most: float) -> Array:
            def at(wavelength: float, which: Which) -> Array:
                moved = corner * abs(1 - 1 / lens.image_scale(wavelength))
                return np.minimum(rate * moved, most)

            return mean_change_bound(s, rate.shape, at)

        areas = mean_change_bound(
            s, (), lambda one, which: np.array(abs(lens.image_scale(one) ** -2 - 1))
        )
        return moved_light_bound(s, phase, float(areas))


def _corner(s: Situation) -> float:
    """Return the largest height of an image in the frame, in metres, before distortion."""
    sensor = s.camera.sensor
    return math.hypot(*sensor.shape) * sensor.pitch / 2 + distorted_frame(s.camera).reach
