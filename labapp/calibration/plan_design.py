"""Plan and patterns: steering gratings, stripes of two grey levels, known defocus."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
import torch
from numpy.typing import NDArray

from labapp.calibration.request import (
    DESIGN_KEY,
    NEUTRAL_NAME,
    CalibrationDesign,
    CalibrationExposures,
    CalibrationRequest,
)
from labapp.common.errors import UserError
from labapp.files.plan_file import PlanFile
from optics.camera import Camera
from optics.camera.pupil import open_pupil_radius
from optics.measuring.gratings import (
    blazed_grating_phase,
    max_grating_frequency,
    region_vectors,
    registration_vectors,
    stripe_pattern,
)
from optics.slm import max_phase, phase_to_grey

Patterns = dict[str, NDArray[np.uint8]]


def design_calibration(
    camera: Camera, request: CalibrationRequest, exposures: tuple[CalibrationExposures, ...]
) -> CalibrationDesign:
    """Choose gratings and grey levels for a camera's panel and sensor.

    Raises UserError if the regions' spots can't be told apart on the sensor.
    """
    panel, sensor, z = camera.panel, camera.sensor, camera.ray_matrix_b
    # The longest wavelength is steered farthest, and the shortest has the widest phase range.
    longest_nm, shortest_nm = max(request.wavelengths_nm), min(request.wavelengths_nm)
    scale = longest_nm * 1e-9 * z
    longest = max_grating_frequency(sensor.shape, sensor.pitch, panel.pitch, scale)
    made = CalibrationDesign(
        request=request,
        exposures=exposures,
        compass=_pairs(registration_vectors(longest)),
        # Waves of defocus from edge to centre of the open pupil.
        defocus_waves=(-1.5, 1.5) if request.includes("wavefront") else (),
    )
    if not request.includes("response"):
        return made
    # Star, lens and filter widen a spot by 5 sensor pixels at most.
    blur = 5.0 * sensor.pitch * panel.pitch / (shortest_nm * 1e-9 * z)
    try:
        vectors = region_vectors(panel.shape, request.regions, longest, blur)
    except ValueError as error:
        raise UserError(f"--regions {request.regions[0]}x{request.regions[1]}: {error}.") from error
    low, high = sweep_levels(panel.levels, request.levels, max_phase(panel, shortest_nm * 1e-9))
    return made.model_copy(update={"vectors": _pairs(vectors), "low": low, "high": high})


def sweep_levels(levels: int, frames: int, reach: float) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Choose the grey levels of the two stripes in each frame of the sweep.

    The levels are in the order of display. The upper levels cover the whole range, more densely
    towards the ends, where a curve is supported on one side only; the last one comes twice. The
    lower level is 0 in every other frame. In the frames between, it is about a quarter of a wave
    above 0, as computed from the expected phase range `reach` in radians.
    """
    top = levels - 1
    x = np.linspace(0, 1, frames - 1)
    # At the ends, the spacing of the levels is 35 % below the mean.
    spread = top * (x - 0.35 * np.sin(2 * math.pi * x) / (2 * math.pi))
    high = np.append(spread.round().astype(int), top)
    quarter = max(1, round(top * (math.pi / 2) / reach))
    low = np.where(np.arange(frames) % 2 == 1, quarter, 0)
    order = spread_order(frames)
    return tuple(low[order].tolist()), tuple(high[order].tolist())


def spread_order(count: int) -> list[int]:
    """Return an order of numbers in which neighbours are far apart in time.

    A drift of the lamp then appears as scatter, and not as a bend of what is fitted.
    """
    stride = max(1, round(0.382 * count))
    while math.gcd(stride, count) > 1:
        stride += 1
    return [n * stride % count for n in range(count)]


def render_patterns(camera: Camera, design: CalibrationDesign) -> Patterns:
    """Compute the grey levels, (rows, columns), of every pattern by its name."""
    panel = camera.panel
    shown: Patterns = {NEUTRAL_NAME: np.zeros(panel.shape, dtype=np.uint8)}
    for nm in design.request.wavelengths_nm:
        for name, vector in zip(design.steering_names(nm), design.compass, strict=True):
            phase = torch.from_numpy(blazed_grating_phase(panel.shape, vector))
            shown[name] = phase_to_grey(panel, phase, nm * 1e-9).numpy()
    for name, waves in zip(design.defocus_names, design.defocus_waves, strict=True):
        shown[name] = _defocus_pattern(camera, waves, design.reference_nm * 1e-9)
    regions, vectors = design.request.regions, np.array(design.vectors)
    for name, low, high in zip(design.sweep_names, design.low, design.high, strict=True):
        shown[name] = stripe_pattern(panel.shape, regions, vectors, low, high)
    return shown


def _defocus_pattern(camera: Camera, waves: float, wavelength: float) -> NDArray[np.uint8]:
    """Compute a pattern of defocus, wrapped at whole waves.

    The wraps are as many whole waves apart as the panel's range holds. This keeps the number of
    phase jumps as small as possible.
    """
    y, x = camera.panel.plane.mesh()
    phase = 2 * math.pi * waves * (y**2 + x**2) / open_pupil_radius(camera) ** 2
    orders = max(1, int(max_phase(camera.panel, wavelength) / (2 * math.pi)))
    # Starting at zero avoids wrapping if the panel's range suffices.
    shown = phase - phase.min()
    return phase_to_grey(camera.panel, shown, wavelength, orders).numpy()


def build_plan(
    design: CalibrationDesign, patterns: Mapping[str, NDArray[np.uint8]], folder: str
) -> PlanFile:
    """Build the plan that takes all frames.

    `folder` is the folder with the patterns' picture files, beside the plan.
    """
    request = design.request
    blocks = []
    for nm in request.wavelengths_nm:
        exposures = design.exposures_at(nm)
        full, sweep = design.steering_names(nm), design.sweep_names
        if nm == design.reference_nm:
            full += design.defocus_names
        neutral, full_ms = [NEUTRAL_NAME], exposures.full_ms
        if request.dark:
            both = (full_ms, exposures.sweep_ms) if sweep else (full_ms,)
            darks = _block(request.dark, neutral, nm, *both, repeats=2)
            blocks.append(darks | {"role": "dark"})
        blocks.append(_block(request.star, neutral, nm, full_ms, repeats=2))
        blocks.append(_block(request.star, full, nm, full_ms))
        if sweep:
            blocks.append(_block(request.star, sweep, nm, exposures.sweep_ms))
    return PlanFile.model_validate(
        {
            "version": 1,
            "title": "Calibration: " + ", ".join(request.parts),
            "metadata": {DESIGN_KEY: design.model_dump_json()},
            "patterns": {n: {"kind": "image", "file": f"{folder}/{n}.png"} for n in patterns},
            "acquire": blocks,
        }
    )


def _block(
    target: str, shown: list[str], nm: float, *exposures_ms: float, repeats: int = 1
) -> dict[str, object]:
    return {
        "targets": [target],
        "patterns": shown,
        "wavelengths_nm": [nm],
        "exposures_ms": sorted(set(exposures_ms)),
        "repeats": repeats,
    }


def _pairs(vectors: NDArray[np.float64]) -> tuple[tuple[float, float], ...]:
    return tuple((float(y), float(x)) for y, x in vectors)
