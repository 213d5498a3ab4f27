"""A shift of the panel in a scene file's [truth]."""

import numpy as np
import pytest

from labapp.bench.opening import open_bench
from labapp.common.errors import UserError
from labapp.files.true_bench_table import MountTable, TrueBenchTable
from optics.camera import Camera


def add(small, text: str) -> None:
    """To the scene file."""
    small.scene.write_text(small.scene.read_text() + text)


def test_a_shift_is_that_of_the_world_and_not_of_the_bench(small):
    add(small, "\n[truth.mount]\nshift_mm = [0.08, -0.12]\nflip_x = true\n")
    with open_bench(small.bench_files) as bench:
        assert np.allclose(bench.world.mount.shift, (0.08e-3, -0.12e-3))
        assert bench.world.mount.flip_x
        assert bench.description.lens == bench.world.camera.lens


def test_a_panel_beside_the_stop_is_refused(small):
    add(small, "\n[truth.mount]\nshift_mm = [0.0, 900.0]\n")
    refused = pytest.raises(UserError, match=r"truth.mount.*shift_mm is \[0, 900\].*smaller")
    with refused, open_bench(small.bench_files):
        pass


@pytest.mark.parametrize("text", ["[nan, 0.0]", "[0.0]", "0.1"])
def test_a_shift_that_is_none_is_refused(small, text):
    add(small, f"\n[truth.mount]\nshift_mm = {text}\n")
    with pytest.raises(UserError, match="shift_mm"), open_bench(small.bench_files):
        pass


def test_a_shift_is_in_millimetres():
    table = TrueBenchTable(mount=MountTable(shift_mm=(1.0, -2.0)))
    assert table.true_camera(Camera()) == Camera()
    assert table.mount.build().shift == (1e-3, -2e-3)
