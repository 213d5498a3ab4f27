"""Check that a frame was taken with the requested settings; if not, it is taken again."""

from __future__ import annotations

from dataclasses import dataclass

from drivers.errors import DeviceError
from drivers.interfaces import Frame
from labapp.runs.bench_interface import Bench
from labapp.runs.shots import Shot

EXPOSURE_TOLERANCE = (20e-6, 0.02)
"""Allowed difference of an exposure from the requested one: seconds, and share of the exposure.
The larger one applies. Cameras set exposures in steps of a sensor line."""

WAVELENGTH_TOLERANCE = 0.011e-9
"""Allowed difference in metres of a wavelength from the requested one: tunable filters set it in
steps of 0.01 nm."""

GAIN_TOLERANCE_DB = 0.1
"""Allowed difference of a gain from the requested one in decibels, 1 %: cameras set it in steps."""


def is_exposure_as_requested(exposure: float, requested: float) -> bool:
    """Return whether an exposure is the requested one, as closely as cameras keep it.

    Both exposures are in seconds.
    """
    seconds, share = EXPOSURE_TOLERANCE
    return abs(exposure - requested) <= max(seconds, share * requested)


@dataclass(frozen=True)
class CaptureConditions:
    """Settings of the bench at the capture of a frame.

    exposure: the set value, seconds.
    settled_at: the clock's time from which all settings had settled.
    last_number: the camera's number of the last accepted frame.
    shape: of the frame, (rows, columns).
    """

    exposure: float
    settled_at: float
    last_number: int
    shape: tuple[int, int]


def require_valid_frame(
    frame: Frame, shot: Shot, conditions: CaptureConditions, bench: Bench
) -> float:
    """Check that a frame has the shot's settings; return its wavelength in metres.

    Raises DeviceError if the frame is stale, has another exposure or size or impossible numbers, or
    if a device doesn't have the setting that it was given. A missing frame does less harm than a
    wrong one that looks right.
    """

    def refuse(role: str, what: str) -> DeviceError:
        return bench.device_error(role, f"capture at {conditions.exposure * 1e3:g} ms", what)

    if not is_exposure_as_requested(conditions.exposure, shot.exposure):
        raise refuse("camera", f"{shot.exposure * 1e3:g} ms were asked for")
    if frame.exposure != conditions.exposure:
        raise refuse("camera", f"the frame was exposed for {frame.exposure * 1e3:g} ms")
    # A full well's noise is above the full scale, but not twice as high.
    top, full = int(frame.image.max(initial=0)), bench.camera.full_scale
    if top >= 2 * (full + 1):
        error = refuse("camera", f"the frame's pixels reach {top}, and its full scale is {full}")
        error.lasting = True
        raise error
    if frame.image.shape != conditions.shape:
        pixels, wanted = frame.image.shape, conditions.shape
        raise refuse("camera", f"the frame has {pixels} pixels, and {wanted} were asked for")
    if frame.number <= conditions.last_number:
        raise refuse("camera", f"frame {frame.number} came again: it is stale")
    if frame.time < conditions.settled_at:
        early = (conditions.settled_at - frame.time) * 1e3
        raise refuse("camera", f"the frame is stale: it began {early:.1f} ms before all stood")
    if bench.slm.displayed_pattern != shot.pattern:
        raise refuse("slm", f"it shows {bench.slm.displayed_pattern!r} instead of {shot.pattern!r}")
    if bench.targets.current_target != shot.place:
        raise refuse(
            "targets", f"{bench.targets.current_target!r} is placed instead of {shot.place!r}"
        )
    wavelength = bench.filter.wavelength
    if abs(wavelength - shot.wavelength) > WAVELENGTH_TOLERANCE:
        raise refuse("filter", f"it stands at {wavelength * 1e9:.2f} nm")
    return wavelength
