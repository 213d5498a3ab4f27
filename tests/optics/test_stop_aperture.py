"""Open areas against elementary geometry, and against counts of points."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import quad

from optics.camera.stop import Arc, Circle, Polygon, Segment, Stop, rectangle, regular_polygon

ROOT3 = math.sqrt(3)
L = ((-0.5, -0.5), (-0.5, 0.5), (0.0, 0.5), (0.0, 0.0), (0.5, 0.0), (0.5, -0.5))
U = (
    (-0.6, -0.6), (-0.6, 0.6), (0.6, 0.6), (0.6, 0.2),
    (-0.2, 0.2), (-0.2, -0.2), (0.6, -0.2), (0.6, -0.6),
)  # fmt: skip


def cap(distance: float, radius: float = 1.0) -> float:
    """What a line at a distance from the centre cuts off a disc; more than half if negative."""
    share = distance / radius
    return radius**2 * (math.acos(share) - share * math.sqrt(1 - share**2))


def band(height: float) -> float:
    """A strip through the middle of the unit disc."""
    return math.pi - 2 * cap(height / 2)


def lens(distance: float, one: float, other: float) -> float:
    """What two discs have in common: a cap of each, cut by the line through the crossings."""
    along = (distance**2 + one**2 - other**2) / (2 * distance)
    return cap(along, one) + cap(distance - along, other)


def turned(shape: Polygon, angle: float, shift=(0.0, 0.0)) -> Polygon:
    """From x towards y, and then moved."""
    c, s = math.cos(angle), math.sin(angle)
    return Polygon(
        tuple((y * c + x * s + shift[0], x * c - y * s + shift[1]) for y, x in shape.corners)
    )


def vane(angle: float, width: float, start: float = 0.0, end: float = 1.2) -> Polygon:
    """A bar along a ray from the centre."""
    return turned(rectangle(width, end - start, (0.0, (start + end) / 2)), angle)


OPENINGS = {
    "a disc": (Circle(), math.pi),
    "a disc off the middle": (Circle(0.3, (0.5, -0.2)), 0.09 * math.pi),
    "a rectangle": (rectangle(0.7, 1.2, (0.1, -0.2)), 0.84),
    "a triangle": (regular_polygon(3), 3 * ROOT3 / 4),
    "a square": (regular_polygon(4, 0.8, 0.3), 2 * 0.64),
    "a hexagon": (regular_polygon(6, 1.0, 0.1), 1.5 * ROOT3),
    "a polygon of 17 sides": (regular_polygon(17, 0.9), 8.5 * 0.81 * math.sin(2 * math.pi / 17)),
    "an L": (Polygon(L), 0.75),
    "a U": (Polygon(U), 1.12),
}

IN_A_DISC = {
    "a disc": (Circle(0.4), 0.16 * math.pi),
    "a disc off the middle": (Circle(0.3, (0.2, -0.4)), 0.09 * math.pi),
    "a disc that touches the edge": (Circle(0.3, (0.7, 0.0)), 0.09 * math.pi),
    "a disc across the edge": (Circle(0.5, (0.3, 0.8)), lens(math.hypot(0.3, 0.8), 1, 0.5)),
    "a large disc from outside": (Circle(3.0, (-3.2, 1.0)), lens(math.hypot(3.2, 1.0), 1, 3.0)),
    "a disc whose middle lies on the edge": (Circle(1.0, (1.0, 0.0)), lens(1.0, 1, 1)),
    "a disc elsewhere": (Circle(0.5, (2.0, 0.0)), 0.0),
    "a disc that touches from outside": (Circle(0.5, (0.0, 1.5)), 0.0),
    "a rectangle": (rectangle(0.2, 0.6, (0.3, 0.2)), 0.12),
    "a triangle around the middle": (regular_polygon(3, 0.5, 1.0), 0.75 * ROOT3 / 4),
    "a hexagon with corners on the edge": (regular_polygon(6), 1.5 * ROOT3),
    "a half plane": (rectangle(4.0, 2.0, (0.0, 1.3)), cap(0.3)),
    "a half plane beyond the middle": (rectangle(4.0, 3.0, (0.0, 1.1)), math.pi - cap(0.4)),
    "a half plane through the middle": (rectangle(4.0, 2.0, (0.0, -1.0)), math.pi / 2),
    "a quadrant": (rectangle(2.0, 2.0, (1.0, 1.0)), math.pi / 4),
    "three quadrants": (
        Polygon(((-2, -2), (-2, 2), (0, 2), (0, 0), (2, 0), (2, -2))),
        0.75 * math.pi,
    ),
    "a sector": (Polygon(((0, 0), (0, 3), (3 * math.tan(0.7), 3))), 0.35),
    "a strip across": (rectangle(0.1, 2.4), band(0.1)),
    "a turned strip across": (turned(rectangle(0.1, 2.4), 0.7), band(0.1)),
    "a strip off the middle": (rectangle(0.2, 5.0, (0.5, 0.0)), cap(0.4) - cap(0.6)),
    "a vane from the middle": (vane(1.0, 0.06), band(0.06) / 2),
    "a square whose corners look out": (rectangle(1.6, 1.6), math.pi - 4 * cap(0.8)),
    "a square that touches from outside": (rectangle(0.5, 0.5, (0.0, 1.25)), 0.0),
    "a square beside": (rectangle(0.5, 0.5, (1.1, 1.1)), 0.0),
    "a bar with two corners on the edge": (rectangle(0.5, 1.6, (0.85, 0.0)), cap(0.6)),
    "a U": (turned(Polygon(U), 0.3), 1.12),
}  # fmt: skip


def test_the_geometry_of_the_judges_is_right():
    """The lens of Goodman 6.3, and a disc that is cut in two."""
    assert lens(1.0, 1, 1) == pytest.approx(2 * math.pi / 3 - ROOT3 / 2, abs=1e-15)
    assert cap(0.3) + cap(-0.3) == pytest.approx(math.pi, abs=1e-15)


@pytest.mark.parametrize("name", OPENINGS)
def test_an_opening_has_its_area(name):
    shape, area = OPENINGS[name]
    assert Stop(shape).area == pytest.approx(area, abs=1e-14)


@pytest.mark.parametrize("name", IN_A_DISC)
def test_an_obscuration_takes_what_it_covers_of_a_disc(name):
    shape, area = IN_A_DISC[name]
    assert Stop(Circle(), (shape,)).area == pytest.approx(math.pi - area, abs=1e-13)


@pytest.mark.parametrize("name", IN_A_DISC)
def test_size_and_place_of_the_opening_scale_the_area(name):
    shape, area = IN_A_DISC[name]
    k, (y, x) = 0.37, (0.4, -0.3)
    if isinstance(shape, Circle):
        small = Circle(k * shape.radius, (k * shape.centre[0] + y, k * shape.centre[1] + x))
    else:
        small = Polygon(tuple((k * v + y, k * u + x) for v, u in shape.corners))
    stop = Stop(Circle(k, (y, x)), (small,))
    assert stop.area == pytest.approx(k**2 * (math.pi - area), abs=1e-13)


def overlap_in_rows(circle: Circle, corners: np.ndarray) -> float:
    """Of a disc and a triangle: the common part of two chords, row by row."""

    def width(y: float) -> float:
        half = math.sqrt(max(circle.radius**2 - (y - circle.centre[0]) ** 2, 0.0))
        ends = []
        for (y0, x0), (y1, x1) in zip(corners, np.roll(corners, 1, axis=0), strict=True):
            if (y0 > y) != (y1 > y):
                ends.append(x0 + (y - y0) * (x1 - x0) / (y1 - y0))
        if len(ends) < 2:
            return 0.0
        left = max(min(ends), circle.centre[1] - half)
        return max(min(max(ends), circle.centre[1] + half) - left, 0.0)

    low, high = circle.centre[0] - circle.radius, circle.centre[0] + circle.radius
    kinks = [y for y in corners[:, 0] if low < y < high]
    return quad(width, low, high, points=kinks or None, limit=1000, epsabs=1e-9)[0]


@pytest.mark.parametrize("seed", range(12))
def test_any_triangle_and_disc_overlap_as_their_chords_do(seed):
    rng = np.random.default_rng(seed)
    corners = rng.uniform(-1.3, 1.3, (3, 2))
    opening = Circle(0.7, tuple(rng.uniform(-0.2, 0.2, 2)))
    stop = Stop(opening, (Polygon(tuple(map(tuple, corners))),))
    covered = overlap_in_rows(opening, corners)
    assert stop.area == pytest.approx(0.49 * math.pi - covered, abs=1e-6)


def test_two_crossing_vanes_share_a_square():
    for angle in (0.0, 0.4):
        vanes = (turned(rectangle(0.1, 3.0), angle), turned(rectangle(3.0, 0.06), angle))
        truth = math.pi - band(0.1) - band(0.06) + 0.1 * 0.06
        assert Stop(Circle(), vanes).area == pytest.approx(truth, abs=1e-13)


def test_vanes_may_cross_at_the_edge():
    """A corner of their common square lies beyond it."""
    d = 0.7
    vanes = (rectangle(0.2, 3.0, (d, 0.0)), rectangle(3.0, 0.2, (0.0, d)))

    def height(x: float) -> float:
        return max(min(math.sqrt(1 - x * x), d + 0.1) - (d - 0.1), 0.0)

    kinks = [math.sqrt(1 - (d + 0.1) ** 2)]
    shared = quad(height, d - 0.1, d + 0.1, points=kinks, epsabs=1e-13)[0]
    truth = math.pi - 2 * (cap(d - 0.1) - cap(d + 0.1)) + shared
    assert Stop(Circle(), vanes).area == pytest.approx(truth, abs=1e-10)


def test_vanes_that_begin_at_a_central_obscuration_are_cut_by_it():
    """Outside a disc of radius a, a vane is half a strip between two circles."""
    a, width = 0.3, 0.08
    strip = band(width) / 2 - a**2 * band(width / a) / 2
    vanes = tuple(vane(0.2 + k * math.pi / 2, width, start=0.25) for k in range(4))
    truth = math.pi * (1 - a**2) - 4 * strip
    assert Stop(Circle(), (Circle(a), *vanes)).area == pytest.approx(truth, abs=1e-13)


@pytest.mark.parametrize("count", [3, 4])
def test_vanes_that_meet_in_the_middle_do_not_count_as_three(count):
    """Their corners touch; neighbours share a kite with two right angles next to the centre."""
    w = 0.1
    pair = (w / 2) ** 2 / math.tan(math.pi / count)
    truth = math.pi - count * band(w) / 2 + count * pair
    for turn in np.linspace(0.0, 3.0, 16):
        vanes = tuple(vane(turn + 2 * math.pi * k / count, w) for k in range(count))
        assert Stop(Circle(), vanes).area == pytest.approx(truth, abs=1e-13)


def test_a_hexagon_with_a_round_obscuration():
    assert Stop(regular_polygon(6), (Circle(0.4),)).area == pytest.approx(
        1.5 * ROOT3 - 0.16 * math.pi, abs=1e-14
    )
    # Larger than the inscribed circle: six caps of it lie outside.
    r = 0.9
    covered = math.pi * r**2 - 6 * cap(ROOT3 / 2, r)
    assert Stop(regular_polygon(6), (Circle(r),)).area == pytest.approx(
        1.5 * ROOT3 - covered, abs=1e-13
    )


def test_a_disc_from_outside_bites_a_rectangle():
    stop = Stop(rectangle(1.2, 1.2), (Circle(1.0, (0.0, 1.4)),))
    # From x = 0.4 to 0.6, as high as the rectangle at most.
    assert stop.area == pytest.approx(1.44 - cap(0.8), abs=1e-13)


def test_vanes_cross_a_rectangle():
    vanes = (rectangle(0.1, 3.0), rectangle(3.0, 0.2, (0.0, 0.1)))
    truth = 1.2 * 1.0 - 0.1 * 1.0 - 0.2 * 1.2 + 0.02
    assert Stop(rectangle(1.2, 1.0), vanes).area == pytest.approx(truth, abs=1e-14)


def test_polygons_of_all_kinds_overlap():
    """A square with another square: inside, on a corner, turned by 45 degrees, beside."""
    square = rectangle(1.0, 1.0)
    for shape, covered in (
        (rectangle(0.5, 0.5, (0.1, 0.1)), 0.25),
        (rectangle(0.5, 0.5, (0.5, 0.5)), 0.0625),
        (regular_polygon(4, 0.6), 0.72 - 4 * 0.1**2),
        (rectangle(0.5, 0.5, (0.0, 0.75)), 0.0),
        (rectangle(0.5, 0.5, (0.0, 0.25)), 0.25),
    ):
        assert Stop(square, (shape,)).area == pytest.approx(1 - covered, abs=1e-14)


@pytest.mark.parametrize("seed", range(20))
def test_a_vane_may_cut_a_u_in_two_places(seed):
    """At any angle: collinear sides are no crossing, whichever way they are rounded."""
    angle = np.random.default_rng(seed).uniform(0, 2 * math.pi)
    cut = turned(rectangle(0.1, 1.6, (0.3, 0.0)), angle)
    opening = turned(Polygon(U), angle)
    assert Stop(opening, (cut,)).area == pytest.approx(1.12 - 2 * 0.04, abs=1e-13)
    assert Stop(Circle(), (opening, cut)).area == pytest.approx(
        math.pi - 1.12 - 1.6 * 0.1 + 0.08, abs=1e-13
    )


def test_two_discs_may_overlap_inside():
    stop = Stop(Circle(), (Circle(0.3, (0.1, 0.0)), Circle(0.2, (0.0, 0.3))))
    truth = math.pi * (1 - 0.09 - 0.04) + lens(math.hypot(0.1, 0.3), 0.3, 0.2)
    assert stop.area == pytest.approx(truth, abs=1e-13)


def test_one_disc_may_hide_another():
    stop = Stop(Circle(), (Circle(0.3, (0.1, 0.0)), Circle(0.1, (0.2, 0.0))))
    assert stop.area == pytest.approx(0.91 * math.pi, abs=1e-13)


def test_shapes_that_cut_the_edge_in_different_places_need_no_common_part():
    bites = (Circle(0.3, (0.0, 1.0)), Circle(0.3, (0.0, -1.0)), vane(math.pi / 2, 0.1))
    truth = math.pi - 2 * lens(1.0, 1, 0.3) - band(0.1) / 2
    assert Stop(Circle(), bites).area == pytest.approx(truth, abs=1e-13)


def test_a_corner_may_be_shared_by_three_where_two_of_them_only_touch():
    shapes = (rectangle(0.4, 0.4, (0.2, 0.2)), rectangle(0.4, 0.4, (0.2, -0.2)), Circle(0.3))
    truth = math.pi - 0.32 - 0.09 * math.pi / 2
    assert Stop(Circle(), shapes).area == pytest.approx(truth, abs=1e-13)


STOPS = {
    **{name: Stop(shape) for name, (shape, _) in OPENINGS.items()},
    **{f"without {name}": Stop(Circle(), (shape,)) for name, (shape, _) in IN_A_DISC.items()},
    "hexagon, disc and vanes": Stop(
        regular_polygon(6, turn=0.2), (Circle(0.3), vane(0.3, 0.1, 0.25), vane(2.5, 0.07, 0.2))
    ),
    "L, cut by a disc": Stop(Polygon(L), (Circle(0.3, (0.2, 0.1)),)),
}


@pytest.mark.parametrize("name", STOPS)
def test_as_many_points_are_inside_as_the_area_says(name):
    stop, at = STOPS[name], np.linspace(-1.01, 1.01, 701)
    # Rows of points along a side would all be in or all be out.
    c, s = math.cos(0.123), math.sin(0.123)
    y, x = at[:, None] * c + at * s, at * c - at[:, None] * s
    open_at = stop.opening.contains(y, x)
    for shape in stop.obscurations:
        open_at = open_at & ~shape.contains(y, x)
    assert open_at.sum() * (at[1] - at[0]) ** 2 == pytest.approx(stop.area, abs=2e-3)


def test_points_are_told_from_those_outside():
    y, x = np.array([0.0, 0.4, 0.4, 2.0, -0.4]), np.array([0.4, 0.4, -0.4, 0.0, 0.4])
    assert Polygon(L).contains(y, x).tolist() == [False, False, True, False, True]
    assert Circle(0.5).contains(y, x).tolist() == [True, False, False, False, False]


@pytest.mark.parametrize("corners", [L, U, regular_polygon(5).corners])
def test_corners_may_be_given_in_either_sense(corners):
    one, other = Polygon(tuple(corners)), Polygon(tuple(reversed(corners)))
    assert Stop(one).area == pytest.approx(Stop(other).area, abs=1e-15)
    for shape in (one, other):
        y, x = np.transpose(shape.corners)
        # From x towards y.
        assert np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y) > 0


def test_only_a_shape_without_dents_is_convex():
    assert regular_polygon(7, turn=1.0).is_convex
    assert turned(rectangle(0.1, 2.0), 0.3).is_convex
    assert Polygon(((0, 0), (0, 0.5), (0, 1), (1, 1), (1, 0))).is_convex
    assert not Polygon(L).is_convex
    assert not turned(Polygon(U), 0.8).is_convex


def test_a_blade_opening_has_its_corners_on_the_circle():
    y, x = np.transpose(regular_polygon(5, 0.8, 0.3).corners)
    assert np.allclose(np.hypot(y, x), 0.8, rtol=1e-15)
    assert math.atan2(y[0], x[0]) == pytest.approx(0.3)


def test_sides_are_known_of_an_upright_clear_rectangle_alone():
    assert Stop(rectangle(0.5, 1.0, (0.1, -0.2))).rectangle_bounds == pytest.approx(
        (-0.15, 0.35, -0.7, 0.3)
    )
    other = Polygon(((0.5, 0.2), (-0.5, 0.2), (-0.5, -0.3), (0.5, -0.3)))
    assert Stop(other).rectangle_bounds == (-0.5, 0.5, -0.3, 0.2)
    for stop in (
        Stop(),
        Stop(regular_polygon(4)),
        Stop(regular_polygon(6)),
        Stop(Polygon(L)),
        Stop(Polygon(((0, 0), (0, 0.5), (0.5, 0.6), (0.5, 0)))),
        Stop(rectangle(1, 1), (Circle(0.1),)),
    ):
        assert stop.rectangle_bounds is None


def test_rings_are_known_of_what_looks_the_same_in_all_directions():
    assert Stop().annulus_radii == (0, 1)
    assert Stop(Circle(0.8)).annulus_radii == (0, 0.8)
    assert Stop(Circle(0.9), (Circle(0.2),)).annulus_radii == (0.2, 0.9)
    for stop in (
        Stop(Circle(0.8, (0.1, 0.0))),
        Stop(Circle(), (Circle(0.2, (0.0, 0.1)),)),
        Stop(Circle(), (rectangle(0.1, 0.1),)),
        Stop(Circle(), (Circle(0.2), Circle(0.1, (0.0, 0.5)))),
        Stop(rectangle(1, 1)),
    ):
        assert stop.annulus_radii is None


PIECES = {
    "segment": Segment((0.3, -0.2), (-0.4, 0.9)),
    "arc": Arc((0.1, -0.2), 0.7, 0.4, 2.9),
    "arc backwards": Arc((0.1, -0.2), 0.7, 2.0, -3.5),
    "circle": Arc((0.0, 0.3), 0.5, 0.0, 2 * math.pi),
}


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("name", PIECES)
def test_a_piece_crosses_a_level_where_its_points_change_sides(name, axis):
    piece, levels = PIECES[name], np.array([-0.513, -0.17, 0.0213, 0.333, 2.0])
    found = piece.crossings(axis, levels)
    t = np.linspace(0, 1, 20001)
    along = piece.points(t)[axis]
    changes = np.concatenate([t[1:][np.diff(along > level)] for level in levels])
    assert np.allclose(np.sort(found), np.sort(changes), atol=1e-4)
    at = piece.points(found)[axis]
    assert np.abs(at[:, None] - levels).min(axis=1).max() <= 1e-14


@pytest.mark.parametrize("axis", [0, 1])
def test_a_side_along_a_level_does_not_cross_it(axis):
    ends = [(0.5, 0.1), (0.5, 0.9)]
    along, across = Segment(*ends), Segment(*(tuple(reversed(end)) for end in ends))
    assert (along, across)[axis].crossings(axis, np.array([0.5])).size == 0


@pytest.mark.parametrize("name", PIECES)
def test_the_velocity_of_a_piece_is_the_derivative_of_its_points(name):
    piece, t, step = PIECES[name], np.linspace(0.1, 0.9, 7), 1e-5
    ahead, behind = piece.points(t + step), piece.points(t - step)
    for speed, high, low in zip(piece.velocity(t), ahead, behind, strict=True):
        assert np.allclose(speed, (high - low) / (2 * step), atol=1e-7)


def test_every_boundary_is_closed():
    for loop in (loop for stop in STOPS.values() for loop in stop.loops):
        for one, following in zip(loop.pieces, loop.pieces[1:] + loop.pieces[:1], strict=True):
            end, start = one.points(np.array([1.0])), following.points(np.array([0.0]))
            assert np.allclose(end, start, atol=1e-12)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Circle(0.0), "radius is 0; it must be positive and finite"),
        (lambda: Circle(-2.0), "radius is -2; it must be positive"),
        (lambda: Circle(math.inf), "radius is inf; it must be positive and finite"),
        (lambda: Circle(math.nan), "radius is nan"),
        (lambda: Circle(0.5, (math.nan, 0.0)), r"centre is \(nan, 0.0\); it must be finite"),
        (lambda: Polygon(((0, 0), (1, 1))), "has 2 corners; give three or more"),
        (lambda: Polygon(((0, 0), (1, math.inf), (1, 0))), "corners must be finite numbers"),
        (lambda: Polygon(((0, 0), (0.3, 0.3), (0.5, 0.5))), "lie in a line; it has no area"),
        (lambda: Polygon(((0, 0), (0.5, 0.5), (0.5, 0.5))), "lie in a line; it has no area"),
        (
            lambda: Polygon(((0, 0), (0.5, 0.5), (0.5, 0), (0, 0.5))),
            "crosses itself; give its corners in order",
        ),
        (
            lambda: Polygon(((0, 0), (0.5, 0.5), (0.6, 0), (0, 0.2))),
            "crosses itself; give its corners in order",
        ),
        (
            lambda: Polygon(tuple(regular_polygon(5).corners[2 * k % 5] for k in range(5))),
            "crosses itself",
        ),
        (lambda: regular_polygon(2), "sides is 2; an opening has three or more"),
        (lambda: Stop(Circle(1.1)), "beyond the stop's radius, 1; scale it down"),
        (lambda: Stop(Circle(0.6, (0.0, 0.5))), "beyond the stop's radius, 1; scale it down"),
        (lambda: Stop(rectangle(1.5, 1.5)), "beyond the stop's radius, 1; scale it down"),
        (lambda: Stop(Circle(), (rectangle(3, 3),)), "close the stop: no light passes"),
        (lambda: Stop(Circle(0.5), (Circle(0.5),)), "close the stop: no light passes"),
        (lambda: Stop(regular_polygon(5), (Circle(),)), "close the stop: no light passes"),
        (
            lambda: Stop(rectangle(1, 1), tuple(rectangle(1, 1, (0, x)) for x in (-0.5, 0.5))),
            "close the stop: no light passes",
        ),
        (lambda: Stop(Polygon(U), (Polygon(L),)), "is convex; draw them as one"),
        (
            lambda: Stop(Circle(), (Circle(0.3, (0.0, 1.0)), Circle(0.3, (0.1, 1.0)))),
            "overlap beyond the opening; draw them as one polygon",
        ),
    ],
)  # fmt: skip
def test_what_is_no_stop_is_refused(make, words):
    with pytest.raises(ValueError, match=words):
        make()


@pytest.mark.parametrize(
    "shapes",
    [
        # Hairs; a grid of points would hardly find what they share.
        [vane(0.3 + math.pi * k / 3, 0.002, -1.2) for k in range(3)],
        [turned(vane(0.3 + math.pi * k / 3, 0.002, -1.2), 0, (0.0023, 0.0027)) for k in range(3)],
        [Circle(0.2), rectangle(0.1, 3), rectangle(3, 0.1)],
        [Circle(0.3), Circle(0.3, (0.1, 0.0)), rectangle(0.1, 3)],
        [Circle(0.4, (0.0, 0.9)), rectangle(0.1, 3), rectangle(3, 0.1, (0.0, 0.9))],
    ],
)
def test_three_obscurations_that_overlap_are_refused(shapes):
    with pytest.raises(ValueError, match="three obscurations overlap; end vanes where others"):
        Stop(Circle(), tuple(shapes))


def test_three_may_overlap_beyond_the_opening():
    """A vane's end and what holds it there; nothing of it shows."""
    mount = [rectangle(0.3, 0.3, (0.0, 1.25)), turned(rectangle(0.3, 0.3), 0.3, (0.0, 1.25))]
    stop = Stop(Circle(), (vane(0.0, 0.1, end=1.3), *mount))
    assert stop.area == pytest.approx(math.pi - band(0.1) / 2, abs=1e-13)


def test_stops_of_many_parts_are_drawn_in_no_time():
    """4000 blades, and 90 spots of which none touch; a third spot on a pair is still found."""
    assert regular_polygon(4000).is_convex
    spots = [
        Circle(0.03, (0.8 * y, 0.8 * x))
        for y in np.linspace(-1, 1, 11)
        for x in np.linspace(-1, 1, 11)
        if math.hypot(y, x) <= 1
    ]
    stop = Stop(Circle(), tuple(spots))
    assert stop.area == pytest.approx(math.pi * (1 - len(spots) * 0.03**2))
    more = (*spots, *(Circle(0.03, (0.0, x)) for x in (0.01, 0.02)))
    with pytest.raises(ValueError, match="three obscurations overlap"):
        Stop(Circle(), more)
