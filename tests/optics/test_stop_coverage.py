"""Covered shares of cells against areas, against counts of points and against each other."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from judges import binned, positions

from optics.camera.stop import Circle, Polygon, Stop, rectangle, regular_polygon
from optics.camera.stop_areas import Coverage, coverage
from optics.plane import Plane

RADIUS = 2.1e-3
L = Polygon(((-0.5, -0.5), (-0.5, 0.5), (0.0, 0.5), (0.0, 0.0), (0.5, 0.0), (0.5, -0.5)))
SPIDER = (rectangle(0.06, 2.4), rectangle(2.4, 0.05))

STOPS = {
    "round": Stop(),
    "annular": Stop(Circle(0.9), (Circle(0.35),)),
    "round, off the middle": Stop(Circle(0.4, (0.3, -0.2))),
    "with a disc off the middle": Stop(Circle(), (Circle(0.3, (0.2, -0.4)),)),
    "with a bite": Stop(Circle(), (Circle(0.5, (0.3, 0.8)),)),
    "with a spider": Stop(Circle(), SPIDER),
    "with half a plane": Stop(Circle(), (rectangle(4.0, 2.0, (0.0, 1.3)),)),
    "rectangular": Stop(rectangle(0.7, 1.2, (0.1, -0.2))),
    "triangular": Stop(regular_polygon(3, turn=0.4)),
    "hexagonal": Stop(regular_polygon(6)),
    "hexagonal, annular": Stop(regular_polygon(6, turn=0.2), (Circle(0.4),)),
    "hexagonal, with a large disc": Stop(regular_polygon(6, turn=0.2), (Circle(0.9),)),
    "an L": Stop(L),
    "with an L": Stop(Circle(), (L,)),
    "an L with a disc": Stop(L, (Circle(0.3, (0.2, 0.1)),)),
}


def plane(shape, pitch, centre=(0.0, 0.0)) -> Plane:
    """Lengths in units of the stop's radius."""
    scaled = (tuple(length * RADIUS for length in pair) for pair in (pitch, centre))
    return Plane(shape, *scaled)


AROUND = {
    "even": plane((12, 14), (0.2, 0.17)),
    "odd": plane((11, 13), (0.21, 0.19)),
    "mixed": plane((13, 8), (0.17, 0.3)),
    "off the axis": plane((16, 15), (0.17, 0.19), (0.11, -0.23)),
    "fine": plane((150, 211), (0.014, 0.0101)),
    "a row": plane((1, 11), (2.2, 0.21)),
    "a column": plane((14, 1), (0.17, 2.5)),
    "one cell": plane((1, 1), (2.3, 2.1)),
    "one cell of four": plane((2, 2), (3.0, 3.0), (1.2, 1.3)),
    "lines that touch": plane((8, 10), (0.25, 0.25), (0.125, 0.125)),
    "lines through the middle": plane((4, 2), (0.5, 1.0), (0.25, 0.5)),
}
CUTTING = {
    "the middle": plane((6, 5), (0.1, 0.17)),
    "a corner": plane((6, 5), (0.15, 0.17), (0.6, -0.5)),
    "beside a lower edge": plane((7, 9), (0.11, 0.13), (-0.8, 0.1)),
    "a row": plane((1, 9), (0.13, 0.4), (0.3, 0.0)),
    "one cell": plane((1, 1), (0.3, 0.4), (0.1, -0.9)),
    "lines along sides": plane((4, 3), (0.1, 0.2), (0.0, 0.4)),
}


def counted(stop: Stop, grid: Plane, points: int = 4_000) -> np.ndarray:
    """Share of the points in each cell that are in the opening and in no obscuration.

    Spread by the golden ratio: rows of points along a side would be all in or all out.
    """
    number = np.arange(points)
    inner = (number + 0.5) / points - 0.5, (number * (math.sqrt(5) - 1) / 2) % 1 - 0.5
    answer = np.empty(grid.shape)
    for i, v in enumerate(positions(grid.shape[0], grid.pitch[0], grid.centre[0])):
        for j, u in enumerate(positions(grid.shape[1], grid.pitch[1], grid.centre[1])):
            y, x = ((c + o * p) / RADIUS for c, o, p in zip((v, u), inner, grid.pitch, strict=True))
            inside = stop.opening.contains(y, x)
            for shape in stop.obscurations:
                inside = inside & ~shape.contains(y, x)
            answer[i, j] = inside.mean()
    return answer


