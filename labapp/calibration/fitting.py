"""Fits of a record's frames: registration, phase response, zeroth order, wavefront, in order."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from labapp.calibration.calibration_frames import CalibrationFrames
from labapp.calibration.request import NEUTRAL_NAME, CalibrationDesign
from labapp.common.errors import UserError
from labapp.runs.record.reader import Record
from optics.camera import Camera
from optics.measuring.gratings import region_slices, stripe_pattern
from optics.measuring.phase_curve import StripeLaw, Sweep
from optics.measuring.registration import Registration, measure_first_orders, register
from optics.measuring.response_fit import ResponseFit, fit_response
from optics.measuring.spots import find_spot
from optics.measuring.star_model import StarModel
from optics.measuring.wavefront import StarPictures, WavefrontFit, fit_wavefront
from optics.measuring.zeroth_order import ZerothOrder, measure_zeroth_order, zeroth_order_share
from optics.progress import Progress
from optics.slm import Modulator, PhaseResponse, grey_to_phase

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class RegionFit:
    """The grey-level sweep of one panel region, and the phase response fitted to it."""

    sweep: Sweep
    fit: ResponseFit
    clipped_frames: int


@dataclass(eq=False)
class CalibrationFits:
    """All fits of a record, by wavelength in nm.

    Parts that weren't requested are empty.
    """

    path: Path
    design: CalibrationDesign
    camera: Camera
    registrations: dict[float, Registration] = field(default_factory=dict)
    responses: dict[float, list[RegionFit]] = field(default_factory=dict)
    zeroth: dict[float, ZerothOrder] = field(default_factory=dict)
    wavefront: WavefrontFit | None = None
    pictures: StarPictures | None = None

    @property
    def calibrated_camera(self) -> Camera:
        """Return the camera with fitted phase response and unmodulated light."""
        panel = self.camera.panel
        if self.responses:
            curves = [[one.fit.phase for one in regions] for regions in self.responses.values()]
            phases = np.array(curves).reshape(len(curves), *self.design.request.regions, -1)
            wavelengths = [nm * 1e-9 for nm in self.responses]
            response = PhaseResponse.from_phases(panel, wavelengths, torch.from_numpy(phases))
            panel = replace(panel, response=response)
        if self.zeroth:
            share = float(np.mean([found.share for found in self.zeroth.values()]))
            panel = replace(panel, unmodulated=min(max(share, 0.0), 1.0), front_reflection=0.0)
        return replace(self.camera, panel=panel)

    @property
    def coupling_length(self) -> float:
        """Return the fitted coupling between the panel's pixels in metres.

        Without a fit, the value comes from the camera's description.
        """
        seen = [region.fit.blur for regions in self.responses.values() for region in regions]
        panel = self.camera.panel
        return min(float(np.median(seen)), 1.0) * panel.pitch if seen else panel.coupling


def fit_calibration(path: Path, progress: Progress | None = None) -> CalibrationFits:
    """Run every fit for which a record has frames.

    Raises UserError if the record is of another kind, lacks frames, or gives a fit that can't be
    trusted. The message says what to do at the bench.
    """
    progress = progress or Progress()
    with Record(path) as record:
        frames = CalibrationFrames.of(record)
        design, request = frames.design, frames.design.request
        fits = CalibrationFits(path, design, frames.camera)
        count = len(request.wavelengths_nm)
        for number, nm in enumerate(request.wavelengths_nm):
            part = progress.part(0.7 * number / count, 0.7 * (number + 1) / count)
            _fit_wavelength(frames, nm, fits, part)
        if request.includes("wavefront"):
            progress.report(0.7, "wavefront")
            with _raise_user_errors(path, "wavefront"):
                _fit_wavefront(frames, fits, progress.part(0.7, 1.0))
    progress.report(1.0, "fitted")
    return fits


@contextmanager
def _raise_user_errors(path: Path, what: str) -> Iterator[None]:
    """Turn a fit's ValueError into a UserError that names the record and the fit."""
    try:
        yield
    except ValueError as error:
        raise UserError(f"{path}: {what}: {error}.") from error


