"""The mean picture of a situation, rendered by its recipe.

`exposure_cells`, `nodes` and `kernels` compute how each point's light spreads. `sample_grid` and
`compositing` convolve pictures with PSFs and combine them. `mean_picture` runs the recipe's stages
in the order of the light.
"""

from simulator.formation.mean_picture import expected_electrons

__all__ = ["expected_electrons"]