@pytest.mark.parametrize("name", STOPS)
def test_all_cells_together_have_the_area_of_the_stop(name):
    stop = STOPS[name]
    for cells in AROUND.values():
        total = float(coverage(stop, RADIUS, cells).sum()) * math.prod(cells.pitch) / RADIUS**2
        assert total == pytest.approx(stop.area, rel=1e-12)


@pytest.mark.parametrize("grid", ["odd", "mixed"])
@pytest.mark.parametrize("name", STOPS)
def test_every_cell_has_the_share_of_the_points_inside(name, grid):
    value = coverage(STOPS[name], RADIUS, AROUND[grid]).numpy()
    assert np.abs(value - counted(STOPS[name], AROUND[grid])).max() <= 2e-3


@pytest.mark.parametrize("grid", CUTTING)
@pytest.mark.parametrize("name", STOPS)
def test_a_plane_that_cuts_the_stop_counts_the_points_inside(name, grid):
    value = coverage(STOPS[name], RADIUS, CUTTING[grid]).numpy()
    assert np.abs(value - counted(STOPS[name], CUTTING[grid])).max() <= 2e-3


@pytest.mark.parametrize("name", STOPS)
def test_a_part_of_a_plane_has_the_shares_of_the_whole(name):
    """Rows 3 to 8 and columns 5 to 8 of an even plane."""
    whole = plane((16, 12), (0.14, 0.19))
    part = plane((5, 3), (0.14, 0.19), ((3 + 2 - 8) * 0.14, (5 + 1 - 6) * 0.19))
    value, truth = (coverage(STOPS[name], RADIUS, cells) for cells in (part, whole))
    assert torch.allclose(value, truth[3:8, 5:8], atol=1e-13, rtol=0)


@pytest.mark.parametrize("name", STOPS)
def test_finer_cells_add_up(name):
    """With an odd factor the outlines of odd planes agree."""
    cells = plane((9, 7), (0.21, 0.29), (0.1, -0.2))
    value, finer = (
        coverage(STOPS[name], RADIUS, p).numpy() for p in (cells, cells.with_finer_pitch(5))
    )
    assert np.allclose(value, binned(finer, 5) / 25, atol=1e-13, rtol=0)


def test_shares_are_float64_and_of_the_planes_shape():
    value = coverage(Stop(), RADIUS, AROUND["mixed"])
    assert value.dtype == torch.float64
    assert value.shape == (13, 8)


@pytest.mark.parametrize("name", STOPS)
def test_shares_are_none_to_all(name):
    value = coverage(STOPS[name], RADIUS, AROUND["fine"])
    assert float(value.min()) == 0
    assert float(value.max()) == 1


def test_a_side_through_the_middle_of_cells_covers_halves_and_quarters():
    """A square of 4 x 2 cells between the middles of 5 x 3."""
    value = coverage(Stop(rectangle(0.8, 0.4)), RADIUS, plane((7, 5), (0.2, 0.2))).numpy()
    rows, columns = np.array([0, 0.5, 1, 1, 1, 0.5, 0]), np.array([0, 0.5, 1, 0.5, 0])
    assert np.allclose(value, np.outer(rows, columns), atol=1e-14, rtol=0)


def test_a_side_along_a_diagonal_covers_half():
    value = coverage(Stop(regular_polygon(4)), RADIUS, plane((4, 4), (0.5, 0.5), (0.25, 0.25)))
    truth = [[0, 0.5, 0.5, 0], [0.5, 1, 1, 0.5], [0.5, 1, 1, 0.5], [0, 0.5, 0.5, 0]]
    assert np.allclose(value.numpy(), truth, atol=1e-14, rtol=0)


def test_sides_along_the_lines_cover_all_or_nothing():
    """Also of the obscuration inside."""
    stop = Stop(rectangle(1.0, 1.0), (rectangle(0.5, 0.25, (0.0, 0.125)),))
    value = coverage(stop, RADIUS, plane((8, 8), (0.25, 0.25), (0.125, 0.125))).numpy()
    truth = np.zeros((8, 8))
    truth[2:6, 2:6] = 1
    truth[3:5, 4] = 0
    assert np.allclose(value, truth, atol=1e-14, rtol=0)