def _fit_wavelength(
    frames: CalibrationFrames, nm: float, fits: CalibrationFits, progress: Progress
) -> None:
    """Fit registration, responses and zeroth order at one wavelength."""
    request, path = frames.design.request, fits.path
    progress.report(0.0, f"registration, {nm:g} nm")
    with _raise_user_errors(path, f"registration at {nm:g} nm"):
        fits.registrations[nm] = _fit_registration(frames, nm)
    if request.includes("response"):
        with _raise_user_errors(path, f"response at {nm:g} nm"):
            fits.responses[nm] = _fit_responses(frames, nm, fits.registrations[nm], progress)
    if request.includes("zeroth"):
        with _raise_user_errors(path, f"zeroth order at {nm:g} nm"):
            fits.zeroth[nm] = _fit_zeroth_order(frames, nm, fits)


def _fit_registration(frames: CalibrationFrames, nm: float) -> Registration:
    """Fit the registration to the steering gratings' spots and the neutral star."""
    dark = frames.mean_dark_frame(nm)
    neutral, variance = frames.mean_light(NEUTRAL_NAME, nm, dark)
    hot = frames.hot_pixels(dark)
    clipped = frames.clipped_pixels(NEUTRAL_NAME, nm) & ~hot
    if clipped.any():
        raise ValueError(
            f"{int(clipped.sum())} pixels of the neutral star are clipped; expose it shorter "
            "(--exposure-ms)"
        )
    centre = find_spot(np.where(hot, 0.0, neutral), variance)
    y, x = np.ogrid[: neutral.shape[0], : neutral.shape[1]]
    # Steered spots aren't searched within 12 pixels of the zeroth order.
    near = np.hypot(y - centre.y, x - centre.x) < 12
    spots = [centre]
    for name in frames.design.steering_names(nm):
        steered, noise = frames.mean_light(name, nm, dark)
        light = np.where(hot, 0.0, steered - neutral)
        spots.append(find_spot(light, noise + variance, excluded=near | hot))
    vectors = np.array([(0.0, 0.0), *frames.design.compass])
    return register(vectors, spots, nm * 1e-9)


