"""Doubt frames that show something else than what they were taken for.

A dark frame with light in it, a target that gives no light, or a star that is none, or out of
focus, spoils all that is computed from a record, and can't be seen from the settings.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from labapp.files.plan_file import PlanFile, Reconstruction
from labapp.runs.shots import Shot, ShotList

if TYPE_CHECKING:
    from optics.camera import Camera, Sensor


# What a frame must show lest a person is asked about it; all chosen.
_DARK_CLIPPED = 0.005  # share of a dark frame's pixels that hot ones may saturate; they are 1e-4
_DARK_EXCESS = 0.005  # of the full scale, by which a dark frame's middle pixel may be too bright
_WARM = 10.0  # factor by which the dark current may exceed its description; 7 K double it
_SIGMAS = 6.0  # of the noise, above which a pixel has light; noise alone has 1e-9 such pixels
_LIT_PIXELS = 9  # with light, that a target has at least; a star in focus has as many
_EXTENDED = 0.2  # brightness of the middle pixel over a bright one's; below 1e-2 for a star
_WIDEST_STAR = 8.0  # pixels, from which on a star is out of focus if diffraction is much finer
_BLUR = 5.0  # the same as a multiple of the diffraction's width
_CLIPPED_STAR = 1e-6  # share of saturated pixels; some hot ones in five megapixels


class FrameDoubts:
    """Judge frames by what they show; each kind of doubt is told until settled.

    The names of dark target, star and neutral pattern are the plan's, or else "dark", "star" and
    "neutral". That a target gives no light is judged at its longest exposure, since the shorter
    ones of a bracket may be dark on purpose.
    """

    def __init__(self, plan: PlanFile, camera: Camera, shots: Sequence[Shot]) -> None:
        self._roles = plan.reconstruct or Reconstruction(coded="")
        self._camera = camera
        self._longest: dict[str, float] = {}
        for shot in ShotList.of(shots).distinct("target", "exposure"):
            self._longest[shot.target] = max(shot.exposure, self._longest.get(shot.target, 0.0))
        self._settled: set[tuple[str, str]] = set()

    def doubt(self, shot: Shot, image: NDArray[np.uint16]) -> str:
        """Return what in a frame doesn't fit what it was taken for; "" if all does."""
        for kind, text in self._doubts(shot, image).items():
            if text and (kind, shot.target) not in self._settled:
                return f"{shot.target} at {shot.exposure * 1e3:g} ms: {text}"
        return ""

    def settle(self, shot: Shot) -> None:
        """Doubt the frames of this target no more: a person has said that they are right."""
        self._settled |= {(kind, shot.target) for kind in ("dark", "light", "star", "focus")}

    def _doubts(self, shot: Shot, image: NDArray[np.uint16]) -> dict[str, str]:
        camera = shot.readout.read_camera(self._camera)
        sensor = camera.sensor
        if shot.role == "dark" or shot.target == self._roles.dark:
            return {"dark": light_in_the_dark(sensor, shot.exposure, image)}
        if shot.role != "light":
            return {}
        found = {}
        if shot.exposure >= self._longest.get(shot.target, 0.0):
            found["light"] = lack_of_light(sensor, shot.exposure, image)
        if shot.target == self._roles.star and shot.pattern == self._roles.neutral:
            found["star"] = star_that_is_none(sensor, shot.exposure, image)
            found["focus"] = star_out_of_focus(camera, shot.wavelength, shot.exposure, image)
        return found


def target_doubt(
    camera: Camera,
    target: str,
    pattern: str,
    wavelength: float,
    exposure: float,
    image: NDArray[np.uint16],
) -> str:
    """Return how a single frame in DN doesn't fit the target that a person placed; "" if it fits.

    Targets and patterns are known by their usual names: "dark", "star" and "neutral". wavelength:
    metres. exposure: seconds.
    """
    usual, sensor = Reconstruction(coded=""), camera.sensor
    if target == usual.dark:
        return light_in_the_dark(sensor, exposure, image)
    found = lack_of_light(sensor, exposure, image)
    if not found and target == usual.star and pattern == usual.neutral:
        found = star_that_is_none(sensor, exposure, image)
        found = found or star_out_of_focus(camera, wavelength, exposure, image)
    return found