def test_lines_that_touch_a_circle_leave_nothing_beyond():
    value = coverage(Stop(), RADIUS, AROUND["lines that touch"]).numpy()
    assert value[:, [0, -1]].max() <= 1e-14
    assert value[0, 1] <= 1e-14
    # The last cell beside the middle holds half of a cap.
    y = 0.25
    under = (y * math.sqrt(1 - y * y) + math.asin(y)) / 2 - 0.75 * y
    assert value[4, 8] == pytest.approx(under / 0.25**2, abs=1e-14)


@pytest.mark.parametrize("across", [1, 3, 4])
@pytest.mark.parametrize("seed", range(15))
def test_a_circle_between_lines_that_touch_it_stays_between_them(seed, across):
    """Whichever way the lines are rounded."""
    rng = np.random.default_rng(seed)
    radius, (cy, cx) = rng.uniform(0.1, 0.4), rng.uniform(-0.4, 0.4, 2)
    pitch, n = 2 * radius / across, across + 4
    # Two cells to the left and above; the sample n // 2 is at the plane's centre.
    shift = (n // 2 - (n - 1) / 2) * pitch
    cells = plane((n, n), (pitch, pitch), (cy + shift, cx + shift))
    value = coverage(Stop(Circle(radius, (cy, cx))), RADIUS, cells).numpy()
    assert value.sum() * pitch**2 == pytest.approx(math.pi * radius**2, rel=1e-12)
    assert value[2:-2, 2:-2].sum() == pytest.approx(value.sum(), rel=1e-12)
    # The middle is even in both directions.
    assert np.allclose(value, value[::-1], atol=1e-12, rtol=0)
    assert np.allclose(value, value.T, atol=1e-12, rtol=0)


@pytest.mark.parametrize("place", [(0, 0), (3, 2), (6, 4)])
def test_a_stop_smaller_than_a_cell_fills_a_share_of_it(place):
    """A tenth of a cell wide; also in the first and in the last cell."""
    cells = Plane((7, 5), (1e-3, 2e-3), (1e-4, -3e-4))
    y, x = (positions(n, p)[i] for n, p, i in zip(cells.shape, cells.pitch, place, strict=True))
    moved = Plane(cells.shape, cells.pitch, (-y + 1e-4, -x - 3e-4))
    value = coverage(Stop(), 1e-4, moved).numpy()
    assert value[place] == pytest.approx(math.pi * 1e-8 / 2e-6, rel=1e-13)
    assert np.count_nonzero(value) == 1


@pytest.mark.parametrize(
    "centre", [(0.0, 9.0), (0.0, -9.0), (9.0, 0.0), (-9.0, 0.0), (2.0, 2.0), (-1.6, 0.9)]
)
def test_a_plane_beside_the_stop_is_dark(centre):
    value = coverage(STOPS["with a spider"], RADIUS, plane((4, 6), (0.2, 0.2), centre))
    assert float(value.max()) <= 1e-14


def test_a_plane_inside_the_stop_is_bright():
    value = coverage(Stop(), RADIUS, plane((4, 6), (0.2, 0.2), (0.1, 0.0)))
    assert np.allclose(value.numpy(), 1, atol=1e-14, rtol=0)


@pytest.mark.parametrize("stop", STOPS.values(), ids=STOPS)
@pytest.mark.parametrize("cells", ["mixed", "off the axis", "one cell"])
def test_the_derivative_in_the_radius_is_that_of_differences(stop, cells):
    """Richardson's limit of central differences; no edge of these stops lies along a grid line."""
    step, grid = 1e-5 * RADIUS, AROUND[cells]

    def slope(h):
        return (coverage(stop, RADIUS + h, grid) - coverage(stop, RADIUS - h, grid)) / (2 * h)

    rate = Coverage(stop, RADIUS, grid).radius_derivative()
    wide, narrow = slope(2 * step), slope(step)
    error = (rate - (4 * narrow - wide) / 3).abs() * RADIUS
    # Where an edge passes a corner of a cell within the steps, differences don't converge.
    bent = (wide - narrow).abs() * RADIUS > 1e-4
    assert bent.double().mean() <= 0.05
    assert float(error[~bent].max()) <= 1e-4 * max(1.0, float(rate.abs().max() * RADIUS))
