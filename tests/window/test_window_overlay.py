"""Red is saturated and blue is zero, pixel for pixel, whatever the contrast."""

import numpy as np
import pytest
from eyes import pixels

from labapp.window.live_view import LiveView
from labapp.window.messages import LiveFrame
from labapp.window.theme import BLACK, SATURATED
from labapp.window.tone import Scale

_FULL, _BLACK_LEVEL = 4095, 64


@pytest.fixture
def raw():
    """Noise over the whole range, with neighbours of both limits strewn in."""
    random = np.random.default_rng(3)
    image = random.integers(1, _FULL, (40, 60))
    edges = np.array([0, 1, _BLACK_LEVEL, _FULL - 1, _FULL])
    chosen = random.random(image.shape) < 0.3
    image[chosen] = random.choice(edges, int(chosen.sum()))
    return image.astype(np.uint16)


@pytest.fixture
def view(dark_theme, qtbot):
    view = LiveView()
    qtbot.addWidget(view)
    view.resize(900, 760)
    with qtbot.waitExposed(view):
        view.show()
    view.set_scale(Scale(_FULL))
    return view


@pytest.mark.parametrize("levels", [None, (1000.0, 2000.0), (0.0, 65535.0)])
def test_marks_are_exactly_where_raw_data_is_clipped(view, raw, levels, qtbot):
    view.show_frame(LiveFrame(raw, "star", "neutral", 550e-9, 0.1, 1))
    if levels is not None:
        view.take_levels(*levels)
    view.caption.hide()
    qtbot.wait(50)
    seen = pixels(view.picture)
    places = [[view.picture.place_of(r, c).toPoint() for c in range(60)] for r in range(40)]
    colours = np.array([[seen[p.y(), p.x()] for p in row] for row in places])
    np.testing.assert_array_equal((colours == SATURATED).all(axis=2), raw >= _FULL)
    np.testing.assert_array_equal((colours == BLACK).all(axis=2), raw == 0)
    between = (raw > 0) & (raw < _FULL)
    grey = colours[between]
    assert (grey == grey[:, :1]).all()


def test_the_share_of_saturated_pixels_counts_every_one(view, raw):
    view.show_frame(LiveFrame(raw, "star", "neutral", 550e-9, 0.1, 1))
    assert f"({int((raw >= _FULL).sum())} px)" in view.frame_reading.text()


def test_marks_can_be_taken_off(view, raw, qtbot):
    view.show_frame(LiveFrame(raw, "star", "neutral", 550e-9, 0.1, 1))
    view.set_marked(False)
    qtbot.wait(50)
    seen = pixels(view.picture)
    assert not (seen == SATURATED).all(axis=2).any()


def test_no_saturated_pixel_is_lost_in_a_large_picture(view, qtbot):
    random = np.random.default_rng(5)
    image = np.full((2000, 3000), 500, np.uint16)
    places = random.integers(20, 1980, (30, 2))
    image[places[:, 0], places[:, 1]] = _FULL
    for _ in range(2):  # the first picture of a size sets the zoom
        view.show_frame(LiveFrame(image, "star", "neutral", 550e-9, 0.1, 1))
    view.caption.hide()
    qtbot.wait(50)
    red = (pixels(view.picture) == SATURATED).all(axis=2)
    for row, column in places:
        point = view.picture.place_of(int(row), int(column)).toPoint()
        assert red[point.y() - 1 : point.y() + 2, point.x() - 1 : point.x() + 2].any()
