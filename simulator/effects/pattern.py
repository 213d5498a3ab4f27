"""What a panel shows, as the estimates look at it."""

from __future__ import annotations

import functools
import math
from functools import cached_property

import torch

from optics.camera import Camera
from optics.fourier import fft
from optics.pupil import panel_phase, pupil_amplitude
from optics.slm import grey_to_phase, max_phase
from optics.slm.flatness import flatness_phase


class Pattern:
    """Grey levels (rows, columns) on the panel of a camera, at a wavelength in metres.

    Each property is computed when an estimate first asks for it.
    """

    def __init__(self, camera: Camera, grey: torch.Tensor, wavelength: float) -> None:
        self.camera, self.panel, self.wavelength = camera, camera.panel, wavelength
        self._grey = grey

    @cached_property
    def phase(self) -> torch.Tensor:
        """What the liquid crystal gives to the light, radians."""
        return grey_to_phase(self.panel, self._grey, self.wavelength)

    @cached_property
    def linear_phase(self) -> torch.Tensor:
        """What it would give if the phase grew evenly with the level."""
        reach = max_phase(self.panel, self.wavelength)
        return self._grey.to(torch.float64) * (reach / (self.panel.levels - 1))

    @cached_property
    def spread(self) -> float:
        """Radius in metres to which light is sent: by the pattern, and by panel and lens."""
        still = _still_phase(self.camera, self.wavelength)
        phase = self.phase if still is None else self.phase + still
        return phase_spread(self.camera, phase, self.wavelength)

    @cached_property
    def field(self) -> torch.Tensor:
        """What leaves the panel's pixels, complex."""
        return torch.polar(torch.ones_like(self.phase), self.phase)

    def mean(self, of: torch.Tensor) -> complex:
        """Over the pixels by what the stop leaves open of them: what comes to the centre."""
        opened = pupil_amplitude(self.camera)
        return complex((of * opened).sum() / opened.sum())

    @cached_property
    def _light(self) -> tuple[torch.Tensor, torch.Tensor]:
        """In the far field, (rows, columns): of the pattern and of a neutral one, which send
        alike. From samples that just resolve the field."""
        opened = pupil_amplitude(self.camera).to(torch.complex64)
        light, neutral = _far_field(opened * self.field), _far_field(opened)
        return light / light.sum(), neutral / neutral.sum()

    @cached_property
    def sharpness(self) -> float:
        """How sharp the PSF is: its root mean square over that of a neutral pattern, 1 at most."""
        light, neutral = self._light
        return min(1.0, float((light**2).sum().sqrt() / (neutral**2).sum().sqrt()))

    @cached_property
    def brightness(self) -> float:
        """Of the PSF in the centre and around it, over that of a neutral pattern."""
        light, neutral = (part.roll((1, 1), (0, 1))[:3, :3].sum() for part in self._light)
        return min(1.0, float(light / neutral))


@functools.lru_cache(maxsize=4)
def _still_phase(camera: Camera, wavelength: float) -> torch.Tensor | None:
    """What panel and lens give to the light whatever is shown, (rows, columns); None if nothing.

    Don't write into it: it is kept, because polynomials take their time.
    """
    phase, panel, lens = None, camera.panel, camera.lens
    if lens.aberrations:
        wave = panel_phase(camera, lens.focus_distance, wavelength)
        phase = torch.where(pupil_amplitude(camera) > 0, wave, 0.0)
    if panel.flatness is not None:
        figure = flatness_phase(panel, wavelength)
        phase = figure if phase is None else phase + figure
    return phase


def _far_field(field: torch.Tensor) -> torch.Tensor:
    """Light of a field, its origin in the corner."""
    rows, columns = field.shape
    return fft(fft(field.to(torch.complex64), columns, -1), rows, -2).abs() ** 2


def phase_spread(camera: Camera, phase: torch.Tensor, wavelength: float) -> float:
    """Radius in metres to which a shown phase sends light: three times its rms slope.

    A slope of s rad/m sends light to s wavelength B / 2 pi, B the camera's lever; steps are
    taken modulo a wave.
    """
    squares = 0.0
    for axis in (0, 1):
        step = torch.diff(phase, dim=axis) / (2 * math.pi)
        step = (step - torch.round(step)) / camera.panel.pitch
        squares += float((step**2).mean())
    return 3 * math.sqrt(squares / 2) * wavelength * camera.lever
