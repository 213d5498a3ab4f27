"""Copies of test pictures among training pictures are found, and other photographs are not."""

from __future__ import annotations

import functools

import cv2
import numpy as np
import pytest
from skimage import data

from labapp.common.errors import UserError
from labapp.training.fingerprints import (
    fingerprint,
    read_test_fingerprints,
    write_fingerprints,
)
from labapp.training.near_duplicates import THRESHOLD, NearDuplicateFinder
from labapp.training.pictures import read_training_data


def photograph(name: str):
    """(rows, columns, 3)."""
    return np.ascontiguousarray(getattr(data, name)()[..., :3])


def planes(picture):
    return np.ascontiguousarray(np.moveaxis(picture, -1, 0))


@functools.cache
def finder() -> NearDuplicateFinder:
    return NearDuplicateFinder([fingerprint(planes(photograph("chelsea")), "the cat")])


def compressed(picture, quality=30):
    return cv2.imdecode(cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, quality])[1], 1)


def resized(picture, factor):
    return cv2.resize(picture, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA)


def gamma(picture, power):
    return (255 * (picture / 255) ** power).astype(np.uint8)


def cropped(picture, share, down, right):
    rows, columns = (round(share * n) for n in picture.shape[:2])
    top, left = round(down * (picture.shape[0] - rows)), round(right * (picture.shape[1] - columns))
    return picture[top : top + rows, left : left + columns]


CHANGES = {
    "no change": lambda one: one,
    "strong compression": compressed,
    "a quarter of the size": lambda one: resized(one, 0.3),
    "one and a half times the size": lambda one: cv2.resize(one, None, fx=1.5, fy=1.5),
    "mirrored": lambda one: one[:, ::-1],
    "turned by 90 degrees": lambda one: np.rot90(one),
    "turned by 180 degrees and mirrored": lambda one: one[::-1],
    "darker": lambda one: (0.3 * one).astype(np.uint8),
    "brighter": lambda one: np.minimum(40 + 1.3 * one, 255).astype(np.uint8),
    "gamma of 2.2": lambda one: gamma(one, 2.2),
    "gamma of 0.45": lambda one: gamma(one, 0.45),
    "grey": lambda one: np.repeat(one.mean(2, keepdims=True), 3, 2).astype(np.uint8),
    "colours swapped": lambda one: one[..., ::-1],
    "negative": lambda one: 255 - one,
    "squeezed to a square": lambda one: cv2.resize(one, (200, 200)),
    "in a frame": lambda one: cv2.copyMakeBorder(one, 30, 30, 30, 30, cv2.BORDER_CONSTANT),
    "cropped at a corner": lambda one: cropped(one, 0.6, 0, 0),
    "cropped at the other corner": lambda one: cropped(one, 0.6, 1, 1),
    "all together": lambda one: compressed(
        gamma(np.rot90(resized(cropped(one, 0.6, 0.4, 0.7), 0.8))[:, ::-1], 1.8)
    ),
}


@pytest.mark.parametrize("change", CHANGES.values(), ids=CHANGES)
def test_copies_are_found(change):
    assert finder().find(planes(change(photograph("chelsea")))) == "the cat"


def test_a_picture_of_which_the_test_picture_is_a_part_is_found():
    part = cropped(photograph("coffee"), 0.6, 0.2, 0.9)
    found = NearDuplicateFinder([fingerprint(planes(part), "a part")])
    assert found.find(planes(photograph("coffee"))) == "a part"


@pytest.mark.parametrize("name", ["coffee", "astronaut", "rocket", "immunohistochemistry"])
def test_other_photographs_are_not_found(name):
    assert finder().scores(planes(photograph(name))).max() < THRESHOLD - 0.05


@pytest.mark.parametrize("level", [0, 128, 255])
def test_plain_pictures_resemble_nothing(level):
    plain = np.full((3, 60, 90), level, np.uint8)
    assert finder().find(plain) is None
    of_plain = NearDuplicateFinder([fingerprint(plain, "plain")])
    assert of_plain.find(plain) is None
    assert of_plain.find(planes(photograph("chelsea"))) is None


def test_a_test_picture_is_told_from_others():
    names = ("chelsea", "coffee", "rocket")
    several = NearDuplicateFinder([fingerprint(planes(photograph(n)), n) for n in names])
    for name in names:
        assert several.find(planes(resized(photograph(name), 0.5))) == name


def test_fingerprints_are_kept_in_a_file(tmp_path):
    made = fingerprint(planes(photograph("chelsea")), "the cat")
    write_fingerprints(tmp_path / "cat.npz", [made])
    (read,) = read_test_fingerprints([tmp_path / "cat.npz"])
    assert read.name == "the cat"
    np.testing.assert_array_equal(read.fine, made.fine)
    np.testing.assert_array_equal(read.coarse, made.coarse)
    assert (tmp_path / "cat.npz").stat().st_size < 8000


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "cannot be read as .npz"),
        (b"PK\x03\x04 cut off", "cannot be read as .npz"),
        ({"names": np.array(["a"]), "version": np.array(1)}, "not a file of fingerprints"),
        ({"names": np.array([]), "version": np.array(2)}, "version 2 of fingerprints"),
        (
            {
                "names": np.array(["a"]),
                "version": np.array(1),
                "fine_0": np.zeros((9, 9), np.int8),
                "coarse_0": np.zeros((9, 9), np.int8),
            },
            "not a file of fingerprints",
        ),
    ],
)
def test_bad_files_of_fingerprints_are_refused(tmp_path, content, words):
    path = tmp_path / "bad.npz"
    if isinstance(content, bytes):
        path.write_bytes(content)
    else:
        np.savez(path, **content)
    with pytest.raises(UserError, match=words):
        read_test_fingerprints([path])


def test_no_fingerprints_and_no_files_are_refused(tmp_path):
    with pytest.raises(UserError, match="no test picture"):
        NearDuplicateFinder([])
    for missing in ("missing.npz", "missing.png"):
        with pytest.raises(UserError, match="cannot be read"):
            read_test_fingerprints([tmp_path / missing])


def test_a_training_with_copies_of_test_pictures_is_refused(tmp_path):
    train, test = tmp_path / "train", tmp_path / "test"
    train.mkdir()
    test.mkdir()
    for name in ("coffee", "rocket", "astronaut"):
        cv2.imwrite(str(train / f"{name}.png"), photograph(name))
    cv2.imwrite(str(test / "cup.png"), photograph("coffee"))
    with pytest.raises(UserError, match=r"coffee.png: shows what the test picture cup.png shows"):
        read_training_data([train], test_pictures=[test])
    write_fingerprints(tmp_path / "cup.npz", read_test_fingerprints([test / "cup.png"]))
    with pytest.raises(UserError, match=r"cup\.png"):
        read_training_data([train], test_pictures=[tmp_path / "cup.npz"])
    (train / "coffee.png").unlink()
    _, manifest = read_training_data([train], test_pictures=[test])
    assert len(manifest.pictures) == 2
