"""What a result costs and how far it can be trusted; the choice among methods."""

from optics.accuracy.account import FLOAT32_ARITHMETIC as FLOAT32_ARITHMETIC
from optics.accuracy.account import FLOAT64_ARITHMETIC as FLOAT64_ARITHMETIC
from optics.accuracy.account import Account as Account
from optics.accuracy.account import ErrorEstimate as ErrorEstimate
from optics.accuracy.account import Result as Result
from optics.accuracy.account import describe as describe
from optics.accuracy.budget import Budget as Budget
from optics.accuracy.budget import MachineSpeed as MachineSpeed
from optics.accuracy.choice import Choice as Choice
from optics.accuracy.choice import Offer as Offer
from optics.accuracy.choice import Setting as Setting
from optics.accuracy.choice import best_within as best_within
from optics.accuracy.choice import cheapest as cheapest
from optics.accuracy.choice import named as named
from optics.accuracy.refusal import ToleranceError as ToleranceError
from optics.accuracy.refusal import require_memory as require_memory
from optics.accuracy.refusal import unkeepable as unkeepable
