"""A panel (SLM) as data: its pixels, its phase by grey level, and its imperfections."""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch

from optics.plane import Plane
from optics.validation import (
    require_amount,
    require_finite,
    require_positive,
    require_share,
    require_size,
    require_unmasked,
    require_wavelength,
)


def as_float64(values: Any) -> torch.Tensor:
    """Convert numbers of any kind to a float64 tensor. Tensors keep their derivatives."""
    if isinstance(values, torch.Tensor):
        return values.to(torch.float64)
    require_unmasked(values)
    # Arrays from files may be read-only or of another byte order, so the values are copied.
    return torch.from_numpy(np.array(values, dtype=np.float64))


def neighbouring_cells(cells: int, pixels: int) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Find the map cells before and behind each pixel along an axis, and the pixel's position.

    The position is the share, from 0 to 1, of the way between the centres of the two cells, of
    equally wide ones that cover all pixels. A pixel beyond the outermost centre gets the outermost
    cell alone. Returns two tensors of indices, int64, and the shares, float64, each (pixels,).
    """
    centre = (torch.arange(pixels, dtype=torch.float64) + 0.5) * (cells / pixels) - 0.5
    centre = centre.clamp(0, cells - 1)
    before = centre.floor().to(torch.int64)
    behind = (before + 1).clamp(max=cells - 1)
    return before, behind, centre - before


@dataclass(frozen=True, eq=False)
class PanelMap:
    """Map of a quantity over a panel, such as its flatness or its illumination.

    The values are those of equal cells that cover the panel. The cells may be coarser than the
    pixels.

    Parameters
    ----------
    values : torch.Tensor or numpy.ndarray
        (rows, columns) of cells; kept as a float64 tensor.

    Raises
    ------
    ValueError
        If the values are empty, not finite, or have another number of axes than two.
    """

    values: torch.Tensor

    def __post_init__(self) -> None:
        values = as_float64(self.values)
        if values.ndim != 2 or not values.numel():
            raise ValueError(
                f"a map's values are {tuple(values.shape)}; they need rows and columns"
            )
        require_finite("a map", values)
        object.__setattr__(self, "values", values)

    def at_pixels(self, panel: Panel) -> torch.Tensor:
        """Interpolate the map at the pixels, (rows, columns) float64.

        The values are bilinear between the cells' centres and constant beyond the outermost ones.
        """
        values = self.values
        for axis, pixels in enumerate(panel.shape):
            if values.shape[axis] != pixels:
                before, behind, share = neighbouring_cells(values.shape[axis], pixels)
                low, high = values.index_select(axis, before), values.index_select(axis, behind)
                values = low + (share if axis else share[:, None]) * (high - low)
        return values


@dataclass(frozen=True, eq=False)
class PhaseResponse:
    """Phase by grey level, at wavelengths and in regions of a panel.

    Between wavelengths the shares are interpolated linearly in 1/wavelength², the variable in which
    a liquid crystal's dispersion is smoothest (see `max_phase`), and between the regions' centres
    bilinearly, so that there are no seams. Beyond the outermost ones they are constant.

    Parameters
    ----------
    wavelengths, shares : tuple of float, torch.Tensor or numpy.ndarray
        Metres, all different, and shares of the panel's highest phase, (wavelengths, region rows,
        region columns, levels); kept as a float64 tensor. Regions are equally large and cover the
        panel. A share may exceed 1, where a panel's range is larger than its table says. The first
        share needn't be 0.

    Raises
    ------
    ValueError
        If shares aren't finite, fall from one level to the next, don't rise at all, or have another
        shape, or if wavelengths aren't positive or occur twice.
    """

    wavelengths: tuple[float, ...]
    shares: torch.Tensor

    def __post_init__(self) -> None:
        shares = as_float64(self.shares)
        wavelengths = tuple(float(w) for w in self.wavelengths)
        for wavelength in wavelengths:
            require_wavelength("a response's wavelength", wavelength)
        if len(set(wavelengths)) != len(wavelengths):
            raise ValueError("a response's wavelengths must differ; give each once")
        if shares.ndim != 4 or shares.shape[0] != len(wavelengths) or not shares.numel():
            raise ValueError(
                f"a response's shares are {tuple(shares.shape)}; they need wavelengths "
                f"({len(wavelengths)}), region rows, region columns and levels"
            )
        require_finite("a response", shares)
        falls = (shares.detach().diff(dim=-1) < 0).nonzero()
        if len(falls):
            w, row, column, level = falls[0].tolist()
            raise ValueError(
                f"the response falls from level {level} to {level + 1} at "
                f"{wavelengths[w] * 1e9:.0f} nm in region ({row}, {column}), and {len(falls)} "
                "times in all; the phase must grow with the level: smooth the measurement"
            )
        if shares.shape[-1] < 2 or not bool((shares[..., -1] > shares[..., 0]).all()):
            raise ValueError("the response doesn't rise from its first level to its last; it must")
        object.__setattr__(self, "shares", shares)
        object.__setattr__(self, "wavelengths", wavelengths)

    @staticmethod
    def from_curve(wavelength: float, shares: Any) -> PhaseResponse:
        """Build a response of one curve of shares, (levels,), for all pixels and wavelengths."""
        return PhaseResponse((wavelength,), as_float64(shares)[None, None, None])

    @staticmethod
    def from_phases(panel: Panel, wavelengths: Sequence[float], phases: Any) -> PhaseResponse:
        """Build a response from measured phases of grey levels, relative to the panel's highest.

        They are in radians, (wavelengths, levels) or (wavelengths, region rows, region columns,
        levels); for another shape, ValueError is raised.
        """
        phases = as_float64(phases)
        if phases.ndim == 2:
            phases = phases[:, None, None]
        if phases.ndim != 4 or phases.shape[0] != len(wavelengths):
            raise ValueError(
                f"phases are {tuple(phases.shape)}; they need wavelengths ({len(wavelengths)}) "
                "and levels, with region rows and columns between them or without"
            )
        highest = torch.tensor([max_phase(panel, w) for w in wavelengths], dtype=torch.float64)
        return PhaseResponse(tuple(wavelengths), phases / highest[:, None, None, None])

    @property
    def levels(self) -> int:
        return self.shares.shape[-1]

    @property
    def regions(self) -> tuple[int, int]:
        """Numbers of rows and columns of regions."""
        return self.shares.shape[1], self.shares.shape[2]

    def at(self, wavelength: float) -> torch.Tensor:
        """Interpolate the shares at a wavelength, (region rows, region columns, levels)."""
        order = sorted(range(len(self.wavelengths)), key=self.wavelengths.__getitem__)
        known = [self.wavelengths[k] for k in order]
        if wavelength <= known[0]:
            return self.shares[order[0]]
        for one, other, low, high in zip(order, order[1:], known, known[1:], strict=False):
            if wavelength <= high:
                share = (low**-2 - wavelength**-2) / (low**-2 - high**-2)
                return torch.lerp(self.shares[one], self.shares[other], share)
        return self.shares[order[-1]]


_MOST_PIXELS = 100_000_000  # a pattern takes 0.8 GB; chosen: twelve times a panel of 4K


@dataclass(frozen=True)
class Panel:
    """A phase-only liquid-crystal modulator.

    The defaults are the thesis' Tables 2.1 and 2.2, for HOLOEYE's PLUTO-VIS-006-A. The effects from
    `response` on are off by default, and then cost no time.

    Parameters
    ----------
    shape, pitch : tuple of int, float, optional
        (rows, columns) of pixels, and metres between them.
    fill_factor : float, optional
        Share of a pixel's area that modulates, above 0 and up to 1.
    levels : int, optional
        The number of grey levels, 2 to 256.
    max_phase : tuple of (float, float), optional
        Pairs of a wavelength in metres and the phase in radians at the highest grey level.
    unmodulated, reflectivity : float, optional
        Share of the light that leaves the panel unmodulated, and of the incident that leaves it.
    settling, frame_rate : float, optional
        Seconds from a new frame until its phase is settled, and rate in Hz of videos.
    response, response_time : PhaseResponse, float, optional
        Shares of the highest phase by grey level, linear by default; time constant of the liquid
        crystal in seconds: with 0 the phase settles at once.
    coupling : float, optional
        Metres, the standard deviation of the Gaussian by which fringing fields blur the phase; up
        to one pitch.
    flicker, jitter : float, optional
        Amplitude of the phase's ripple, as a share of the phase; root mean square of the
        independent random phase errors of the pixels, radians.
    front_reflection, gap_reflection : float, optional
        Share of the light that the cover glass reflects, a part of `reflectivity`; amplitude
        reflectance of the frame between the pixels, relative to the pixels'.
    flatness, illumination : PanelMap, optional
        Optical path in metres that the panel adds to the pattern's; irradiance, in any unit.

    Raises
    ------
    ValueError
        If a value is out of range, or values contradict each other.
    """

    shape: tuple[int, int] = (1080, 1920)
    pitch: float = 8e-6
    fill_factor: float = 0.87
    levels: int = 256
    max_phase: tuple[tuple[float, float], ...] = (
        (452e-9, 9.0 * math.pi),
        (532e-9, 6.7 * math.pi),
        (633e-9, 5.4 * math.pi),
    )
    unmodulated: float = 0.05
    reflectivity: float = 0.6
    settling: float = 0.05
    frame_rate: float = 60.0
    response: PhaseResponse | None = None
    response_time: float = 0.0
    coupling: float = 0.0
    flicker: float = 0.0
    jitter: float = 0.0
    front_reflection: float = 0.0
    gap_reflection: float = 0.0
    flatness: PanelMap | None = None
    illumination: PanelMap | None = None

    def __post_init__(self) -> None:
        require_positive("pitch", self.pitch, "m")
        require_size("panel_pitch", "pitch", self.pitch)
        require_positive("fill_factor", self.fill_factor, "")
        require_positive("frame_rate", self.frame_rate, "Hz")
        for name in (
            "fill_factor", "unmodulated", "reflectivity", "flicker", "front_reflection",
            "gap_reflection",
        ):  # fmt: skip
            require_share(name, getattr(self, name))
        require_size("fill_factor", "fill_factor", self.fill_factor)
        for name, unit in (("response_time", "s"), ("coupling", "m"), ("jitter", "rad")):
            require_amount(name, getattr(self, name), unit)
        if not 2 <= self.levels <= 256:
            raise ValueError(f"levels is {self.levels}; a panel has at least 2 and at most 256")
        if not self.max_phase:
            raise ValueError("max_phase is empty; give the phase range at one wavelength or more")
        for wavelength, phase in self.max_phase:
            require_positive("max_phase's wavelength", wavelength, "m")
            require_positive("max_phase's phase", phase, "rad")
        known = [wavelength for wavelength, _ in self.max_phase]
        for wavelength in known:
            if known.count(wavelength) > 1:
                raise ValueError(
                    f"max_phase has {wavelength * 1e9:g} nm more than once; give it once"
                )
        self._require_consistent_effects()
        Plane(self.shape, (self.pitch, self.pitch))
        if math.prod(self.shape) > _MOST_PIXELS:
            raise ValueError(
                f"shape {self.shape} has {math.prod(self.shape):.3g} pixels; give (rows, columns) "
                f"of {_MOST_PIXELS:g} pixels at most"
            )

    def _require_consistent_effects(self) -> None:
        """Raise ValueError if values contradict each other."""
        if self.coupling > self.pitch:
            raise ValueError(
                f"coupling is {self.coupling:g} m; fringing fields reach over a pixel's pitch, "
                f"{self.pitch:g} m, at most"
            )
        if self.front_reflection > self.reflectivity:
            raise ValueError(
                f"front_reflection is {self.front_reflection:g}; it is a part of the "
                f"reflectivity, {self.reflectivity:g}, and can't be more"
            )
        if self.response is not None and self.response.levels != self.levels:
            raise ValueError(
                f"response has {self.response.levels} levels and the panel {self.levels}; "
                "give a response of all the panel's levels"
            )
        light = self.illumination
        if light is not None and not (light.values.min() >= 0 and light.values.max() > 0):
            raise ValueError(
                f"illumination goes from {float(light.values.min()):g} to "
                f"{float(light.values.max()):g}; it can't be negative, nor zero everywhere"
            )

    @property
    def plane(self) -> Plane:
        """Plane of the pixels, centred on the axis."""
        return Plane(self.shape, (self.pitch, self.pitch))

    @property
    def active_side(self) -> float:
        """Side of the active square in each pixel, in metres."""
        return math.sqrt(self.fill_factor) * self.pitch


def gap_amplitude(panel: Panel) -> float:
    """Compute the amplitude that the gap between pixels adds to a pixel's field, relative to it.

    The gap is a frame with (1 - F) / F of the active area of a pixel with fill factor F. Its light
    adds coherently. The amplitude is exact on the axis. A PSFOperator spreads this light like that
    of the pixel's active square, although a frame spreads it differently. At a share u of the way
    to the panel's first diffraction order, along an axis, the error of the field is gap_reflection
    times (sinc(u) - sinc(u sqrt(F))) / F. For F = 0.87 this factor is 0.015 at a quarter and 0.05
    at half of the way. In the first order itself a bright gap would weaken the light, while it
    strengthens the light in this model.
    """
    return panel.gap_reflection * (1 - panel.fill_factor) / panel.fill_factor


def max_gap_power(panel: Panel) -> float:
    """Return the largest power of the field with gaps, over that of the pixels alone."""
    return (1 + gap_amplitude(panel)) ** 2


def max_phase(panel: Panel, wavelength: float) -> float:
    """Compute the phase at the highest grey level, at a wavelength, in radians.

    The optical path difference of a nematic cell follows its birefringence, which the extended
    Cauchy equation A + B/wavelength² + C/wavelength⁴ describes across the visible. As many terms
    are used as the panel has tabulated wavelengths, at most three.

    Parameters
    ----------
    panel, wavelength : Panel, float
        The panel, and metres: 0.9 times its shortest tabulated wavelength to 1.15 times the last.

    Returns
    -------
    float
        Radians.

    Raises
    ------
    ValueError
        If the wavelength is outside that range, or the fitted optical path is not positive there.

    References
    ----------
    J. Li and S.-T. Wu, J. Appl. Phys. 95, 896, 2004, doi 10.1063/1.1635971.
    """
    table = panel.max_phase
    known = [w for w, _ in table]
    if 0 < wavelength < math.inf:
        require_wavelength("wavelength", wavelength)
    low, high = 0.9 * min(known), 1.15 * max(known)
    if not low <= wavelength <= high:
        raise ValueError(
            f"wavelength {wavelength * 1e9:.0f} nm is outside the panel's table; "
            f"choose {low * 1e9:.0f} to {high * 1e9:.0f} nm, or add its phase range there"
        )
    unit, coefficients = _cauchy(table)
    path = float(np.polyval(coefficients, (unit / wavelength) ** 2))
    if path <= 0:
        raise ValueError(
            f"max_phase leaves no phase at {wavelength * 1e9:.0f} nm: the path through its "
            "entries is no dispersion of a liquid crystal; check them, or add one there"
        )
    return path / wavelength


@functools.lru_cache(maxsize=64)
def _cauchy(table: tuple[tuple[float, float], ...]) -> tuple[float, tuple[float, ...]]:
    """Fit the Cauchy equation of the liquid crystal's path: unit and coefficients.

    The coefficients are those of the powers of (unit / wavelength)².
    """
    known, path = np.array([(w, phase * w) for w, phase in sorted(table)]).T
    unit = float(known.mean())
    coefficients = np.polyfit((unit / known) ** 2, path, min(len(table), 3) - 1)
    return unit, tuple(coefficients.tolist())
