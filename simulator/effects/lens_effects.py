"""What the lens moves: the focus, with time and colour, and light within the image."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from optics.validation import as_number
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
from simulator.effects.result_cache import cached_across_exposures
from simulator.effects.spectra import Which, mean_change_bound
from simulator.focus import focus_range
from simulator.formation.distorting import DISTORTION_OPERATIONS, distorted_frame, lateral_scales
from simulator.formation.windows import transform_operations
from simulator.situation import Situation

Array = NDArray[np.float64]

# Factor of the change that the far field tells, and of the frequencies near which it is looked
# for, from audits: the panel's effects may change a PSF, and its wavelength isn't the band's.
_MARGIN, _SPREAD = 1.3, 1.1


def far_field_change(s: Situation, number: int, k: Array, apart: float) -> Array:
    """Bound PatternProbe.focus_change() near frequencies k for all light.

    apart: ratio of wavelengths by which light may differ from the band's centre.
    """
    return _MARGIN * apart**2 * s.pattern_probe.focus_change(number, k, _SPREAD * apart)


def rim_displacement(s: Situation, shift: float) -> float:
    """Bound how far a shift of focus moves light from the pupil's rim on the sensor, metres.

    Light crosses the lens no farther from the axis than the stop's edge, or than light from the
    panel's corners does.
    shift: metres by which images lie behind the sensor.
    """
    lens, panel = s.camera.lens, s.camera.panel
    half = math.hypot(*(n * panel.pitch / 2 for n in panel.shape)) + math.hypot(*s.mount.shift)
    if s.camera.separation:
        half = math.inf
    radius = min(as_number(lens.stop_diameter) / 2, half)
    z = as_number(lens.image_distance)
    return radius * abs(shift) / (z + shift)


class FocusShift(LightChange):
    """A shift by which light is focused beside the sensor."""

    typical_share = 0.5
    how = f"audited ×{_MARGIN:g}: phases over the pupil, and transfer functions out of focus"

    @abstractmethod
    def change_rate(self, s: Situation) -> float:
        """Bound the change of the light, L2 norm in electrons per second."""

    def added_operations(self, s: Situation, levels: Mapping[str, int]) -> float:
        return 60.0 * math.prod(s.camera.panel.shape) if levels[self.name] else 0.0

    def change(self, s: Situation) -> float:
        return min(self.change_rate(s) * max_light_seconds(s), 2 * light_norm_bound(s))


class FocusDrift(FocusShift):
    name = "focus drift"
    likely_shares = (0.8,)
    recipe_field = "focus_drift"
    physics = "lens and mount expand as they warm up, and carry the image away from the sensor"
    source = "Newton's law of cooling; defocus as for depth layers, Hopkins 1955"

    def is_caused(self, s: Situation) -> bool:
        return s.focus_drift != 0

    def explain(self, s: Situation) -> str:
        blur = 2 * rim_displacement(s, s.focus_drift) / s.camera.sensor.pitch
        drift = f"{s.focus_drift * 1e6:.3g} µm behind the sensor"
        return f"the image has drifted {drift}, and is blurred over {blur:.2g} pixels"

    def change_rate(self, s: Situation) -> float:
        return _drift_change_rate(s, s.focus_drift)


@cached_across_exposures
def _drift_change_rate(s: Situation, drift: float) -> float:
    """Bound the change of the light by a drift in metres, L2 norm in electrons per second.

    The drift turns phases of two points of the pupil by 2π k ρ at most, where ρ is how far it moves
    light from the rim. Where colour doesn't shift the focus, too, transfer functions change as the
    far field tells it, at the ends of the band by as much more as the wavelength is less (audited).
    """
    moved, probe = rim_displacement(s, drift), s.pattern_probe
    low, high = s.band.support
    apart = max(s.wavelength / low, high / s.wavelength)
    # Light that leaks has wavelengths that aren't probed.
    known = not (s.camera.lens.axial_colour or s.band.leak) and drift in probe.foci

    def gain(k: Array) -> Array:
        found = np.minimum(2 * np.pi * k * moved, 2.0)
        if known:
            number = probe.foci.index(drift)
            change = far_field_change(s, number, k.ravel(), apart).reshape(k.shape)
            found = np.minimum(found, change)
        return np.asarray(found)

    return s.picture_probe.change_bound([gain] * len(s.picture_probe.distances))


class AxialColour(FocusShift):
    name = "axial colour"
    likely_shares = (0.4,)
    recipe_field = "axial_colour"
    physics = "the lens' glass focuses each wavelength at another distance"
    source = "Kingslake, Lens Design Fundamentals, chapter 4"

    def is_caused(self, s: Situation) -> bool:
        return bool(s.camera.lens.axial_colour)

    def explain(self, s: Situation) -> str:
        most = max(focus_range(s.camera.lens, *s.band.support), key=abs)
        blur = 2 * rim_displacement(s, most) / s.camera.sensor.pitch
        where = f"focused up to {most * 1e6:.3g} µm behind the sensor"
        return f"light of the band is {where}, and blurred over {blur:.2g} pixels"

    def change_rate(self, s: Situation) -> float:
        return _colour_change_rate(s)


@cached_across_exposures
def _colour_change_rate(s: Situation) -> float:
    """Bound the change of the light by axial colour, L2 norm in electrons per second.

    The transfer function is a sum over pairs of points of the pupil, whose phases a shift of focus
    turns against each other by 2π k ρ at most, where ρ is how far it moves light from the rim. It
    changes no more than in a focus beyond, as the far field tells it (audited).
    """

    def gain(k: Array) -> Array:
        flat = k.ravel()
        probed: dict[Which, list[tuple[float, Array]]] = {
            "band": _changes_beyond(s, flat, "band"),
            "leak": _changes_beyond(s, flat, "leak"),
        }

        def at(wavelength: float, which: Which) -> Array:
            shift = s.camera.lens.focus_shift(wavelength)
            found = np.minimum(2 * np.pi * rim_displacement(s, shift) * flat, 2.0)
            for focus, change in probed[which]:
                if shift * focus > 0 and abs(shift) <= abs(focus) * (1 + 1e-9):
                    found = np.minimum(found, change)
            return np.asarray(found)

        found = mean_change_bound(s, flat.shape, at)
        return np.asarray(np.minimum(found, 2.0).reshape(k.shape))

    return s.picture_probe.change_bound([gain] * len(s.picture_probe.distances))


def _changes_beyond(s: Situation, k: Array, which: Which) -> list[tuple[float, Array]]:
    """Return the foci that were probed for axial colour, and the transfer functions' changes there.

    Light of another wavelength than the band's centre has its transfer function at other
    frequencies, and its phase is larger by as much.
    """
    if s.focus_drift:
        return []  # The foci were probed against one that doesn't drift.
    probe, ends = s.pattern_probe, s.band.support if which == "band" else s.band.leak_range
    apart = max(s.wavelength / ends[0], ends[1] / s.wavelength, 1.0)
    foci = probe.foci if which == "band" else (*probe.foci, *probe.leaked_foci)
    return [(focus, far_field_change(s, number, k, apart)) for number, focus in enumerate(foci)]


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
        pixels, gain = frame.reach / s.camera.sensor.pitch, max(frame.largest, 1 / frame.least)
        return f"light moves by {pixels:.3g} pixels at most, and areas change by {gain - 1:.2g}"

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

        def denser(wavelength: float, which: Which) -> Array:
            return np.array(abs(lens.image_scale(wavelength) ** -2 - 1))

        return moved_light_bound(s, phase, float(mean_change_bound(s, (), denser)))


def _corner(s: Situation) -> float:
    """Return the largest height of an image in the frame, in metres, before distortion."""
    sensor = s.camera.sensor
    return math.hypot(*sensor.shape) * sensor.pitch / 2 + distorted_frame(s.camera).reach
