"""State what a result costs and how accurate it is, and choose among methods accordingly."""

from optics.accuracy.account import (
    FLOAT32_ARITHMETIC,
    FLOAT64_ARITHMETIC,
    Account,
    ErrorEstimate,
    Result,
    account_as_dict,
)
from optics.accuracy.budget import (
    Budget,
    MachineSpeed,
    limit_planning_time,
    plan_budget,
    require_planning_time,
)
from optics.accuracy.choice import (
    CandidateMethod,
    DearerThanOthersError,
    IterationOption,
    MethodChoice,
    best_within,
    cheapest_candidate,
    select_methods,
)
from optics.accuracy.tolerance_error import (
    ToleranceError,
    require_memory,
    require_time,
    unreachable_tolerance_error,
)

__all__ = [
    "FLOAT32_ARITHMETIC",
    "FLOAT64_ARITHMETIC",
    "Account",
    "Budget",
    "CandidateMethod",
    "DearerThanOthersError",
    "ErrorEstimate",
    "IterationOption",
    "MachineSpeed",
    "MethodChoice",
    "Result",
    "ToleranceError",
    "account_as_dict",
    "best_within",
    "cheapest_candidate",
    "limit_planning_time",
    "plan_budget",
    "require_memory",
    "require_planning_time",
    "require_time",
    "select_methods",
    "unreachable_tolerance_error",
]
