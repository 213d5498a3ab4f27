"""Which effects a picture calls for, decided by their size and explained."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import torch

from optics.camera import Camera
from optics.pupil import cutoff_frequency

_MOST_NODES = 5


@dataclass(frozen=True)
class Situation:
    """What the decisions depend on.

    wavelength, bandwidth: of the filter, metres (full width at half maximum).
    spread: radius of the PSF on the sensor, metres, from the slope of the shown phase.
    """

    camera: Camera
    wavelength: float
    bandwidth: float
    spread: float


@dataclass(frozen=True)
class Decision:
    """One effect: on or off, the estimate that decided, and the physics in a sentence.

    estimate: relative change of the mean picture, or of the noise in standard deviations.
    nodes: samples along an axis of the image-formation integral; 1 for stages.
    """

    effect: str
    on: bool
    estimate: float
    measure: str
    why: str
    nodes: int = 1


@dataclass(frozen=True)
class EffectPlan:
    """The decisions for one situation and tolerance, in the order of the physics."""

    tol: float
    decisions: tuple[Decision, ...]

    def __getitem__(self, effect: str) -> Decision:
        return next(d for d in self.decisions if d.effect == effect)

    def is_on(self, effect: str) -> bool:
        return self[effect].on

    def as_data(self) -> dict[str, Any]:
        return {"tol": self.tol, "decisions": [asdict(d) for d in self.decisions]}


def phase_spread(camera: Camera, phase: torch.Tensor, wavelength: float) -> float:
    """Radius in metres to which a shown phase sends light: three times its rms slope.

    A slope of s rad/m sends light to s wavelength z / 2 pi; steps are taken modulo a wave.
    """
    squares = 0.0
    for axis in (0, 1):
        step = torch.diff(phase, dim=axis) / (2 * math.pi)
        step = (step - torch.round(step)) / camera.panel.pitch
        squares += float((step**2).mean())
    return 3 * math.sqrt(squares / 2) * wavelength * camera.lens.image_distance


def decide(situation: Situation, tol: float, forced: Mapping[str, bool]) -> EffectPlan:
    """Every effect whose estimate exceeds `tol` is on; forced settings win and are recorded.

    Raises ValueError for a forced effect that doesn't exist, or a `tol` that is negative or
    not finite.
    """
    if not 0 <= tol < math.inf:
        raise ValueError(f"tol is {tol:g}; it must be finite and not negative")
    decisions = [judge(situation, tol) for judge in _JUDGES]
    names = [d.effect for d in decisions]
    unknown = sorted(set(forced) - set(names))
    if unknown:
        raise ValueError(f"effect {unknown[0]!r} is unknown; choose among {', '.join(names)}")
    return EffectPlan(tol, tuple(_force(d, forced.get(d.effect)) for d in decisions))


def _force(decision: Decision, on: bool | None) -> Decision:
    if on is None:
        return decision
    nodes = decision.nodes if on else 1
    return Decision(
        decision.effect, on, decision.estimate, decision.measure, f"forced. {decision.why}", nodes
    )


def _bandwidth(s: Situation, tol: float) -> Decision:
    """Gauss-Hermite error a^2n n! / (2n)!, a the phase of the finest well-seen fringe.

    A change of wavelength scales the PSF; a fringe of half the cut-off frequency at the
    PSF's radius moves by a radians for one standard deviation of the band. The radius is
    at least that of the first fringes beside the spot of a neutral pattern.
    """
    sigma = s.bandwidth / 2.3548
    cutoff = cutoff_frequency(s.camera, s.wavelength)
    radius = math.hypot(s.spread, 2 / cutoff)
    a = 2 * math.pi * (cutoff / 2) * radius * sigma / s.wavelength

    def error(n: int) -> float:
        return a ** (2 * n) * math.factorial(n) / math.factorial(2 * n)

    nodes = next((n for n in range(1, _MOST_NODES) if error(n) <= tol), _MOST_NODES)
    used = "one wavelength leaves" if nodes == 1 else f"{nodes} wavelengths leave"
    why = f"the band scales the PSF; {used} an error of {error(nodes):.1g}"
    return Decision("filter bandwidth", nodes > 1, error(1), "mean", why, nodes)


def _unmodulated(s: Situation, tol: float) -> Decision:
    share = s.camera.panel.unmodulated
    why = f"{share:.1%} of the light ignores the pattern and stays in the centre"
    return Decision("unmodulated light", share > tol, share, "mean", why)


def _pixel_aperture(s: Situation, tol: float) -> Decision:
    """1 - sinc at half of the sensor's Nyquist frequency."""
    loss = 1 - math.sin(math.pi / 4) / (math.pi / 4)
    return Decision("pixel aperture", loss > tol, loss, "mean", "a pixel averages over its area")


def _dark_current(s: Situation, tol: float) -> Decision:
    sensor = s.camera.sensor
    size = math.sqrt(sensor.dark_current * 1.0) / _noise_floor(s)
    why = f"{sensor.dark_current:g} electrons per second, against the noise of one read-out"
    return Decision("dark current", size > tol, size, "noise", why)


def _shot_noise(s: Situation, tol: float) -> Decision:
    size = math.sqrt(s.camera.sensor.full_well / 2) / _noise_floor(s)
    return Decision("shot noise", size > tol, size, "noise", "photons arrive at random")


def _read_noise(s: Situation, tol: float) -> Decision:
    size = s.camera.sensor.read_noise / (s.camera.sensor.gain / math.sqrt(12))
    return Decision("read noise", size > tol, size, "noise", "against the quantisation step's own")


def _noise_floor(s: Situation) -> float:
    sensor = s.camera.sensor
    return math.hypot(sensor.read_noise, sensor.gain / math.sqrt(12))


_JUDGES = (_bandwidth, _unmodulated, _pixel_aperture, _dark_current, _shot_noise, _read_noise)
