"""The optics behind a pattern for its design, and where light and OTF are sampled."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch

from optics.camera import Camera
from optics.camera.pupil import pupil_amplitude, require_valid_source
from optics.validation import as_number, require_count, require_positive

WINDOW_REACH = 450
"""Sensor pixels from the middle of the PSF to the border of the window whose light counts, by
default. A panel of 1920 pixels of 8 µm before a lens of 100 mm spreads a point at half a metre over
445 pixels of 3.45 µm to each side where it is focused at infinity."""

# Share by which the light's samples may lie closer than the sensor's pixels, so that fast
# transforms fit. Measured: .3 % closer changes the criterion of ring patterns by .01 dB.
_MOST_FINER = 0.01


@dataclass(frozen=True)
class TransferDesign:
    """The optics between a pattern and a picture's frequencies.

    The panel stands at the lens. Its pixels are points here; their finite size is known as an
    envelope over the sensor. A pattern's light is sampled at the pixels' centres.

    Parameters
    ----------
    camera : Camera
        The camera; its lens has no aberrations, and its panel stands at the lens.
    wavelength : float
        Metres.
    size : int
        Pixels along each side of the periodic pictures, even.
    binning : int, optional
        Sensor pixels along each side of the squares that are averaged into a pixel of the
        pictures. The scene is taken to be constant within such a square.
    reach : int, optional
        Sensor pixels from the middle of the PSF to the border of the window whose light counts.
    fast : bool, optional
        Whether the light's samples may lie up to 1 % closer than the sensor's pixels, so that fast
        transforms fit. The frequencies stay those of the sensor.
    pixel_size : bool, optional
        Whether the envelope of the panel's pixels of finite size counts. With it, the light of the
        pixels' other orders is lost.

    Raises
    ------
    ValueError
        If the camera isn't one that this model covers, or a number is out of range.
    """

    camera: Camera
    wavelength: float
    size: int
    binning: int = 1
    reach: int = WINDOW_REACH
    fast: bool = True
    pixel_size: bool = False

    def __post_init__(self) -> None:
        require_valid_source(math.inf, self.wavelength)
        require_count("binning", self.binning)
        require_count("reach", self.reach)
        lens = self.camera.lens
        if not lens.has_quadratic_phase:
            raise ValueError("camera.lens has aberrations or isn't thin; design for a thin lens")
        if as_number(self.camera.separation):
            raise ValueError(
                f"camera.separation is {as_number(self.camera.separation):g} m; patterns are "
                "designed for a panel at the lens: set 0"
            )
        require_positive("camera.panel.pitch", self.camera.panel.pitch, "m")
        if 2 * self.reach + 1 > self.period:
            raise ValueError(
                f"reach is {self.reach} pixels; the panel's light repeats after {self.period:.0f}: "
                f"choose at most {math.floor((self.period - 1) / 2)}"
            )

    @property
    def scale(self) -> float:
        """Wavelength times distance from lens to sensor, square metres."""
        return self.wavelength * as_number(self.camera.lens.image_distance)

    @property
    def period(self) -> float:
        """Sensor pixels after which the light of a panel of points repeats."""
        return self.scale / (self.camera.panel.pitch * self.camera.sensor.pitch)

    @property
    def transform_length(self) -> int | None:
        """Samples in one period of the light for fast transforms; None if none is short enough.

        It is even and a product of small primes.
        """
        if not self.fast:
            return None
        least = math.ceil(self.period / 2 - 1e-9)
        for half in range(least, math.floor(self.period / 2 * (1 + _MOST_FINER)) + 1):
            # A number without prime factors above 7 divides a high power of their product.
            if pow(2 * 3 * 5 * 7, 64, half) == 0:
                return 2 * half
        return None

    @property
    def step(self) -> float:
        """Turns per panel pixel and sample of the light."""
        length = self.transform_length
        return 1 / length if length else 1 / self.period

    @property
    def samples_per_pixel(self) -> float:
        """Samples of the light per sensor pixel, 1 or a little more."""
        return 1 / (self.step * self.period)

    @property
    def sample_reach(self) -> int:
        """Samples of the light from the middle to the border of the window."""
        return round(self.reach * self.samples_per_pixel)

    def sample_positions(self) -> torch.Tensor:
        """Return the positions of the light's samples from the middle on, in sensor pixels."""
        index = torch.arange(self.sample_reach + 1, dtype=torch.float64)
        return index / self.samples_per_pixel

    def open_shares(self) -> torch.Tensor:
        """Return the share of each panel pixel that the stop leaves open, float64."""
        return pupil_amplitude(self.camera)

    def defocus_turns(self, dioptre: float, positions: torch.Tensor) -> torch.Tensor:
        """Return the defocus of an object at a depth over positions on one panel axis, in turns.

        The phase is pi / wavelength (D - D_focus) (y² + x²), so that it is a sum over both axes.
        """
        return self._beyond_focus(dioptre) / (2 * self.wavelength) * positions**2

    def _beyond_focus(self, dioptre: float) -> float:
        """Return how far a depth is from that in focus, dioptres."""
        return dioptre - 1 / as_number(self.camera.lens.focus_distance)

    def envelope(self) -> torch.Tensor:
        """Return the factor of panel pixels of finite size on the light, at one axis' samples.

        The factor of the light is the product of those of both axes. It is a squared sinc times
        the share of a pixel's side that is active.
        """
        positions = self.sample_positions()
        if not self.pixel_size:
            return torch.ones_like(positions)
        panel, sensor = self.camera.panel, self.camera.sensor
        width = panel.active_side * sensor.pitch / self.scale
        return torch.sinc(width * positions) ** 2 * (panel.active_side / panel.pitch)

    def sampled_shift(self, dioptre: float) -> float:
        """Return how far a quarter pattern's PSF lies from the middle of a pixel, in sensor pixels.

        A panel with an even number of pixels is symmetric about a point half a pitch before its
        origin pixel. Seen from there, the optical axis is displaced, and defocus moves the PSF by
        half a pitch times the image distance times D - D_focus, along both axes.
        """
        moved = 0.5 * self.camera.panel.pitch * as_number(self.camera.lens.image_distance)
        return -moved * self._beyond_focus(dioptre) / self.camera.sensor.pitch
