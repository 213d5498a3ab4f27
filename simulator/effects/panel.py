"""The panel's effects, in the order in which light meets them.

Each estimate is the relative L2 change of a star's picture, as an order of magnitude: what an
effect changes of the field, root mean square, where the change interferes with the field, and
the share of light that it moves, where it doesn't. Light that comes to the spot in the centre
weighs the more, the less sharp the pattern's own PSF is.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.special
import torch

from optics.camera import Panel
from optics.slm.gap import gap_light
from optics.slm.jitter import scattered_share
from optics.slm.reflection import front_share
from simulator.effects.pattern import Pattern
from simulator.effects.situation import Decision, Situation

UNMODULATED = "unmodulated light"

_MOST = math.sqrt(2)
"""Relative L2 distance of two PSFs without light in common."""

_PLACES, _STEPS = 40, 256
"""Across a pixel, and up to the largest step of the phase, at which coupling is looked at."""


@dataclass(frozen=True)
class PanelEffect:
    """An effect that a panel has, or hasn't.

    field: of Panel, which holds its datum; nothing: the datum of a panel without it.
    size: its estimate for a pattern. why: the physics in a sentence.
    """

    name: str
    field: str
    nothing: Any
    size: Callable[[Pattern], float]
    why: Callable[[Panel], str]

    def is_in(self, panel: Panel) -> bool:
        return bool(getattr(panel, self.field) != self.nothing)

    def __call__(self, s: Situation, tol: float) -> Decision:
        size = s.sizes.get(self.name, 0.0)
        why = self.why(s.camera.panel) if self.is_in(s.camera.panel) else "the panel hasn't it"
        return Decision(self.name, size > tol, size, "mean", why)


def sizes_of(pattern: Pattern, tol: float) -> dict[str, float]:
    """The estimates for a pattern of all effects that its panel has, by name."""
    panel = pattern.panel
    sizes = {e.name: e.size(pattern) for e in PANEL_EFFECTS if e.is_in(panel)}
    # More than the tolerance is more on any pattern; less may be more where the PSF is wide.
    if 0 < panel.unmodulated <= tol:
        sizes[UNMODULATED] = _in_the_centre(panel.unmodulated, pattern)
    return sizes


def _in_the_centre(share: float, pattern: Pattern) -> float:
    """Of light that joins the spot of a neutral pattern, incoherent with the rest."""
    return share / pattern.sharpness


def unmodulated_light(s: Situation, tol: float) -> Decision:
    share = s.camera.panel.unmodulated
    size = max(share, s.sizes.get(UNMODULATED, 0.0))
    why = f"{share:.1%} of the light ignores the pattern and stays in the centre"
    return Decision(UNMODULATED, size > tol, size, "mean", why)


def _illumination(pattern: Pattern) -> float:
    """The amplitude that isn't the mean's: the Strehl ratio's loss is its square."""
    assert pattern.panel.illumination is not None
    light = pattern.panel.illumination.values
    light = light / light.mean()
    return math.sqrt(max(1 - float(light.sqrt().mean()) ** 2, 0.0))


def _front(pattern: Pattern) -> float:
    return _in_the_centre(front_share(pattern.panel), pattern)


def _response(pattern: Pattern) -> float:
    """A static phase error; of phases that were even, it brings some to the centre."""
    straight = torch.polar(torch.ones_like(pattern.phase), pattern.linear_phase)
    centred = abs(pattern.mean(pattern.field) - pattern.mean(straight)) ** 2
    return _wrong_by(pattern.phase - pattern.linear_phase) + _in_the_centre(centred, pattern)


def _flatness(pattern: Pattern) -> float:
    assert pattern.panel.flatness is not None
    return _wrong_by(pattern.panel.flatness.values * (2 * math.pi / pattern.wavelength))


def _wrong_by(phase: torch.Tensor) -> float:
    """Of a static phase error in radians: its rms about the mean, which is no error; the Strehl
    ratio's loss is its square (Maréchal; Born and Wolf 9.1)."""
    return min(float(phase.std(correction=0)), _MOST)


