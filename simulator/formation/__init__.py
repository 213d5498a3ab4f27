"""The picture of a situation, as a recipe says.

`time`, `nodes` and `kernels` say which points spread how, `gathering` and `layered` put
pictures and kernels together, `picture` does what a recipe says in the order of the light.
"""

from simulator.formation.picture import expected as expected
