"""Reports of the simulator's effect plans, sent when they change."""

from __future__ import annotations

import math
from collections.abc import Hashable
from typing import TYPE_CHECKING

from labapp.bench.opening import Bench
from labapp.window.engine.channel import Channel
from labapp.window.messages import EffectInfo, EffectsReport, LiveFrame

if TYPE_CHECKING:
    from simulator.planning import Decision, EffectPlan


class EffectsReporter:
    """Report the effect plans of a simulated camera's pictures; a real camera has none."""

    def __init__(self, bench: Bench, channel: Channel) -> None:
        self._channel = channel
        self._world = bench.camera_world
        self._last_reported: Hashable = None

    def report_if_changed(self, frame: LiveFrame) -> None:
        """Send the effect plan of a live frame if the frame's settings are new.

        Settings are new if they differ from those reported last. Call this before the bench changes
        again: the plan is for the bench's present state.
        """
        if self._world is None:
            return
        s = self._world.situation(frame.exposure)
        # Time is left out: a moving scene would send a plan with every frame, too fast to read.
        tol = self._world.imaging.tol
        setting = (frame.target, frame.pattern, s.panel_content.names, s.band, frame.exposure, tol)
        if setting == self._last_reported:
            return
        try:
            plan = self._world.imaging.plan(s)
        except ValueError:
            # A picture that can't be planned can't be taken either; taking it reports the error.
            return
        self._last_reported = setting
        self._channel.send(build_effects_report(plan, frame))


def build_effects_report(plan: EffectPlan, frame: LiveFrame) -> EffectsReport:
    return EffectsReport(
        target=frame.target,
        pattern=frame.pattern,
        wavelength=frame.wavelength,
        exposure=frame.exposure,
        effects=tuple(_effect_info(decision) for decision in plan.decisions),
        tol=plan.tol,
        error=_limit(plan.relative_error),
        work=plan.work / plan.most_work if plan.most_work else 1.0,
        is_estimated=plan.decided_by == "estimate",
    )


def _effect_info(decision: Decision) -> EffectInfo:
    return EffectInfo(
        name=decision.effect,
        level=_level(decision),
        on=decision.on,
        forced=decision.forced,
        error=_limit(decision.relative),
        error_estimate=decision.estimate,
        why=decision.why,
        physics=decision.physics,
        source=decision.source,
        error_source=decision.error.how,
    )


def _level(decision: Decision) -> str:
    """Return an effect's level as text; on an axis, "n of N" with N the finest."""
    sampled = decision.kind == "axis" and len(decision.levels) > 1 and decision.level != "off"
    return f"{decision.level} of {decision.levels[-1]}" if sampled else decision.level


def _limit(share: float) -> float | None:
    return share if math.isfinite(share) else None