def _flicker(pattern: Pattern) -> float:
    """A ripple phase (1 + f sin) takes f² Var(phase) / 2 from the mean field, twice that from
    the light, and brings f²/2 |mean of phase exp(i phase)|² to the centre."""
    phase, f = pattern.phase - pattern.phase.mean(), pattern.panel.flicker
    centred = f**2 / 2 * abs(pattern.mean(phase * pattern.field)) ** 2
    return min(f**2 * float((phase**2).mean()), _MOST) + _in_the_centre(centred, pattern)


def _jitter(pattern: Pattern) -> float:
    """Ruze's loss, 1 - exp(-jitter²) (Proc. IEEE 54, 633, 1966)."""
    return scattered_share(pattern.panel.jitter)


def _gap(pattern: Pattern) -> float:
    """A spot of amplitude g: g² of its own, and 2 g times the field that is there."""
    g = gap_light(pattern.panel)
    return _in_the_centre(g**2 + 2 * g * math.sqrt(pattern.brightness), pattern)


def _coupling(pattern: Pattern) -> float:
    """A Gaussian blurs a step D between neighbours: at x from the edge the phase errs by
    D/2 erfc(x / (sqrt 2 sigma)). The field that a pixel loses on average is lost twice to the
    light, what differs from pixel to pixel interferes, and what is left of phases that were
    even comes to the centre."""
    error = torch.zeros_like(pattern.field)
    for axis in (0, 1):
        step = pattern.phase.diff(dim=axis)
        n = step.shape[axis]
        error.narrow(axis, 0, n).add_(_beside(step, pattern.panel))
        error.narrow(axis, 1, n).add_(_beside(-step, pattern.panel))
    lost = 2 * abs(pattern.mean(error).real)
    centred = abs(pattern.mean(error * pattern.field)) ** 2
    return lost + float(error.std(correction=0)) + _in_the_centre(centred, pattern)


def _beside(step: torch.Tensor, panel: Panel) -> torch.Tensor:
    """Mean of exp(i error) - 1 over the active area of a pixel that has a step on one side."""
    places = panel.active_side * ((np.arange(_PLACES) + 0.5) / _PLACES - 0.5)
    away = (panel.pitch / 2 - places) / (math.sqrt(2) * panel.coupling)
    reach = scipy.special.erfc(away) / 2
    steps = np.linspace(0, max(float(step.abs().max()), 1e-9), _STEPS)
    error = np.expm1(1j * steps[:, None] * reach).mean(1)
    at = step.abs().numpy()
    real, imaginary = np.interp(at, steps, error.real), np.interp(at, steps, error.imag)
    return torch.complex(torch.from_numpy(real), torch.from_numpy(imaginary) * step.sign())


PANEL_EFFECTS = (
    PanelEffect(
        "illumination",
        "illumination",
        None,
        _illumination,
        lambda panel: "the light on the panel isn't even, and the PSF's fringes follow it",
    ),
    PanelEffect(
        "front reflection",
        "front_reflection",
        0.0,
        _front,
        lambda panel: f"{front_share(panel):.1%} of the light never enters the panel",
    ),
    PanelEffect(
        "panel response",
        "response",
        None,
        _response,
        lambda panel: "the phase isn't proportional to the grey level",
    ),
    PanelEffect(
        "neighbour coupling",
        "coupling",
        0.0,
        _coupling,
        lambda panel: f"fringing fields blur the phase by {panel.coupling * 1e6:.2g} µm",
    ),
    PanelEffect(
        "flicker",
        "flicker",
        0.0,
        _flicker,
        lambda panel: f"the drive makes the phase ripple by {panel.flicker:.1%}",
    ),
    PanelEffect(
        "jitter",
        "jitter",
        0.0,
        _jitter,
        lambda panel: f"pixels err on their own by {panel.jitter:.2g} rad and scatter light",
    ),
    PanelEffect(
        "gap light",
        "gap_reflection",
        0.0,
        _gap,
        lambda panel: f"the frame between pixels sends {gap_light(panel):.1%} of their amplitude",
    ),
    PanelEffect(
        "flatness",
        "flatness",
        None,
        _flatness,
        lambda panel: "the panel isn't flat, and its figure is a wavefront of its own",
    ),
)