def light_in_the_dark(sensor: Sensor, exposure: float, image: NDArray[np.uint16]) -> str:
    """Return how a dark frame in DN, exposed for seconds, shows light; "" if it doesn't."""
    clipped = _clipped_share(sensor, image)
    if clipped > _DARK_CLIPPED:
        return f"{100 * clipped:.2g} % of the pixels of this dark frame are saturated"
    level, noise = _dark_level(sensor, exposure)
    allowed = max(_SIGMAS * noise, _DARK_EXCESS * sensor.full_scale)
    # Where fewer than half of the pixels exceed it, the middle one doesn't.
    if 2 * np.count_nonzero(image > level + allowed) < image.size:
        return ""
    middle = float(np.median(image))
    if middle - level > allowed:
        return f"this dark frame reads {middle:.0f} DN, and {level:.0f} DN are the dark's at most"
    return ""


def lack_of_light(sensor: Sensor, exposure: float, image: NDArray[np.uint16]) -> str:
    """Say that a target's longest exposure, in seconds, shows no light; "" if it shows some."""
    if np.count_nonzero(image > _lit_level(sensor, exposure)) >= _LIT_PIXELS:
        return ""
    return "no pixel has light: the target is missing, or the light is off"


def star_that_is_none(sensor: Sensor, exposure: float, image: NDArray[np.uint16]) -> str:
    """Say that a frame of the star shows something extended; "" if it shows a point.

    A frame with saturated pixels isn't judged, because bright and very bright can't be told apart
    in it. exposure: seconds.
    """
    if _clipped_share(sensor, image) > _CLIPPED_STAR:
        return ""
    level, _ = _dark_level(sensor, exposure)
    bright = float(np.quantile(image, 0.999))
    if bright <= _lit_level(sensor, exposure):
        return ""
    share = (float(np.median(image)) - level) / (bright - level)
    if share <= _EXTENDED:
        return ""
    return f"its middle pixel has {100 * share:.0f} % of the brightest ones' light: this is no star"


def star_out_of_focus(
    camera: Camera, wavelength: float, exposure: float, image: NDArray[np.uint16]
) -> str:
    """Say that a star, taken with the neutral pattern, is out of focus; "" if it is sharp.

    Its width is the diameter of a disk with the area in which the star has half its peak or more.
    In focus it is about that of diffraction, 1.03 λ N (Goodman, Introduction to Fourier Optics,
    sec. 4.4), with N the image distance over the stop's diameter. A frame isn't judged if pixels
    are saturated, or if the star is dim. wavelength: metres. exposure: seconds.
    """
    sensor = camera.sensor
    if _clipped_share(sensor, image) > _CLIPPED_STAR:
        return ""
    level = float(np.median(image))
    above = float(np.partition(image, -_LIT_PIXELS, axis=None)[-_LIT_PIXELS]) - level
    _, noise = _dark_level(sensor, exposure)
    # Half of a dim peak lies within the noise.
    if above < 4 * _SIGMAS * noise:
        return ""
    width = 2 * math.sqrt(np.count_nonzero(image - level >= above / 2) / math.pi)
    number = camera.lens.image_distance * camera.lens.f_number / camera.lens.focal_length
    finest = max(1.03 * wavelength * number / sensor.pitch, 1.0)
    if width <= max(_WIDEST_STAR, _BLUR * finest):
        return ""
    return f"the star is {width:.0f} pixels wide, and {finest:.1f} in focus: focus the lens"


def _dark_level(sensor: Sensor, exposure: float) -> tuple[float, float]:
    """Return the highest level that darkness has, and its noise, both in DN."""
    electrons = _WARM * sensor.dark_current * exposure
    noise = math.sqrt(sensor.read_noise**2 + electrons) / sensor.gain
    return sensor.black_level + electrons / sensor.gain, math.hypot(noise, 1 / math.sqrt(12))


def _lit_level(sensor: Sensor, exposure: float) -> float:
    """Return the digital number above which a pixel has light."""
    level, noise = _dark_level(sensor, exposure)
    return level + _SIGMAS * noise


def _clipped_share(sensor: Sensor, image: NDArray[np.uint16]) -> float:
    return np.count_nonzero(image >= sensor.full_scale) / image.size
