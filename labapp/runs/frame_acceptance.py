"""What makes a frame the one that was asked for; anything else is taken again."""

from __future__ import annotations

from dataclasses import dataclass

from drivers.interfaces import Frame
from labapp.runs.bench_interface import Bench
from labapp.runs.steps import Shot

EXPOSURE_TOLERANCE = (20e-6, 0.02)
"""Seconds, and share, by which an exposure may miss what was asked: cameras count in lines."""

WAVELENGTH_TOLERANCE = 0.011e-9
"""Metres by which a wavelength may miss what was asked: tunable filters count in 0.01 nm."""


def is_exposure_as_requested(exposure: float, requested: float) -> bool:
    """Whether a camera's exposure in seconds is the nearest to what was asked, or nearly so."""
    seconds, share = EXPOSURE_TOLERANCE
    return abs(exposure - requested) <= max(seconds, share * requested)


@dataclass(frozen=True)
class CaptureConditions:
    """What held when a frame was asked for.

    exposure: seconds, as set. settled_at: the clock's time from which all settings stood.
    last_number: the camera's count of the last accepted frame.
    """

    exposure: float
    settled_at: float
    last_number: int


def require_valid_frame(
    frame: Frame, shot: Shot, conditions: CaptureConditions, bench: Bench
) -> float:
    """The wavelength that a frame was taken at, in metres.

    DeviceError if the frame is stale, of another exposure, or if a device isn't where it was
    set to: a picture that looks right and isn't costs more than one that is missing.
    """

    def refuse(role: str, what: str) -> Exception:
        return bench.device_error(role, f"capture at {conditions.exposure * 1e3:g} ms", what)

    if not is_exposure_as_requested(conditions.exposure, shot.exposure):
        raise refuse("camera", f"{shot.exposure * 1e3:g} ms were asked for")
    if frame.exposure != conditions.exposure:
        raise refuse("camera", f"the frame was exposed for {frame.exposure * 1e3:g} ms")
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
