"""What is near hides what is behind it, whether the panel's side orders are rendered or not."""

import numpy as np
import pytest
from small_bench.world import WIDE_OPEN, light_of, world

from simulator.scene import Scene
from simulator.scene.drawable import UniformLight
from simulator.scene.polygons import Polygons
from simulator.scene.sheets import Sheet, Sheets


def square(half: float, value: float) -> Polygons:
    corners = ((-half, -half), (-half, half), (half, half), (half, -half))
    return Polygons((corners,), (value,))


def test_a_dim_sheet_in_focus_hides_what_is_bright():
    """It has a tenth of the light behind it, of which the gaps send a fifth to other orders.

    Seen through by that fifth, it would have a third.
    """
    near = Sheet(2.0, ((None, square(2.4e-3, 0.1)),), square(2.4e-3, 1.0))
    far = Sheet(2.01, ((None, UniformLight()),), UniformLight())
    scene = Scene({"sheets": Sheets((near, far), 1e7)})
    forced = dict.fromkeys(("panel orders", "unmodulated light", "vignetting"), False)
    light = light_of(world(WIDE_OPEN, scene, tol=1e-3, forced=forced), target="sheets")
    rows, columns = (n // 2 for n in light.shape)
    middle = light[rows - 2 : rows + 3, columns - 2 : columns + 3].mean()
    # Light of the PSF's skirts comes from beside the sheet.
    assert middle / light[:2, :2].mean() == pytest.approx(0.1, abs=0.05)


@pytest.mark.parametrize("apart", [False, True])
def test_orders_that_miss_the_frame_let_no_light_through(monkeypatch, apart):
    """A sheet hid only the zeroth order's share of the light: an eighth of it shone through."""
    if apart:
        monkeypatch.setattr("simulator.formation.windows._work", lambda *a: float(a[2] == 0))
    near = Sheet(2.0, (), square(2.4e-3, 1.0))
    far = Sheet(2.01, ((None, square(4e-3, 1.0)),), square(4e-3, 1.0))
    scene = Scene({"sheets": Sheets((near, far), 1e7)})
    with_orders, without = (
        light_of(
            world(WIDE_OPEN, scene, tol=1e-3, forced={"panel orders": on, "vignetting": False}),
            target="sheets",
        )
        for on in (True, False)
    )
    change = np.linalg.norm(with_orders - without)
    assert change <= 1e-3 * np.linalg.norm(without)