def _fit_responses(
    frames: CalibrationFrames, nm: float, registration: Registration, progress: Progress
) -> list[RegionFit]:
    design, camera = frames.design, frames.camera
    panel = camera.panel
    regions = design.request.regions
    cells = (panel.shape[0] // regions[0], panel.shape[1] // regions[1])
    vectors = np.array(design.vectors)
    gathered = measure_first_orders(
        [frames.raw_frames(name, nm)[0] for name in design.sweep_names],
        frames.mean_dark_frame(nm, design.exposures_at(nm).sweep_ms),
        registration,
        vectors,
        cells,
        camera.sensor,
        nm * 1e-9,
    )
    low, high = np.array(design.low), np.array(design.high)
    top = torch.full(panel.shape, panel.levels - 1, dtype=torch.uint8)
    reach = float(grey_to_phase(panel, top, nm * 1e-9).mean())
    found = []
    upper = stripe_pattern(panel.shape, regions, vectors, 0, 1) == 1
    parts = region_slices(panel.shape, regions)
    for number, (light, vector, part) in enumerate(zip(gathered, vectors, parts, strict=True)):
        progress.report(number / len(vectors), f"response, {nm:g} nm, region {number + 1}")
        ok = ~light.clipped
        # Steps of the phase are searched up to 1.7 times the described range.
        law = StripeLaw(upper[part], vector, panel.active_side / panel.pitch, 1.7 * reach)
        sweep = Sweep(low[ok], high[ok], light.light[ok], light.noise[ok], law)
        fit = fit_response(sweep, panel.levels, reach)
        found.append(RegionFit(sweep, fit, int(light.clipped.sum())))
    return found


def _fit_zeroth_order(frames: CalibrationFrames, nm: float, fits: CalibrationFits) -> ZerothOrder:
    """Measure the unmodulated light that steering gratings leave unsteered.

    This light lies in the zeroth order. The light that the gratings themselves leave there is
    computed from the fitted response, and subtracted.
    """
    dark = frames.mean_dark_frame(nm)
    neutral, _ = frames.mean_light(NEUTRAL_NAME, nm, dark)
    # The coupling is included, because it matters most at the jumps of a blazed grating.
    panel = replace(
        fits.calibrated_camera.panel,
        illumination=None,
        flatness=None,
        coupling=fits.coupling_length,
    )
    modulator = Modulator(panel, nm * 1e-9)
    steered, noises, expected = [], [], []
    for name in frames.design.steering_names(nm):
        light, noise = frames.mean_light(name, nm, dark)
        grey = torch.from_numpy(frames.record.pattern(name))
        steered.append(light)
        noises.append(noise)
        modulation = modulator.modulation_of_grey(grey, dtype=torch.float64)
        expected.append(zeroth_order_share(modulation.numpy()))
    usable = ~(frames.hot_pixels(dark) | frames.clipped_pixels(NEUTRAL_NAME, nm))
    centre = fits.registrations[nm].centre
    return measure_zeroth_order(neutral, steered, noises, expected, centre, usable)


def _fit_wavefront(frames: CalibrationFrames, fits: CalibrationFits, progress: Progress) -> None:
    design, request = frames.design, frames.design.request
    nm = design.reference_nm
    if request.star_diameter_um is None or request.star_distance_m is None:
        raise ValueError("the star's size and distance aren't known (--star-um, --star-m)")
    shown = [NEUTRAL_NAME, *design.defocus_names]
    registration = fits.registrations[nm]
    corner, shape = _window(registration.centre, frames.camera.sensor.shape)
    part = tuple(slice(c, c + n) for c, n in zip(corner, shape, strict=True))
    fits.pictures = _star_pictures(frames, shown, nm, part)
    calibrated = fits.calibrated_camera
    phases = [
        grey_to_phase(calibrated.panel, torch.from_numpy(frames.record.pattern(name)), nm * 1e-9)
        for name in shown
    ]
    model = StarModel(
        calibrated,
        phases,
        registration,
        nm * 1e-9,
        corner=corner,
        shape=shape,
        diameter=request.star_diameter_um * 1e-6,
        distance=request.star_distance_m,
        unmodulated=calibrated.panel.unmodulated,
    )
    fits.wavefront = fit_wavefront(model, fits.pictures, progress=progress)


def _window(
    centre: tuple[float, float], shape: tuple[int, int]
) -> tuple[tuple[int, int], tuple[int, int]]:
    """Return the star's window for the wavefront's fit: first pixel and shape.

    The window reaches 24 pixels from the star's middle, at most to the edge of the frame.
    """
    reach = 24
    low = [max(round(c) - reach, 0) for c in centre]
    high = [min(round(c) + reach + 1, n) for c, n in zip(centre, shape, strict=True)]
    return (low[0], low[1]), (high[0] - low[0], high[1] - low[1])


def _star_pictures(
    frames: CalibrationFrames, shown: Sequence[str], nm: float, part: tuple[slice, ...]
) -> StarPictures:
    dark = frames.mean_dark_frame(nm)
    hot = frames.hot_pixels(dark)
    lights, variances, usable = [], [], []
    for name in shown:
        light, variance = frames.mean_light(name, nm, dark)
        lights.append(light[part])
        variances.append(variance[part])
        usable.append(~(hot | frames.clipped_pixels(name, nm))[part])
    return StarPictures(np.stack(lights), np.stack(variances), np.stack(usable))
