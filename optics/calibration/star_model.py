"""A star through panel and lens, on sensor pixels that are turned against the panel."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch

from optics.calibration.registration import Registration
from optics.camera import Camera
from optics.chain.thin_camera import collapse_to_thin_camera
from optics.plane import Plane
from optics.psf import PSFOperator, nyquist_samples_per_pixel
from optics.pupil import open_pupil_radius, pupil_amplitude
from optics.slm import Panel
from optics.validation import require_positive

_MOST_PIXELS = 300
"""Along a panel, of the coarser one that stands for it: wavefronts are smooth."""

_OVERSAMPLING = 3.0
"""Samples over those that just resolve the PSF, for cubics between them."""

_TOL = 1e-6
"""Of a PSF: in single precision the derivatives would be noise before a fit has ended."""

_MARGIN = 4
"""Sensor pixels around the window."""


class StarModel:
    """Share of a star's light on each pixel of a window, for several patterns on the panel.

    camera: its panel, lens and stop; the panel's own flatness is left out, as what is sought.
    phases: (rows, columns) radians on the panel, one a pattern, as it really shows them.
    registration: of panel and sensor. corner: (row, column) of the window's first pixel. shape:
    of the window. diameter, distance: of the star, metres. unmodulated: share of the light.

    Call with the optical path on `plane` in metres, (rows, columns), the star's place (y, x)
    beside the registration's centre in pixels, and the light's amplitude on `plane` beside what
    the camera describes; tensors, in which it is differentiable. The answer is (patterns, rows,
    columns).
    """

    def __init__(
        self,
        camera: Camera,
        phases: Sequence[torch.Tensor],
        registration: Registration,
        wavelength: float,
        *,
        corner: tuple[int, int],
        shape: tuple[int, int],
        diameter: float,
        distance: float,
        unmodulated: float = 0.0,
    ) -> None:
        require_positive("wavelength", wavelength, "m")
        self.wavelength, self.pattern_count = wavelength, len(phases)
        image = diameter * camera.magnification(distance)
        camera = _with_lens_at_panel(camera, distance)
        self.radius = open_pupil_radius(camera)
        factor = _coarsening_factor(camera.panel.shape)
        coarse = _coarse_panel(camera.panel, factor)
        behind = replace(camera, panel=coarse)
        self.plane = coarse.plane
        self.light_on_panel = pupil_amplitude(behind)
        self._unmodulated = unmodulated
        lit = camera.panel.illumination
        amplitude = None if lit is None else lit.at_pixels(camera.panel).sqrt()
        self._modulations = [_block_average(phase, amplitude, factor) for phase in phases]
        self._neutral_modulation = _block_average(torch.zeros_like(phases[0]), amplitude, factor)
        scale = wavelength * camera.lens.image_distance
        self._pixel_positions = (
            _window_vectors(registration, wavelength, corner, shape) * scale / camera.panel.pitch
        )
        self._position_per_pixel = (
            _vector_per_pixel(registration, wavelength) * scale / camera.panel.pitch
        )
        self._grid = _grid(camera, wavelength, self._pixel_positions)
        self._operator = PSFOperator(
            behind,
            distance,
            wavelength,
            self._grid,
            integrate=False,
            unmodulated=0.0,
            tol=_TOL,
        )
        self._blur_transfer = _disc_and_pixel_transfer(self._grid, image, self._position_per_pixel)

    def __call__(
        self, path: torch.Tensor, place: torch.Tensor, amplitude: torch.Tensor | float = 1.0
    ) -> torch.Tensor:
        phase = 2 * math.pi / self.wavelength * path
        shares = [self._operator(phase, wave * amplitude) for wave in self._modulations]
        light = torch.stack(shares).to(torch.float64)
        if self._unmodulated:
            # It goes through the panel, and is of the polarisation that doesn't see the pattern.
            straight = self._operator(phase, self._neutral_modulation * amplitude).to(torch.float64)
            light = (1 - self._unmodulated) * light + self._unmodulated * straight
        spectrum = torch.fft.rfft2(light) * self._blur_transfer
        light = torch.fft.irfft2(spectrum, s=self._grid.shape)
        area = abs(float(torch.linalg.det(self._position_per_pixel))) / math.prod(self._grid.pitch)
        return self._sample_pixels(light, place) * area

    def _sample_pixels(self, light: torch.Tensor, place: torch.Tensor) -> torch.Tensor:
        """At the pixels' centres, by cubics between the grid's samples."""
        places = self._pixel_positions - (self._position_per_pixel @ place)
        unit = [
            (places[..., axis] / self._grid.pitch[axis] + n // 2) * 2 / (n - 1) - 1
            for axis, n in enumerate(self._grid.shape)
        ]
        where = torch.stack([unit[1], unit[0]], dim=-1)[None].expand(len(light), -1, -1, -1)
        found = torch.nn.functional.grid_sample(
            light[:, None], where, mode="bicubic", padding_mode="border", align_corners=True
        )
        return found[:, 0]


def _with_lens_at_panel(camera: Camera, distance: float) -> Camera:
    """A camera whose panel stands apart from its lens, as one with the lens at the panel.

    By its ray matrix and the stop's shadow; the lens' aberrations are carried back to the panel
    along the rays. What the stop's edge scatters is far below the pictures' noise, and a fit
    asks for hundreds of them. The camera itself where it is so already.
    """
    if not camera.separation:
        return camera
    lens = camera.lens
    plain = replace(camera, lens=replace(lens, kind="thin", aberrations=()))
    thin = collapse_to_thin_camera(plain, distance)
    bent = replace(thin.lens, kind=lens.kind, aberrations=lens.aberrations)
    return replace(thin, lens=bent)


def _coarsening_factor(shape: tuple[int, int]) -> int:
    """The smallest divisor of both sides that leaves few enough pixels."""
    common = math.gcd(*shape)
    divisors = [d for d in range(1, common + 1) if common % d == 0]
    few = [d for d in divisors if max(shape) / d <= _MOST_PIXELS]
    return few[0] if few else common


def _coarse_panel(panel: Panel, factor: int) -> Panel:
    """A panel of coarser pixels that does nothing of its own."""
    rows, columns = panel.shape
    return Panel(
        shape=(rows // factor, columns // factor),
        pitch=panel.pitch * factor,
        fill_factor=1.0,
        levels=panel.levels,
        max_phase=panel.max_phase,
        unmodulated=0.0,
    )


def _block_average(
    phase: torch.Tensor, amplitude: torch.Tensor | None, factor: int
) -> torch.Tensor:
    """The mean light of blocks of pixels, complex128."""
    phase = phase.to(torch.float64)
    wave = torch.polar(torch.ones_like(phase) if amplitude is None else amplitude, phase)
    rows, columns = phase.shape
    blocks = wave.reshape(rows // factor, factor, columns // factor, factor)
    return blocks.mean(dim=(1, 3))


def _window_vectors(
    registration: Registration, wavelength: float, corner: tuple[int, int], shape: tuple[int, int]
) -> torch.Tensor:
    """The gratings that send light to the window's pixels, (rows, columns, 2) of (y, x)."""
    y = corner[0] + np.arange(shape[0], dtype=np.float64)
    x = corner[1] + np.arange(shape[1], dtype=np.float64)
    pixels = np.stack(np.broadcast_arrays(y[:, None], x[None, :]), axis=-1)
    return torch.from_numpy(registration.to_vectors(pixels, wavelength))


