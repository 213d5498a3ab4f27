"""A frame reduced to a screen: means and marks are right, and every pixel is counted."""

import numpy as np
import pytest

from labapp.window.frame_reduction import FrameView, reduce_frame
from labapp.window.tone_mapping import SATURATED_INDEX, DigitalScale

_FULL = 4095
_SCALE = DigitalScale(_FULL)
_WIDE = (0.0, 4096.0)


def raw(shape, seed=0):
    return np.random.default_rng(seed).integers(1, _FULL, shape, dtype=np.uint16)


@pytest.mark.parametrize("size", [(300, 400), (230, 411), (99, 130), (61, 53), (7, 9), (1, 1)])
def test_every_single_saturated_pixel_is_marked_and_none_is_invented(size):
    """Each alone in a picture of its own; a mark is at most a reduced pixel away from it."""
    shape = (613, 825)
    rng = np.random.default_rng(1)
    corners = [(0, 0), (0, 824), (612, 0), (612, 824)]
    places = corners + [tuple(place) for place in rng.integers(0, shape, (40, 2))]
    ratio = np.array(shape) / size
    for row, column in places:
        image = np.full(shape, 700, np.uint16)
        image[row, column] = _FULL
        shown = reduce_frame(image, FrameView(None, size, _WIDE), _SCALE)
        marks = np.argwhere(shown.indices == SATURATED_INDEX)
        assert shown.indices.shape == size
        assert shown.saturated == 1
        assert len(marks) >= 1
        away = np.abs((marks + 0.5) * ratio - (row + 0.5, column + 0.5))
        assert (away <= 1.5 * ratio + 1).all()


def test_a_frame_without_saturated_pixels_has_no_mark():
    shown = reduce_frame(raw((300, 400)), FrameView(None, (101, 133), _WIDE), _SCALE)
    assert shown.saturated == 0
    assert (shown.indices < SATURATED_INDEX).all()


def test_what_a_camera_sends_beyond_its_range_is_saturated():
    image = np.full((8, 8), 100, np.uint16)
    image[2, 3] = 65535
    shown = reduce_frame(image, FrameView(None, (8, 8), _WIDE), _SCALE)
    assert shown.saturated == 1
    assert shown.indices[2, 3] == SATURATED_INDEX


def test_halving_gives_the_mean_of_four_pixels():
    image = raw((64, 96))
    shown = reduce_frame(image, FrameView(None, (32, 48), _WIDE), _SCALE)
    mean = image.reshape(32, 2, 48, 2).mean(axis=(1, 3))
    # 254 greys over 4096 digital numbers: a rounded mean is within an index of the exact one.
    assert np.abs(shown.indices - (1 + 253 * mean / 4096)).max() <= 1


@pytest.mark.parametrize("size", [(75, 130), (31, 41), (11, 13)])
def test_reduced_pictures_keep_the_mean_and_average_the_noise(size):
    rng = np.random.default_rng(2)
    image = rng.normal(2000, 200, (300, 520)).astype(np.uint16)
    shown = reduce_frame(image, FrameView(None, size, _WIDE), _SCALE)
    assert abs(shown.indices.mean() - (1 + 253 * image.mean() / 4096)) < 1
    assert shown.indices.std() < 0.5 * 200 * 253 / 4096


def test_the_histogram_is_of_all_pixels_whatever_is_visible():
    image = raw((120, 160))
    image[100:, :] = _FULL
    shown = reduce_frame(image, FrameView((0, 0, 20, 30), (20, 30), _WIDE), _SCALE)
    counts, _ = np.histogram(image, bins=len(shown.counts), range=(0, 4096))
    assert np.array_equal(shown.counts, counts)
    assert shown.saturated == 20 * 160
    assert (shown.indices < SATURATED_INDEX).all()


def test_a_magnified_part_has_the_frames_own_pixels():
    image = raw((50, 60))
    shown = reduce_frame(image, FrameView((10, 20, 8, 9), (80, 90), _WIDE), _SCALE)
    assert shown.region == (10, 20, 8, 9)
    expected = 1 + np.rint(253 * (image[10:18, 20:29] / 4096))
    assert np.abs(shown.indices - expected).max() <= 1


@pytest.mark.parametrize(
    ("asked", "given"),
    [((-5, -5, 20, 20), (0, 0, 15, 15)), ((45, 55, 20, 20), (45, 55, 5, 5)),
     ((70, 5, 10, 10), (0, 0, 50, 60)), (None, (0, 0, 50, 60))],
)  # fmt: skip
def test_a_view_beyond_the_frame_is_clipped(asked, given):
    assert reduce_frame(raw((50, 60)), FrameView(asked, (99, 99), None), _SCALE).region == given


def test_zero_is_marked_where_all_pixels_are_zero():
    image = np.zeros((40, 40), np.uint16)
    image[:20] = 900
    shown = reduce_frame(image, FrameView(None, (20, 20), _WIDE), _SCALE)
    assert (shown.indices[11:] == 0).all()
    assert (shown.indices[:9] > 0).all()


def test_16_bit_cameras_count_single_numbers():
    image = np.full((30, 40), 65534, np.uint16)
    image[3, 4:6] = 65535
    shown = reduce_frame(image, FrameView(None, (30, 40), None), DigitalScale(65535))
    assert shown.saturated == 2
    assert (shown.indices == SATURATED_INDEX).sum() == 2
