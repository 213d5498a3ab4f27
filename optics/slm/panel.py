"""Describe a panel (SLM) as data: its pixels, its phase range, and its imperfections."""

from __future__ import annotations

import math
from dataclasses import dataclass

from optics.plane import Plane
from optics.slm.maps import PanelMap
from optics.slm.response import PhaseResponse
from optics.validation import require_positive, require_share, require_size

_MOST_PIXELS = 100_000_000
"""Pixels of a panel, whose pattern alone takes 0.8 GB. Chosen: twelve times a panel of 4K."""


@dataclass(frozen=True)
class Panel:
    """Describe a panel, a phase-only liquid-crystal modulator.

    The defaults are the thesis' Tables 2.1 and 2.2, for HOLOEYE's PLUTO-VIS-006-A. The effects from
    `response` on are off by default, and then cost no time.

    Parameters
    ----------
    shape : tuple of int, optional
        (rows, columns) of pixels.
    pitch : float, optional
        Metres between pixels.
    fill_factor : float, optional
        Share of a pixel's area that modulates, above 0 and up to 1.
    levels : int, optional
        The number of grey levels, 2 to 256.
    max_phase : tuple of (float, float), optional
        Pairs of a wavelength in metres and the phase in radians at the highest grey level.
    unmodulated : float, optional
        Share of the light that leaves the panel unmodulated.
    reflectivity : float, optional
        Share of the incident light that leaves the panel.
    settling : float, optional
        Seconds from a new frame until its phase is settled.
    frame_rate : float, optional
        Rate in Hz at which videos are shown.
    response : PhaseResponse, optional
        Shares of the highest phase by grey level; linear by default.
    response_time : float, optional
        Seconds, the time constant of the liquid crystal; with 0 the phase settles at once.
    coupling : float, optional
        Metres, the standard deviation of the Gaussian by which fringing fields blur the phase; up
        to one pitch.
    flicker : float, optional
        Amplitude of the phase's ripple, as a share of the phase.
    jitter : float, optional
        Root mean square of the independent random phase errors of the pixels, radians.
    front_reflection : float, optional
        Share of the light that the cover glass reflects, a part of `reflectivity`.
    gap_reflection : float, optional
        Amplitude reflectance of the frame between the pixels, relative to the pixels'.
    flatness : PanelMap, optional
        Optical path in metres that the panel adds to the pattern's.
    illumination : PanelMap, optional
        Irradiance over the panel, in any unit.

    Raises
    ------
    ValueError
        If a value is out of range, or values contradict each other.

    References
    ----------
    Thesis Tables 2.1 and 2.2.
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
            "fill_factor",
            "unmodulated",
            "reflectivity",
            "flicker",
            "front_reflection",
            "gap_reflection",
        ):
            require_share(name, getattr(self, name))
        require_size("fill_factor", "fill_factor", self.fill_factor)
        for name, unit in (("response_time", "s"), ("coupling", "m"), ("jitter", "rad")):
            _require_amount(name, getattr(self, name), unit)
        if not 2 <= self.levels <= 256:
            raise ValueError(f"levels is {self.levels}; a panel has at least 2 and at most 256")
        self._require_range()
        self._require_consistent_effects()
        Plane(self.shape, (self.pitch, self.pitch))
        if math.prod(self.shape) > _MOST_PIXELS:
            raise ValueError(
                f"shape {self.shape} has {math.prod(self.shape):.3g} pixels; give (rows, columns) "
                f"of {_MOST_PIXELS:g} pixels at most"
            )

    def _require_range(self) -> None:
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

    def _require_consistent_effects(self) -> None:
        """Raise ValueError if values of the SLM's effects contradict each other."""
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
        """The plane of the SLM's pixels, centred on the axis."""
        return Plane(self.shape, (self.pitch, self.pitch))

    @property
    def active_side(self) -> float:
        """The side of the active square in each SLM pixel, in metres."""
        return math.sqrt(self.fill_factor) * self.pitch


def _require_amount(name: str, value: float, unit: str) -> None:
    if not 0 <= value < math.inf:
        raise ValueError(f"{name} is {value:g} {unit}; it can't be negative or infinite")
