"""The decisions for one situation and tolerance."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

from optics.camera import Panel
from simulator.effects.band import filter_bandwidth
from simulator.effects.panel import PANEL_EFFECTS, UNMODULATED, unmodulated_light
from simulator.effects.sensor import dark_current, pixel_aperture, read_noise, shot_noise
from simulator.effects.situation import Decision, Situation
from simulator.effects.video import CRYSTAL, crystal_response

_JUDGES = (
    filter_bandwidth,
    *PANEL_EFFECTS,
    crystal_response,
    unmodulated_light,
    pixel_aperture,
    dark_current,
    shot_noise,
    read_noise,
)

_DATA = {effect.name: (effect.field, effect.nothing) for effect in PANEL_EFFECTS} | {
    CRYSTAL: ("response_time", 0.0),
    UNMODULATED: ("unmodulated", 0.0),
}
"""The fields of Panel that hold the effects' data, and what is in them without the effect."""


@dataclass(frozen=True)
class EffectPlan:
    """The decisions for one situation and tolerance, in the order of the physics."""

    tol: float
    decisions: tuple[Decision, ...]

    def __getitem__(self, effect: str) -> Decision:
        return next(d for d in self.decisions if d.effect == effect)

    def is_on(self, effect: str) -> bool:
        return self[effect].on

    def panel(self, panel: Panel) -> Panel:
        """The panel with those effects only that are on; itself if those are all that it has."""
        off = [_DATA[d.effect] for d in self.decisions if not d.on and d.effect in _DATA]
        gone = {name: nothing for name, nothing in off if getattr(panel, name) != nothing}
        return replace(panel, **gone) if gone else panel

    def as_data(self) -> dict[str, Any]:
        """As plain data, without the effects that nothing causes."""
        told = [asdict(d) for d in self.decisions if d.estimate or d.on or d.forced]
        return {"tol": self.tol, "decisions": told}


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
    return replace(decision, on=on, why=f"forced. {decision.why}", nodes=nodes, forced=True)
