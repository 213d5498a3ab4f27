"""Plan which effects the simulator renders for a tolerance, by bounds on what each changes."""

from simulator.planning.auditing import AuditResult, audit
from simulator.planning.effect import Bound, DecidedBy, Effect, MinimumNorms, OnOffEffect
from simulator.planning.effect_plan import Decision, EffectPlan, build_recipe, plan_effects
from simulator.planning.ladder import Ladder

__all__ = [
    "AuditResult",
    "Bound",
    "DecidedBy",
    "Decision",
    "Effect",
    "EffectPlan",
    "Ladder",
    "MinimumNorms",
    "OnOffEffect",
    "audit",
    "build_recipe",
    "plan_effects",
]
