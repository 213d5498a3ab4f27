"""Which effects a picture calls for: each is estimated, compared with a tolerance, explained.

`plan` decides; `band`, `panel` and `sensor` hold the estimates, in the order in which the light
meets what they are of; `pattern` is what the estimates look at.
"""

from simulator.effects.pattern import Pattern as Pattern
from simulator.effects.pattern import phase_spread as phase_spread
from simulator.effects.plan import EffectPlan as EffectPlan
from simulator.effects.plan import decide as decide
from simulator.effects.situation import Decision as Decision
from simulator.effects.situation import Situation as Situation
