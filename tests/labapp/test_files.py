"""Reading what people write and photograph."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from labapp.files.picture.colour_picture import read_scene_picture
from labapp.files.picture.encoding import SRGB


@pytest.mark.parametrize(
    ("dtype", "top", "encoding"), [(np.uint8, 255, None), (np.uint16, 65535, SRGB)]
)
def test_a_picture_becomes_linear_light(tmp_path, dtype, top, encoding):
    """sRGB (IEC 61966-2-1): half the code value is 21.4 % of the light; red comes first."""
    picture = np.zeros((2, 3, 3), dtype)
    picture[0, 0] = top
    picture[1, 2, 2] = round(top / 2)
    cv2.imwrite(str(tmp_path / "picture.png"), picture)
    linear = read_scene_picture(tmp_path / "picture.png", encoding)
    assert linear.shape == (2, 3, 3)
    assert linear[0, 0] == pytest.approx([1, 1, 1])
    assert linear[1, 2] == pytest.approx([0.2140, 0, 0], abs=2e-3)
    assert linear[0, 1].tolist() == [0, 0, 0]


def test_sixteen_bits_without_a_word_are_proportional_to_light(tmp_path):
    """As in every other command: half the number is half the light."""
    cv2.imwrite(str(tmp_path / "frame.png"), np.full((4, 4), 32768, np.uint16))
    assert read_scene_picture(tmp_path / "frame.png") == pytest.approx(0.5, abs=1e-5)


def test_a_grey_picture_has_three_equal_colours(tmp_path):
    cv2.imwrite(str(tmp_path / "grey.png"), np.full((4, 4), 255, np.uint8))
    assert read_scene_picture(tmp_path / "grey.png") == pytest.approx(np.ones((4, 4, 3)))
