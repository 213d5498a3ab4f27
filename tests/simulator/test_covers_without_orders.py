"""What is near hides what is behind it, also where the panel's side orders aren't rendered."""

import pytest
from small_bench.world import WIDE_OPEN, light_of, world

from simulator.scene import Scene
from simulator.scene.drawable import UniformLight
from simulator.scene.polygons import Polygons
from simulator.scene.sheets import Sheet, Sheets


def test_a_dim_sheet_in_focus_hides_what_is_bright():
    """It has a tenth of the light behind it, of which the gaps send a fifth to other orders.

    Seen through by that fifth, it would have a third.
    """
    corners = ((-2.4e-3, -2.4e-3), (-2.4e-3, 2.4e-3), (2.4e-3, 2.4e-3), (2.4e-3, -2.4e-3))
    near = Sheet(2.0, ((None, Polygons((corners,), (0.1,))),), Polygons((corners,), (1.0,)))
    far = Sheet(2.01, ((None, UniformLight()),), UniformLight())
    scene = Scene({"sheets": Sheets((near, far), 1e7)})
    forced = dict.fromkeys(("panel orders", "unmodulated light", "vignetting"), False)
    light = light_of(world(WIDE_OPEN, scene, tol=1e-3, forced=forced), target="sheets")
    rows, columns = (n // 2 for n in light.shape)
    middle = light[rows - 2 : rows + 3, columns - 2 : columns + 3].mean()
    # Light of the PSF's skirts comes from beside the sheet.
    assert middle / light[:2, :2].mean() == pytest.approx(0.1, abs=0.05)
