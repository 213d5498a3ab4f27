"""The PSF of a lens that looks the same in all directions around its axis."""

from __future__ import annotations

import math

import numpy as np
import scipy.special
import torch

from optics.accuracy import (
    FLOAT32_ARITHMETIC,
    FLOAT64_ARITHMETIC,
    Account,
    Budget,
    ErrorEstimate,
    MachineSpeed,
    ToleranceError,
    cheapest,
)
from optics.camera import Lens
from optics.edge import require_finite, rounded_up, tensors_inside
from optics.plane import Plane
from optics.pupil import defocus_curvature, paraxial_error, require_light
from optics.sensor import PIXEL_INTEGRATION_ERROR, PixelIntegration

_OVERSAMPLING = 2.0
"""Of the field along the radius, over its Nyquist rate."""

_RADIANS_PER_RING = 200.0

_PROBES = 64
_FLOOR = 10 * FLOAT64_ARITHMETIC


class AxialPSF:
    """The Fraunhofer integral of a circular stop, exact to the tolerance, sample by sample.

    Around the axis the two-dimensional integral (thesis Eq. 2.13) is a Hankel transform,

        U(s) = 2 pi integral of exp(i phase(r)) J0(2 pi r s / (wavelength z)) r dr,

    summed by Gauss-Legendre nodes on evenly spaced radii s. The field has no finer detail
    along s than the stop's diameter gives it, so a Kaiser-windowed sinc carries it to the
    radius of every sample (Kaiser 1974). The model is a thin lens, paraxial and scalar.

    lens: its stop is open from `obscuration` (share of the diameter) outwards. distance:
    metres from the object, math.inf allowed. wavelength: metres. pixels: of the sensor.
    integrate: whether the answer is the light on whole pixels, or the density of light at
    their centres times their area. tol: relative L2 error from sampling and arithmetic.

    Call with extra phases in radians at `radii` (metres in the pupil), or with nothing; the
    answer is a share of the light in the stop for each pixel. Differentiable in the phases.
    Raises ToleranceError with the floor.
    """

    def __init__(
        self,
        lens: Lens,
        distance: float,
        wavelength: float,
        pixels: Plane,
        *,
        obscuration: float = 0.0,
        integrate: bool = True,
        tol: float = 1e-3,
        budget: Budget | None = None,
    ) -> None:
        _require(distance, wavelength, obscuration, tol, integrate)
        asked = tol
        self._scale = wavelength * lens.image_distance
        cutoff = lens.stop_diameter / self._scale
        self._integral = PixelIntegration(pixels, cutoff) if integrate else None
        plane = self._integral.plane if self._integral else pixels
        tol -= PIXEL_INTEGRATION_ERROR if integrate else 0.0
        self._inner, self._outer = obscuration * lens.stop_diameter / 2, lens.stop_diameter / 2
        self._curvature = defocus_curvature(lens, distance, wavelength)
        y, x = plane.mesh()
        farthest = math.hypot(float(y.abs().max()), float(x.abs().max()))
        rings, nodes = self._enough_nodes(farthest, tol)
        reach = _reach(tol)
        budget = budget or Budget()

        def cost(radii: int) -> HankelMethod:
            return HankelMethod(
                rings * nodes,
                radii,
                farthest / self._spacing,
                reach,
                y.numel() * x.numel(),
                integrate,
            )

        # Before anything large is made: without the radii, it needs this at least.
        cheapest([cost(0)], budget, "a PSF by Hankel transform")
        radius, self._place = torch.unique(torch.hypot(y, x), return_inverse=True)
        method = cheapest([cost(radius.numel())], budget, "a PSF by Hankel transform")
        self.radii, weights = self._rule(rings, nodes)
        self._field = self._matrix(self.radii, weights, method.sums)
        self._taps, self._weights = self._interpolation(radius, reach)
        defocus = torch.from_numpy(self._curvature * self.radii.numpy() ** 2)
        self._wave = torch.polar(torch.ones_like(defocus), defocus.remainder(2 * math.pi))
        self.dtype = torch.float32 if tol >= 10 * FLOAT32_ARITHMETIC else torch.float64
        area = plane.pitch[0] * plane.pitch[1]
        self._share = area / (math.pi * (self._outer**2 - self._inner**2) * self._scale**2)
        self.account = Account(
            method=method.name,
            sampling=f"{rings * nodes} radii in the pupil, {method.sums} on the sensor",
            precision="float64",
            tol=asked,
            model=paraxial_error(lens),
            sampling_error=ErrorEstimate(
                self._probed_error(rings, nodes, radius, tol)
                + (PIXEL_INTEGRATION_ERROR if integrate else 0.0),
                "measured",
            ),
            arithmetic=ErrorEstimate(_FLOOR, "bound"),
            cpu_predicted=method.cpu_seconds(budget.speed),
            bytes=method.bytes,
        )

    @property
    def _spacing(self) -> float:
        """Metres between the radii on which the field is summed."""
        return self._scale / (2 * _OVERSAMPLING * self._outer)

    def _enough_nodes(self, farthest: float, tol: float) -> tuple[int, int]:
        """Rings and Gauss-Legendre nodes in each, for the fastest phase.

        Half a node a radian, and some to spare; rings, because rules of thousands of nodes
        take longer to find than to use.
        """
        slope = 2 * abs(self._curvature) * self._outer + 2 * math.pi * farthest / self._scale
        turn = (self._outer - self._inner) / 2 * slope
        rings = max(1, math.ceil(turn / _RADIANS_PER_RING))
        turn /= rings
        nodes = math.ceil(turn / 2 + 2.5 * turn ** (1 / 3) - 1.5 * math.log10(tol)) + 8
        return rings, nodes

    def _rule(self, rings: int, nodes: int) -> tuple[torch.Tensor, torch.Tensor]:
        """Radii in the pupil, and the weights of an integral over the open area."""
        points, weights = np.polynomial.legendre.leggauss(nodes)
        edges = np.linspace(self._inner, self._outer, rings + 1)
        half = (self._outer - self._inner) / rings / 2
        radii = (edges[:-1, None] + half * (points + 1)).ravel()
        area = 2 * np.pi * half * np.tile(weights, rings) * radii
        return torch.from_numpy(radii), torch.from_numpy(area)

    def _matrix(self, radii: torch.Tensor, weights: torch.Tensor, samples: int) -> torch.Tensor:
        sensor = np.arange(samples) * self._spacing
        bessel = scipy.special.j0(2 * np.pi / self._scale * np.outer(sensor, radii.numpy()))
        return torch.from_numpy(bessel) * weights

    def _interpolation(self, radius: torch.Tensor, reach: int) -> tuple[torch.Tensor, torch.Tensor]:
        """Which radii the field at each radius is made of, and their weights; it is even."""
        position = radius.numpy() / self._spacing
        first = np.floor(position).astype(np.int64) - reach + 1
        taps = first[:, None] + np.arange(2 * reach)
        away = position[:, None] - taps
        window = np.sqrt(np.clip(1 - (away / reach) ** 2, 0, None))
        beta = math.pi * reach * (1 - 1 / _OVERSAMPLING)
        kernel = np.sinc(away) * np.i0(beta * window) / np.i0(beta)
        return torch.from_numpy(np.abs(taps)), torch.from_numpy(kernel)

    def _probed_error(self, rings: int, nodes: int, radius: torch.Tensor, tol: float) -> float:
        """The answer against more nodes and no interpolation, on some of its radii."""
        chosen = torch.linspace(0, radius.numel() - 1, min(_PROBES, radius.numel())).long()
        radii, weights = self._rule(rings + 1, nodes + nodes // 2)
        bessel = scipy.special.j0(
            2 * np.pi / self._scale * np.outer(radius[chosen].numpy(), radii.numpy())
        )
        wave = np.exp(1j * self._curvature * radii.numpy() ** 2)
        truth = np.abs((bessel * weights.numpy()) @ wave) ** 2
        value = self._intensity(self._wave)[chosen].numpy()
        # Each radius counts as often as there are samples on it.
        counts = torch.bincount(self._place.ravel(), minlength=radius.numel())[chosen].numpy()
        error = math.sqrt(float((counts * (value - truth) ** 2).sum() / (counts * truth**2).sum()))
        if not error + _FLOOR <= tol:
            raise ToleranceError(
                f"tol {tol:g} can't be kept; ask for tol {rounded_up(1.2 * error + _FLOOR)} or more"
            )
        return error

    def _intensity(self, wave: torch.Tensor) -> torch.Tensor:
        """On every radius of the samples."""
        parts = torch.view_as_real(wave).to(torch.float64)
        field = self._field @ parts
        at_samples = (field[self._taps] * self._weights[..., None]).sum(1)
        return at_samples[:, 0] ** 2 + at_samples[:, 1] ** 2

    @tensors_inside
    def __call__(self, phase: torch.Tensor | None = None) -> torch.Tensor:
        wave = self._wave
        if phase is not None:
            if phase.shape != self.radii.shape:
                raise ValueError(
                    f"phase is {tuple(phase.shape)}; give one for each of the "
                    f"{self.radii.numel()} radii"
                )
            require_finite("phase", phase)
            turn = phase.to(torch.float64)
            wave = wave * torch.polar(torch.ones_like(turn), turn)
        light = (self._intensity(wave) * self._share)[self._place]
        return (self._integral(light) if self._integral else light).to(self.dtype)


class HankelMethod:
    """What a Hankel transform costs.

    nodes: in the pupil. radii: different ones among the samples, and the farthest in units
    of the spacing on which the field is summed. reach: of the interpolation. samples: on
    the sensor; integrated: whether they are summed into whole pixels.
    """

    name = "Hankel transform"

    def __init__(
        self,
        nodes: int,
        radii: int,
        farthest: float,
        reach: int,
        samples: int,
        integrated: bool,
    ) -> None:
        self._nodes, self._radii, self._reach = nodes, radii, reach
        self._samples, self._integrated = samples, integrated
        self.sums = math.ceil(farthest) + reach + 2

    @property
    def bytes(self) -> int:
        return 8 * (self.sums * self._nodes + 8 * self._radii * self._reach + 6 * self._samples)

    def cpu_seconds(self, speed: MachineSpeed) -> float:
        sums = 2 * self.sums * self._nodes * speed.multiply_add * speed.double_factor
        interpolation = 2 * self._radii * self._reach * speed.gather
        pixels = self._samples * speed.pixel_sample if self._integrated else 0.0
        return sums + interpolation + pixels


def _reach(tol: float) -> int:
    """Samples on either side that the interpolation needs: Kaiser's formula, in decibels."""
    attenuation = 40 - 20 * math.log10(tol)
    return math.ceil((attenuation - 8) / (2 * 2.285 * 2 * math.pi * (1 - 1 / _OVERSAMPLING))) + 2


def _require(
    distance: float, wavelength: float, obscuration: float, tol: float, integrate: bool
) -> None:
    require_light(distance, wavelength)
    if not 0 <= obscuration < 1:
        raise ValueError(f"obscuration is {obscuration:g}; it must lie from 0 to below 1")
    floor = _FLOOR + (PIXEL_INTEGRATION_ERROR if integrate else 0.0)
    if not tol >= 2 * floor:
        raise ToleranceError(f"tol {tol:g} can't be kept; ask for tol {2 * floor:g} or more")
