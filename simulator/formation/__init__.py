"""The picture of a situation: as a recipe says, and, slowly, with everything in it.

`time`, `nodes` and `kernels` say which points spread how, `gathering` and `compositing` put
pictures and kernels together, `picture` does what a recipe says in the order of the light.
`reference` is the same integral as plain loops.
"""

from simulator.formation.picture import expected as expected
from simulator.formation.reference import reference as reference
