"""Which effects a picture calls for: bounds, the ladder of plans, and the plan for a tolerance."""

from simulator.planning.auditing import Audited, audit
from simulator.planning.bound import Bound, Floor
from simulator.planning.effect import Effect, Stage
from simulator.planning.ladder import Ladder
from simulator.planning.plan import Decision, EffectPlan, planned, recipe_of

__all__ = [
    "Audited",
    "Bound",
    "Decision",
    "Effect",
    "EffectPlan",
    "Floor",
    "Ladder",
    "Stage",
    "audit",
    "planned",
    "recipe_of",
]