def _vector_per_pixel(registration: Registration, wavelength: float) -> torch.Tensor:
    """By how much that grating changes from pixel to pixel, (2, 2)."""
    stretch = wavelength / registration.wavelength
    return torch.from_numpy(np.linalg.inv(registration.matrix * stretch))


def _grid(camera: Camera, wavelength: float, places: torch.Tensor) -> Plane:
    """Around the axis in the panel's axes, fine enough for cubics, and as wide as the window."""
    finer = math.ceil(_OVERSAMPLING * nyquist_samples_per_pixel(camera, wavelength))
    pitch = camera.sensor.pitch / finer
    reach = places.abs().amax(dim=(0, 1)) + _MARGIN * camera.sensor.pitch
    rows, columns = (2 * math.ceil(float(r) / pitch) + 1 for r in reach)
    return Plane((rows, columns), (pitch, pitch))


def _disc_and_pixel_transfer(grid: Plane, star: float, step: torch.Tensor) -> torch.Tensor:
    """Transfer function of the star's disc and of a turned pixel, on the grid's rfft2."""
    fy = torch.fft.fftfreq(grid.shape[0], grid.pitch[0], dtype=torch.float64)[:, None]
    fx = torch.fft.rfftfreq(grid.shape[1], grid.pitch[1], dtype=torch.float64)[None, :]
    argument = math.pi * star * torch.hypot(fy, fx)
    safe = torch.where(argument > 0, argument, torch.ones_like(argument))
    disc = torch.where(argument > 0, 2 * torch.special.bessel_j1(safe) / safe, 1.0)
    pixel = torch.sinc(fy * step[0, 0] + fx * step[1, 0]) * torch.sinc(
        fy * step[0, 1] + fx * step[1, 1]
    )
    return disc * pixel
