import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from optics.camera import Panel as CamerasPanel
from optics.slm import Modulator, Panel, PanelMap, PhaseResponse, max_phase

LINE = torch.linspace(0, 1, 256)


def test_a_camera_and_the_modulator_have_the_same_panel():
    assert CamerasPanel is Panel


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"frame_rate": 0.0}, "frame_rate is 0 Hz; it must be positive"),
        ({"response_time": -1e-3}, "response_time is -0.001 s; it can't be negative"),
        ({"response_time": math.inf}, "response_time is inf s"),
        ({"coupling": math.nan}, "coupling is nan m"),
        ({"coupling": 9e-6}, "coupling is 9e-06 m; fringing fields reach .* 8e-06 m, at most"),
        ({"flicker": 1.5}, "flicker is 1.5; it is a share"),
        ({"jitter": -0.1}, "jitter is -0.1 rad"),
        ({"front_reflection": -0.1}, "front_reflection is -0.1; it is a share"),
        ({"front_reflection": 0.7}, "front_reflection is 0.7; .* reflectivity, 0.6"),
        ({"gap_reflection": 2.0}, "gap_reflection is 2; it is a share"),
        ({"illumination": PanelMap(torch.zeros(2, 2))}, "illumination goes from 0 to 0"),
        ({"illumination": PanelMap(torch.tensor([[1.0, -1.0]]))}, "illumination goes from -1 to 1"),
        (
            {"response": PhaseResponse.from_curve(5e-7, LINE[:16])},
            "response has 16 levels .* panel 256",
        ),
        ({"max_phase": ((5e-7, 9.0), (5e-7, 8.0))}, "max_phase has 500 nm more than once"),
    ],
)
def test_what_no_panel_has_is_refused(change, words):
    with pytest.raises(ValueError, match=words):
        replace(Panel(), **change)


def test_everything_at_its_limit_is_accepted():
    Panel(coupling=8e-6, flicker=1.0, front_reflection=0.6, gap_reflection=1.0, jitter=10.0)


def test_a_table_that_no_crystal_has_leaves_no_phase_somewhere():
    """Two paths that fall so fast that the line through them is below zero in the red."""
    panel = Panel(max_phase=((400e-9, 40.0), (500e-9, 0.5)))
    with pytest.raises(ValueError, match=r"max_phase leaves no phase at 570 nm"):
        max_phase(panel, 570e-9)


def test_a_modulator_for_a_wavelength_outside_the_table_is_refused():
    with pytest.raises(ValueError, match=r"wavelength 900 nm is outside"):
        Modulator(Panel(), 900e-9)


def interpolated(values, shape):
    """Bilinear between the centres of cells, pixel by pixel, by numpy's own interpolation."""
    rows, columns = values.shape

    def centres(n):
        return (np.arange(n) + 0.5) / n

    down = np.stack(
        [np.interp(centres(shape[0]), centres(rows), values[:, c]) for c in range(columns)], 1
    )
    return np.stack(
        [np.interp(centres(shape[1]), centres(columns), row) for row in down],
    )


@pytest.mark.parametrize("cells", [(1, 1), (2, 3), (7, 4), (24, 32), (50, 90)])
def test_maps_are_interpolated_between_the_centres_of_their_cells(cells):
    values = np.random.default_rng(0).normal(size=cells)
    panel = Panel((24, 32))
    assert np.allclose(
        PanelMap(values).at_pixels(panel).numpy(), interpolated(values, panel.shape), atol=1e-12
    )


def test_a_map_as_fine_as_the_panel_is_itself():
    values = torch.rand(24, 32, dtype=torch.float64)
    assert torch.equal(PanelMap(values).at_pixels(Panel((24, 32))), values)


def test_maps_are_differentiable():
    values = torch.rand(3, 4, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(lambda v: PanelMap(v).at_pixels(Panel((5, 9))), values)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        (np.zeros(4), r"a map's values are \(4,\); they need rows and columns"),
        (np.zeros((0, 3)), r"a map's values are \(0, 3\)"),
        (np.full((2, 2), np.nan), "a map has 4 NaN or infinite values of 4"),
    ],
)
def test_what_is_no_map_is_refused(values, words):
    with pytest.raises(ValueError, match=words):
        PanelMap(values)


def test_arrays_from_files_make_maps():
    """Read-only, of a foreign byte order, whole numbers."""
    array = np.arange(6, dtype=">u2").reshape(2, 3)
    array.setflags(write=False)
    assert PanelMap(array).values.tolist() == [[0, 1, 2], [3, 4, 5]]
