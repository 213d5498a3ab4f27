"""The picture of a star through panel and lens, on sensor pixels rotated to the panel."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch

from optics.camera import Camera
from optics.camera.pupil import open_pupil_radius, pupil_amplitude
from optics.measuring.registration import Registration
from optics.plane import Plane
from optics.psf import PSFOperator, nyquist_samples_per_pixel
from optics.psf.chain_collapsed import collapse_to_thin_camera
from optics.slm import Panel
from optics.validation import require_wavelength

_MOST_PIXELS = 300  # a side of the coarser panel: enough because wavefronts are smooth; chosen
_OVERSAMPLING = 3.0  # samples over the fewest that resolve the PSF, for cubic interpolation; chosen
# Forces double precision: rounding would dominate the derivatives before a fit converges
_TOL = 1e-6
_MARGIN = 4  # sensor pixels around the window; chosen


class StarModel:
    """Computes the share of a star's light on each pixel of a window, for several panel patterns.

    camera: its panel, lens and stop are used; the panel's flatness is left out, because it is part
        of the wavefront to be fitted.
    phases: (rows, columns) radians on the panel as it really displays them, one for each pattern.
    registration: that of panel and sensor.
    corner: (row, column) of the window's first pixel.
    shape: that of the window.
    diameter, distance: those of the star, metres.
    unmodulated: unmodulated share of the light.

    Call the model with tensors: the optical path on `plane` in metres, (rows, columns); the star's
    position (y, x) relative to the registration's centre in pixels; and the light's amplitude on
    `plane` relative to the camera's. The result is (patterns, rows, columns) and differentiable in
    all of them.
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
        require_wavelength("wavelength", wavelength)
        self.wavelength, self.pattern_count = wavelength, len(phases)
        image = diameter * camera.magnification(distance)
        camera = _with_lens_at_panel(camera, distance)
        panel = camera.panel
        self.radius = open_pupil_radius(camera)
        # The smallest common divisor of the panel's sides that leaves few enough pixels.
        common, longest = math.gcd(*panel.shape), max(panel.shape)
        divisors = (d for d in range(1, common + 1) if common % d == 0)
        factor = next((d for d in divisors if longest / d <= _MOST_PIXELS), common)
        coarse = Panel(  # of perfect pixels
            shape=(panel.shape[0] // factor, panel.shape[1] // factor),
            pitch=panel.pitch * factor,
            fill_factor=1.0,
            levels=panel.levels,
            max_phase=panel.max_phase,
            unmodulated=0.0,
        )
        behind = replace(camera, panel=coarse)
        self.plane = coarse.plane
        self.light_on_panel = pupil_amplitude(behind)
        self._unmodulated = unmodulated
        lit = panel.illumination
        amplitude = None if lit is None else lit.at_pixels(panel).sqrt()
        self._modulations = [_block_average(phase, amplitude, factor) for phase in phases]
        self._neutral_modulation = _block_average(torch.zeros_like(phases[0]), amplitude, factor)
        scale = wavelength * camera.lens.image_distance
        pixels = np.stack(list(np.indices(shape, dtype=np.float64)), axis=-1) + corner
        vectors = torch.from_numpy(registration.to_vectors(pixels, wavelength))
        self._pixel_positions = vectors * scale / panel.pitch
        stretch = wavelength / registration.wavelength
        per_pixel = torch.from_numpy(np.linalg.inv(registration.matrix * stretch))
        self._position_per_pixel = per_pixel * scale / panel.pitch
        # A grid along the panel's axes over the window, fine enough for cubic interpolation.
        finer = math.ceil(_OVERSAMPLING * nyquist_samples_per_pixel(camera, wavelength))
        pitch = camera.sensor.pitch / finer
        reach = self._pixel_positions.abs().amax(dim=(0, 1)) + _MARGIN * camera.sensor.pitch
        rows, columns = (2 * math.ceil(float(r) / pitch) + 1 for r in reach)
        self._grid = Plane((rows, columns), (pitch, pitch))
        self._operator = PSFOperator(
            behind, distance, wavelength, self._grid, integrate=False, unmodulated=0.0, tol=_TOL
        )
        self._blur_transfer = _disc_and_pixel_transfer(self._grid, image, self._position_per_pixel)

    def __call__(
        self, path: torch.Tensor, place: torch.Tensor, amplitude: torch.Tensor | float = 1.0
    ) -> torch.Tensor:
        phase = 2 * math.pi / self.wavelength * path
        shares = [self._operator(phase, wave * amplitude) for wave in self._modulations]
        light = torch.stack(shares).to(torch.float64)
        if self._unmodulated:
            # Unmodulated light has the polarisation that the pattern doesn't change.
            straight = self._operator(phase, self._neutral_modulation * amplitude).to(torch.float64)
            light = (1 - self._unmodulated) * light + self._unmodulated * straight
        spectrum = torch.fft.rfft2(light) * self._blur_transfer
        light = torch.fft.irfft2(spectrum, s=self._grid.shape)
        area = abs(float(torch.linalg.det(self._position_per_pixel))) / math.prod(self._grid.pitch)
        return self._sample_pixels(light, place) * area

    def _sample_pixels(self, light: torch.Tensor, place: torch.Tensor) -> torch.Tensor:
        """Sample the light at the sensor pixels by cubic interpolation."""
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
    """Return an equivalent camera with its lens at the panel.

    The equivalent follows from the ray matrix and the stop's shadow. The lens' aberrations are
    mapped back to the panel along the rays. The light that the stop's edge scatters is left out: it
    is far below the noise of the pictures, and a fit computes hundreds of them. A camera without
    separation is returned unchanged.
    """
    if not camera.separation:
        return camera
    lens = camera.lens
    plain = replace(camera, lens=replace(lens, kind="thin", aberrations=()))
    thin = collapse_to_thin_camera(plain, distance)
    bent = replace(thin.lens, kind=lens.kind, aberrations=lens.aberrations)
    return replace(thin, lens=bent)


def _block_average(
    phase: torch.Tensor, amplitude: torch.Tensor | None, factor: int
) -> torch.Tensor:
    """Compute the mean field of blocks of panel pixels, complex128."""
    phase = phase.to(torch.float64)
    wave = torch.polar(torch.ones_like(phase) if amplitude is None else amplitude, phase)
    rows, columns = phase.shape
    blocks = wave.reshape(rows // factor, factor, columns // factor, factor)
    return blocks.mean(dim=(1, 3))


def _disc_and_pixel_transfer(grid: Plane, star: float, step: torch.Tensor) -> torch.Tensor:
    """Compute the transfer function of the star's disc and of a rotated pixel, laid out as rfft2's.

    star: diameter of the disc, metres.
    """
    fy = torch.fft.fftfreq(grid.shape[0], grid.pitch[0], dtype=torch.float64)[:, None]
    fx = torch.fft.rfftfreq(grid.shape[1], grid.pitch[1], dtype=torch.float64)[None, :]
    argument = math.pi * star * torch.hypot(fy, fx)
    safe = torch.where(argument > 0, argument, torch.ones_like(argument))
    disc = torch.where(argument > 0, 2 * torch.special.bessel_j1(safe) / safe, 1.0)
    pixel = torch.sinc(fy * step[0, 0] + fx * step[1, 0]) * torch.sinc(
        fy * step[0, 1] + fx * step[1, 1]
    )
    return disc * pixel
