"""Red is saturated and blue is zero, pixel for pixel, whatever the contrast."""

import numpy as np
import pytest
from eyes import pixels
from waits import wait_until

from labapp.window.frame_reduction import reduce_frame
from labapp.window.live_view import LiveView
from labapp.window.messages import LiveFrame, LivePicture
from labapp.window.tone_mapping import BLACK, SATURATED, DigitalScale

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


def picture_of(image, view):
    """A frame as the engine sends it, which knows the view from before the frame's size."""
    frame = LiveFrame(image, "star", "neutral", 550e-9, 0.1, 1)
    return LivePicture(frame, reduce_frame(image, view.view, DigitalScale(_FULL)))


@pytest.fixture
def view(dark_theme, qtbot):
    view = LiveView()
    qtbot.addWidget(view)
    view.resize(900, 760)
    view.show()
    wait_until(lambda: view.windowHandle().isExposed())
    view.set_scale(DigitalScale(_FULL))
    return view


@pytest.mark.parametrize("levels", [None, (1000.0, 2000.0), (0.0, 65535.0)])
def test_marks_are_exactly_where_raw_data_is_clipped(view, raw, levels):
    view.show_picture(picture_of(raw, view))
    if levels is not None:
        view.set_levels(*levels)
    view.caption.hide()

    def marks_are_right():
        places = [
            [view.picture.pixel_position(r, c).toPoint() for c in range(60)] for r in range(40)
        ]
        y, x = (np.array([[getattr(p, axis)() for p in row] for row in places]) for axis in "yx")
        colours = pixels(view.picture)[y, x]
        red, blue = ((colours == colour).all(axis=2) for colour in (SATURATED, BLACK))
        grey = (colours == colours[..., :1]).all(axis=2)
        between = (raw > 0) & (raw < _FULL)
        wanted = ((red, raw >= _FULL), (blue, raw == 0), (grey, between))
        return all(np.array_equal(seen, there) for seen, there in wanted)

    wait_until(marks_are_right)


def test_the_share_of_saturated_pixels_counts_every_one(view, raw):
    view.show_picture(picture_of(raw, view))
    assert f"({int((raw >= _FULL).sum())} px)" in view.frame_reading.text()


def test_a_picture_that_comes_late_does_not_look_live(view, raw):
    """As the last one of a run does, whose end was told while it was on its way."""
    view.show_picture(picture_of(raw, view))
    assert "STOPPED" not in view.caption.text()
    view.set_live(False)
    view.show_picture(picture_of(raw, view))
    assert "STOPPED" in view.caption.text()
    view.set_live(False, in_run=True)
    assert "STOPPED" not in view.caption.text()


def test_marks_can_be_taken_off(view, raw):
    view.show_picture(picture_of(raw, view))
    for marked in (True, False):
        view.set_clipping_marks(marked)
        wait_until(lambda on=marked: is_red(view).any() == on)


def is_red(view):
    """Where the screen shows the colour of saturated pixels."""
    return (pixels(view.picture) == SATURATED).all(axis=2)


def test_no_saturated_pixel_is_lost_in_a_large_picture(view):
    random = np.random.default_rng(5)
    image = np.full((2000, 3000), 500, np.uint16)
    places = random.integers(20, 1980, (30, 2))
    image[places[:, 0], places[:, 1]] = _FULL
    for _ in range(2):  # the first picture of a size sets the zoom
        view.show_picture(picture_of(image, view))
    view.caption.hide()

    def all_are_red():
        red = is_red(view)
        points = [
            view.picture.pixel_position(int(row), int(column)).toPoint() for row, column in places
        ]
        return all(red[p.y() - 1 : p.y() + 2, p.x() - 1 : p.x() + 2].any() for p in points)

    wait_until(all_are_red)
