"""The plan that takes white sheet and star in each band, with dark frames."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from labapp.files.plan_file import PlanFile
from labapp.files.plan_folder import PATTERN_FOLDER
from labapp.files.quantities import round_exposure
from labapp.spectral_calibration.exposure_search import Exposures
from labapp.spectral_calibration.request import REQUEST_KEY, SpectraRequest
from optics.camera import Sensor

# Exposure of the coded star's dim parts, over that at which nothing is clipped. Chosen: as in the
# plan coded-snapshot.
_LONGER = 8.0

# Frames of each kind. Chosen: a dark frame's noise counts in all frames of its exposure.
_STAR_REPEATS, _FLAT_REPEATS, _DARK_REPEATS = 4, 2, 4

_STEP = 1.5  # ratio of exposures that are taken as one, for fewer dark frames. Chosen


def build_spectra_plan(
    request: SpectraRequest,
    patterns: Mapping[str, NDArray[np.uint8]],
    exposures: Exposures,
    sensor: Sensor,
) -> PlanFile:
    """Build the plan that takes all frames.

    patterns: grey levels of the two, whose pictures lie in the folder "patterns" beside the plan.
    exposures: seconds at which star and sheet aren't clipped.
    """
    rounded = _round_exposures(exposures, sensor)
    longest = sensor.exposure_range[1]
    both = [request.neutral, request.coded]
    lights, taken = [], set[float]()
    for nm in request.bands_nm:
        flat, star = rounded[request.flat, nm], rounded[request.star, nm]
        longer = min(round_exposure(star * _LONGER), longest)
        taken |= {flat, star, longer}
        lights.append(_block(request.flat, both, nm, (flat,), _FLAT_REPEATS))
        lights.append(_block(request.star, both, nm, (star, longer), _STAR_REPEATS))
    blocks = []
    if request.dark:
        nm = request.bands_nm[0]
        darks = _block(request.dark, [request.neutral], nm, taken, _DARK_REPEATS)
        blocks.append(darks | {"role": "dark"})
    # One target after the other, so that each is placed once.
    lights.sort(key=lambda one: one["targets"] == [request.star])
    return PlanFile.model_validate(
        {
            "version": 1,
            "title": "Spectral calibration",
            "metadata": {REQUEST_KEY: request.model_dump_json()},
            "patterns": {
                one: {"kind": "image", "file": f"{PATTERN_FOLDER}/{one}.png"} for one in patterns
            },
            "acquire": [*blocks, *lights],
            "reconstruct": {
                "coded": request.coded,
                "neutral": request.neutral,
                "star": request.star,
                "photograph": request.flat,
                "dark": request.dark or "dark",
                "psf_window_px": request.window_px,
            },
        }
    )


def _round_exposures(exposures: Exposures, sensor: Sensor) -> Exposures:
    """Round exposures (seconds) down to steps, within the sensor's range."""
    low, high = max(sensor.exposure_range[0], 1e-6), sensor.exposure_range[1]
    rounded = {}
    for key, exposure in exposures.items():
        steps = np.floor(np.log(exposure / low) / np.log(_STEP) + 1e-9)
        rounded[key] = round_exposure(float(min(max(low * _STEP**steps, low), high)))
    return rounded


def _block(
    target: str, shown: list[str], nm: float, exposures: Iterable[float], repeats: int
) -> dict[str, Any]:
    return {
        "targets": [target],
        "patterns": shown,
        "wavelengths_nm": [nm],
        "exposures_ms": sorted({one * 1e3 for one in exposures}),
        "repeats": repeats,
    }
