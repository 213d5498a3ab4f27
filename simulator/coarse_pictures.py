"""Pictures on larger pixels, predicted in a fraction of a second before an exact one."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import torch

from optics.caching import ByteCache
from optics.camera import Camera
from optics.psf import nyquist_samples_per_pixel
from optics.slm import grey_to_phase
from optics.threads import single_threaded
from optics.validation import as_number
from simulator.effects.registry import EFFECTS
from simulator.formation import expected_electrons
from simulator.ledger import Ledger
from simulator.planning.effect_plan import build_recipe
from simulator.situation import Situation

# Most pixels of a coarse picture. Chosen: 5 megapixels become 490 x 409, and detail that a coarse
# picture lacks is less than 8 % of a photograph's norm.
_PIXELS = 1 << 18

_MEMORY = 128 << 20  # bytes of spectra that are kept for the next patterns. Chosen.

# Share of the panel's steps from pixel to pixel that a PSF's window covers. Chosen: the steepest
# ones are the jumps of the pattern, which send little light anywhere.
_SHARE = 0.999

# Metres on the sensor around the geometric reach of a pattern, for diffraction and aberrations.
# Chosen.
_MARGIN = 0.3e-3

# Levels of the effects that change a photograph most; the others are left out.
_LEVELS = {"unmodulated light": 1, "diffraction": 1, "pixel aperture": 1}


class CoarsePictures:
    """Predict the mean picture of situations on larger pixels, without planning any effects.

    It has one wavelength and one depth, what the panel doesn't modulate, and diffraction by the
    pattern, whose slope gives the PSF's window.
    """

    def __init__(self) -> None:
        self._cache, self._ledger = ByteCache(_MEMORY), Ledger()

    @single_threaded
    def predict(self, s: Situation, check: Callable[[], None] = lambda: None) -> torch.Tensor:
        """Return mean electrons on a pixel, float32, one number for each larger pixel.

        check: is called between the steps, and may raise. Raises ValueError for a sensor with
        colour filters.
        """
        if s.camera.sensor.colour is not None:
            raise ValueError("the sensor has colour filters: coarse pictures are grey")
        joined, sensor = pixels_joined(s.camera), s.camera.sensor
        shape = sensor.shape[0] // joined, sensor.shape[1] // joined
        larger = replace(sensor, shape=shape, pitch=sensor.pitch * joined)
        coarse = replace(s, camera=replace(s.camera, sensor=larger))
        # Samples of the PSF are as far apart as its field's may be, twice as far as its
        # irradiance's: what overlaps then in its spectrum are only frequencies that a coarse pixel
        # averages away.
        samples = nyquist_samples_per_pixel(coarse.camera, s.wavelength) / 2
        recipe = build_recipe(EFFECTS, coarse, _LEVELS).with_changes(
            window=psf_window(coarse),
            samples_per_pixel=math.ceil(1.05 * samples),
            picture_samples_per_pixel=1,
        )
        light = expected_electrons(coarse, recipe, self._cache, self._ledger, check)
        return light / joined**2


def pixels_joined(camera: Camera) -> int:
    """Return how many of the sensor's pixels a coarse pixel joins along each axis."""
    return math.ceil(math.sqrt(math.prod(camera.sensor.shape) / _PIXELS))


def psf_window(s: Situation) -> int:
    """Return the side of a PSF's window in sensor pixels, by the slope of the pattern.

    A step of 2π per panel pixel sends light into the next order, λ b / pitch away on the sensor,
    with the ray matrix' element b: geometric optics of the same wavefront.
    """
    camera, panel = s.camera, s.camera.panel
    grey = torch.tensor(s.panel_content.first)
    phase = grey_to_phase(panel, grey, s.wavelength)
    order = s.wavelength * as_number(camera.ray_matrix_b) / panel.pitch / camera.sensor.pitch
    steepest = 0.0
    for axis in (0, 1):
        step = torch.diff(phase, dim=axis).to(torch.float32).abs()
        turns = torch.remainder(step / (2 * math.pi) + 0.5, 1) - 0.5
        count = max(1, round((1 - _SHARE) * turns.numel()))
        steepest = max(steepest, float(turns.abs().flatten().topk(count).values[-1]))
    margin = _MARGIN / camera.sensor.pitch
    return math.ceil(min(2 * steepest * order + margin, order + 1))
