"""What a result costs and how far it can be trusted; the choice among methods."""

from optics.accuracy.account import FLOAT32_ARITHMETIC as FLOAT32_ARITHMETIC
from optics.accuracy.account import FLOAT64_ARITHMETIC as FLOAT64_ARITHMETIC
from optics.accuracy.account import Account as Account
from optics.accuracy.account import ErrorEstimate as ErrorEstimate
from optics.accuracy.account import Result as Result
from optics.accuracy.account import account_as_dict as account_as_dict
from optics.accuracy.budget import Budget as Budget
from optics.accuracy.budget import MachineSpeed as MachineSpeed
from optics.accuracy.choice import CandidateMethod as CandidateMethod
from optics.accuracy.choice import IterationOption as IterationOption
from optics.accuracy.choice import MethodChoice as MethodChoice
from optics.accuracy.choice import best_within as best_within
from optics.accuracy.choice import cheapest_candidate as cheapest_candidate
from optics.accuracy.choice import select_methods as select_methods
from optics.accuracy.tolerance_error import ToleranceError as ToleranceError
from optics.accuracy.tolerance_error import require_memory as require_memory
from optics.accuracy.tolerance_error import (
    unreachable_tolerance_error as unreachable_tolerance_error,
)
