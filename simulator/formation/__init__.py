"""The picture of a situation, as a recipe says.

`exposure_cells`, `nodes` and `kernels` say which points spread how, `sample_grid` and
`compositing` put pictures and kernels together, `mean_picture` does what a recipe says in the
order of the light.
"""

from simulator.formation.mean_picture import expected_electrons

__all__ = ["expected_electrons"]
