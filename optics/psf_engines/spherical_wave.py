"""Compute a point's exact spherical wave over the panel, relative to its parabola."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import cast

import torch

from optics.pupil import Scalar
from optics.validation import as_number, to_plain_numbers


@dataclass(frozen=True)
class SphericalWaveCorrection:
    """Computes the spherical wave of thesis Eq. 5.1 and 5.2, divided by its paraxial parabola.

    distance: metres from the object to the panel's plane, math.inf allowed. chief_ray_sines: sines
    (y, x) of the chief ray's direction, which are field over image distance. centre: metres (y, x)
    where the chief ray meets the panel.

    Let v = 1 / distance be the vergence, r0 the distance from the point to the centre, s the
    chief_ray_sines, w = 1 / r0 = v sqrt(1 - s²), and p a position relative to the centre. The
    sphere's path is r = r0 q with q² = 1 + 2 w s.p + w² p², and the parabola's path is
    s.p + v p² / 2. Their difference r - r0 - s.p - v p² / 2 is computed without subtracting large
    numbers, so that a far object is the limit of a near one. The amplitude is 1 / r relative to the
    distance along the axis, 1 / (v r).
    """

    distance: Scalar
    wavelength: Scalar
    chief_ray_sines: tuple[Scalar, Scalar]
    centre: tuple[Scalar, Scalar]

    def __post_init__(self) -> None:
        if not math.hypot(*map(as_number, self.chief_ray_sines)) < 1:
            raise ValueError(
                "field lies at a sine of "
                f"{math.hypot(*map(as_number, self.chief_ray_sines)):.3g} from the axis; "
                "give a point nearer to it"
            )

    def wave_factor(self, y: torch.Tensor, x: torch.Tensor) -> torch.Tensor:
        """Return the spherical wave's complex factor for the PSF engine at positions (y, x).

        The factor is complex128. y, x: metres on the panel, tensors that broadcast.
        """
        path, amplitude = self._path_and_amplitude(y, x)
        return torch.polar(amplitude, 2 * math.pi / self.wavelength * path)

    def phase(self, y: torch.Tensor, x: torch.Tensor) -> torch.Tensor:
        """Return the phase of the spherical wave's factor for the PSF engine, radians, float64."""
        return 2 * math.pi / self.wavelength * self._path_and_amplitude(y, x)[0]

    def _path_and_amplitude(
        self, y: torch.Tensor, x: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor]:
        v, (sy, sx) = 1 / self.distance, self.chief_ray_sines
        y, x = y - self.centre[0], x - self.centre[1]
        sine2 = sy**2 + sx**2
        cosine = (1 - sine2) ** 0.5
        w = v * cosine
        along, p2 = sy * y + sx * x, y**2 + x**2
        beyond = 2 * w * along + w**2 * p2
        q = torch.sqrt(1 + beyond)
        tilted = -along * (2 * along + w * p2) * w / (1 + q) ** 2
        bent = -2 * sine2 / (1 + cosine) - beyond / (1 + q)
        return tilted + v * p2 * bent / (2 * (1 + q)), cosine / q

    def phase_gradient(
        self, y: torch.Tensor, x: torch.Tensor, spacing: float
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Return the spherical wave's phase slopes along y and x for the PSF engine, cycles/m.

        The phase is that of wave_factor(). Each slope is the difference over `spacing` metres
        around a position.
        """
        ends = [
            (
                self._path_and_amplitude(y + h * a, x + h * b)[0]
                - self._path_and_amplitude(y - h * a, x - h * b)[0]
            )
            for h, a, b in ((spacing / 2, 1, 0), (spacing / 2, 0, 1))
        ]
        return ends[0] / (spacing * self.wavelength), ends[1] / (spacing * self.wavelength)

    def largest_phase_slope(self, half_diagonal: float) -> float:
        """Return the steepest phase slope of the PSF engine's spherical wave on a panel, rad/m.

        half_diagonal: metres from the panel's middle to its corner.
        """
        line = torch.linspace(-half_diagonal, half_diagonal, 65, dtype=torch.float64)
        path, _ = self.numeric._path_and_amplitude(line[:, None], line[None, :])
        step = max(float(path.diff(dim=axis).abs().max()) for axis in (0, 1))
        return (
            2
            * math.sqrt(2)
            * math.pi
            / as_number(self.wavelength)
            * step
            / (2 * half_diagonal / 64)
        )

    @property
    def numeric(self) -> SphericalWaveCorrection:
        """The PSF engine's spherical wave in plain numbers, without derivatives."""
        return cast(SphericalWaveCorrection, to_plain_numbers(self))
