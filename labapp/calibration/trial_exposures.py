"""Trial exposures, within what the camera can expose, and the plan that takes them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from labapp.files.plan_file import PlanFile
from labapp.files.quantities import round_exposure
from optics.camera import Sensor


def limit_exposures(sensor: Sensor, wanted: Sequence[float]) -> tuple[float, ...]:
    """Limit exposures to the sensor's range, in whole microseconds.

    Exposures are in seconds; the result is sorted, and each is there once.
    """
    low, high = sensor.exposure_range
    return tuple(sorted({round_exposure(min(max(one, low), high)) for one in wanted}))


def trial_plan(
    title: str, neutral: str, wanted: Mapping[tuple[str, float], Sequence[float]]
) -> PlanFile:
    """Return the plan of trials through the neutral pattern.

    `neutral` is the pattern's name, and `wanted` has the exposures in seconds by target and
    wavelength in nm.
    """
    blocks = [
        {
            "targets": [target],
            "patterns": [neutral],
            "wavelengths_nm": [nm],
            "exposures_ms": [one * 1e3 for one in exposures],
        }
        for (target, nm), exposures in wanted.items()
    ]
    return PlanFile.model_validate(
        {
            "version": 1,
            "title": title,
            "patterns": {neutral: {"kind": "constant", "grey": 0}},
            "acquire": blocks,
        }
    )
