"""Training pictures: what is read, listed and split, what is refused, and what is cut from them."""

from __future__ import annotations

import hashlib

import cv2
import numpy as np
import pytest

from labapp.common.errors import UserError
from labapp.files.picture.colour_picture import read_screen_colours
from labapp.training import pictures as pictures_module
from labapp.training.manifest import NOT_STATED, read_manifest, split_by_checksum
from labapp.training.pictures import TrainingPictures, read_training_data
from optics.progress import Cancelled, Progress


def noise(seed: int, rows: int = 40, columns: int = 50):
    return np.random.default_rng(seed).integers(0, 256, (rows, columns, 3)).astype(np.uint8)


@pytest.fixture
def folder(tmp_path):
    """Twelve pictures, some in a folder of their own, and a file that is none."""
    where = tmp_path / "photographs"
    (where / "inner").mkdir(parents=True)
    for number in range(12):
        inner = "inner/" if number % 3 == 0 else ""
        cv2.imwrite(str(where / f"{inner}{number:02}.png"), noise(number))
    (where / "README.txt").write_text("nothing to see")
    (where / "._00.png").write_bytes(b"left behind")
    return where


def read(folder, **options):
    return read_training_data([folder], smallest_side=32, **options)


def test_the_list_says_what_the_files_are(folder, tmp_path):
    pictures, manifest = read(folder)
    assert len(manifest.pictures) == 12
    assert [one.sha256 for one in manifest.pictures] == sorted(
        hashlib.sha256(file.read_bytes()).hexdigest() for file in folder.rglob("[01]*.png")
    )
    for one in manifest.pictures:
        data = (folder / one.path).read_bytes()
        assert (one.folder, one.bytes) == ("photographs", len(data))
        assert one.sha256 == hashlib.sha256(data).hexdigest()
    assert {one.split for one in manifest.pictures} == {"training", "validation"}
    manifest.write(tmp_path / "data.json")
    assert read_manifest(tmp_path / "data.json") == manifest
    assert pictures.patch(np.random.default_rng(0), 32, "validation").shape == (32, 32)


def test_names_and_folders_dont_change_a_training(folder, tmp_path):
    pictures, manifest = read(folder)
    other = tmp_path / "other"
    other.mkdir()
    for index, file in enumerate(sorted(folder.rglob("[01]*.png"), reverse=True)):
        file.rename(other / f"{index:02}.png")
    moved, listed = read(other)
    assert listed.digest == manifest.digest
    for seed in range(5):
        np.testing.assert_array_equal(
            moved.patch(np.random.default_rng(seed), 32),
            pictures.patch(np.random.default_rng(seed), 32),
        )
    next(other.iterdir()).unlink()
    assert read(other)[1].digest != manifest.digest


def test_one_picture_in_eight_is_for_validation():
    checksums = [hashlib.sha256(bytes([n % 256, n // 256])).hexdigest() for n in range(4000)]
    splits = split_by_checksum(checksums)
    count = sum(one == "validation" for one in splits.values())
    assert abs(count - 500) < 4 * np.sqrt(4000 / 8 * 7 / 8)
    fewer = split_by_checksum(checksums[::2])
    assert all(splits[one] == split for one, split in fewer.items())


@pytest.mark.parametrize("last", [1, 8])
def test_neither_split_is_empty(last):
    """All checksums are for training, or all for validation."""
    checksums = [f"{16 * n + last:064x}" for n in range(1, 4)]
    assert sorted(set(split_by_checksum(checksums).values())) == ["training", "validation"]


def test_licences_are_read(folder):
    (folder / "licences.toml").write_text(
        '"*.png" = "CC BY 4.0"\n"01.png" = "public domain"\n"inner/*" = "CC0"\n'
    )
    licences = {one.path: one.licence for one in read(folder)[1].pictures}
    assert licences["01.png"] == "public domain"
    assert licences["02.png"] == "CC BY 4.0"
    assert licences["inner/00.png"] == "CC BY 4.0"
    assert read(folder)[1].notes() == []


def test_a_missing_licence_is_mentioned(folder):
    (folder / "LICENCES.toml").write_text('"inner/*.png" = "CC0"\n')
    manifest = read(folder)[1]
    silent = [one for one in manifest.pictures if one.licence == NOT_STATED]
    assert len(silent) == 8
    assert "8 of 12 pictures have no stated licence" in manifest.notes()[0]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('"10.jpg" = "CC0"', "'10.jpg' fits no picture"),
        ('"01.png" = 3', "valid string"),
        ('"01.png" = ""', "at least 1 character"),
        ('["01.png"]\nlicence = "CC0"', "valid string"),
        ("01.png = ", "not valid TOML"),
    ],
)
def test_bad_licences_are_refused(folder, text, words):
    (folder / "licences.toml").write_text(text)
    with pytest.raises(UserError, match=words):
        read(folder)


def test_copies_are_left_out_and_mentioned(folder):
    (folder / "copy.png").write_bytes((folder / "01.png").read_bytes())
    manifest = read(folder)[1]
    assert len(manifest.pictures) == 12
    assert [(one.path, one.same_as) for one in manifest.left_out] == [("copy.png", "01.png")]
    assert "copy.png" in manifest.notes()[1]


def test_a_folder_named_twice_has_no_copies(folder):
    _, manifest = read_training_data([folder, folder / "inner"], smallest_side=32)
    assert len(manifest.pictures) == 12
    assert not manifest.left_out


def test_colours_and_depths_of_files(tmp_path):
    grey = np.arange(40 * 40, dtype=np.uint16).reshape(40, 40) * 40
    cv2.imwrite(str(tmp_path / "deep.tif"), grey)
    cv2.imwrite(str(tmp_path / "flat.png"), np.full((40, 40, 3), (0, 0, 255), np.uint8))
    decoded = {name: read_screen_colours(tmp_path / name) for name in ("deep.tif", "flat.png")}
    assert (decoded["flat.png"] == np.array([255, 0, 0])[:, None, None]).all()
    # 16 bits are proportional to light, which the screen's colours encode (IEC 61966-2-1).
    light = grey / 65535
    screen = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
    np.testing.assert_allclose(decoded["deep.tif"][1], 255 * screen, rtol=0, atol=0.501)


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("broken.png", b"not a picture", "broken.png: is not a picture"),
        ("empty.png", b"", "empty.png: is empty"),
        ("small.png", cv2.imencode(".png", noise(1, 31, 90))[1].tobytes(), "90 x 31 pixels"),
        ("float.tif", None, "light up to 1.5 times white"),
    ],
)
def test_files_that_are_no_use_are_refused(folder, name, content, words):
    if content is None:
        cv2.imwrite(str(folder / name), np.full((40, 40, 3), 1.5, np.float32))
    else:
        (folder / name).write_bytes(content)
    with pytest.raises(UserError, match=words):
        read(folder)


def test_folders_that_are_no_use_are_refused(tmp_path):
    with pytest.raises(UserError, match="Name one"):
        read_training_data([])
    with pytest.raises(UserError, match="nowhere: is not a folder"):
        read_training_data([tmp_path / "nowhere"])
    with pytest.raises(UserError, match="has no picture"):
        read_training_data([tmp_path])
    cv2.imwrite(str(tmp_path / "only.png"), noise(1))
    with pytest.raises(UserError, match=r"only one picture.*add another"):
        read_training_data([tmp_path])


def test_reading_can_be_cancelled(folder):
    progress = Progress()
    progress.cancel()
    with pytest.raises(Cancelled):
        read(folder, progress=progress)


def test_large_folders_are_averaged_down(folder, monkeypatch):
    cv2.imwrite(str(folder / "large.png"), noise(99, 300, 200))
    monkeypatch.setattr(pictures_module, "MEMORY_LIMIT", 100_000)
    monkeypatch.setattr(pictures_module, "_FIRST_LONGEST_SIDE", 400)
    manifest = read(folder)[1]
    assert manifest.longest_side == 100
    assert "longest side of 100 pixels" in manifest.notes()[-1]
    monkeypatch.setattr(pictures_module, "MEMORY_LIMIT", 30_000)
    with pytest.raises(UserError, match="Give fewer pictures"):
        read(folder)


def numbered(rows: int, columns: int, blue: int = 0):
    """Red is the row and green the column, so that a patch says where it was cut."""
    y, x = np.mgrid[:rows, :columns]
    return np.stack([y, x, np.full_like(x, blue)]).astype(np.uint8)


def cuts(pictures, side, count=60, split="training"):
    return [pictures.patch(np.random.default_rng((5, n)), side, split) for n in range(count)]


def test_patches_depend_on_the_generator_alone():
    pictures = TrainingPictures([numbered(60, 70), numbered(90, 80)], ["training", "training"])
    first, again = cuts(pictures, 24), cuts(pictures, 24)
    np.testing.assert_array_equal(first, again)
    assert len({one.tobytes() for one in first}) == 60
    assert {one.dtype for one in first} == {np.dtype(np.float32)}
    assert all(one.min() >= 0 and one.max() <= 1 for one in first)


def test_patches_are_turned_mirrored_cut_squares():
    """A patch is a plane whose slopes, in either order and sign, are the weights of the colours."""
    pictures = TrainingPictures([numbered(60, 200)], ["training"], (999, 999))
    kinds = set()
    for patch in cuts(pictures, 16):
        down, right = np.diff(patch, axis=0) * 255, np.diff(patch, axis=1) * 255
        np.testing.assert_allclose(down, down[0, 0], atol=1e-4)
        np.testing.assert_allclose(right, right[0, 0], atol=1e-4)
        assert abs(down[0, 0]) + abs(right[0, 0]) <= 1 + 1e-4
        kinds.add((bool(down[0, 0] > 0), bool(right[0, 0] > 0)))
    assert len(kinds) == 4


def test_cuts_are_averaged_down_and_never_up():
    """The slopes of the averaged cut sum to its factor, without the share of the flat blue."""
    pictures = TrainingPictures([numbered(100, 100, 0)], ["training"], (10, 999))
    slopes = []
    for patch in cuts(pictures, 30, 200):
        down, right = (np.abs(np.diff(patch, axis=axis)).mean() * 255 for axis in (0, 1))
        slopes.append(down + right)
    # A patch of 30 pixels can't take more than 100, and larger edges leave the picture as it is.
    assert 2.2 < max(slopes) < 100 / 30 + 0.1


def test_a_large_picture_doesnt_drown_small_ones():
    small = [numbered(64, 64) for _ in range(9)]
    large = np.full((3, 900, 900), 255, np.uint8)
    pictures = TrainingPictures([*small, large], ["training"] * 10)
    share = np.mean([patch.min() > 0.99 for patch in cuts(pictures, 32, 400)])
    # By area it would be 0.95; capped at four small ones' it is 4 / 13.
    assert abs(share - 4 / 13) < 4 * np.sqrt(4 / 13 * 9 / 13 / 400)


def test_pictures_smaller_than_a_patch_are_passed_over():
    small = np.zeros((3, 20, 90), np.uint8)
    pictures = TrainingPictures([numbered(64, 64, 255), small], ["training", "training"])
    assert all(patch.max() > 0 for patch in cuts(pictures, 32))
    with pytest.raises(UserError, match="No picture for training is as large"):
        pictures.patch(np.random.default_rng(0), 65)
    with pytest.raises(UserError, match="No picture for validation"):
        pictures.patch(np.random.default_rng(0), 32, "validation")
    with pytest.raises(UserError, match="give a side of 1 or more"):
        pictures.patch(np.random.default_rng(0), 0)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (([numbered(9, 9)], ["training", "training"]), "1 pictures and 2 splits"),
        (([numbered(9, 9)[0]], ["training"]), "give uint8"),
        (([numbered(9, 9) / 255], ["training"]), "give uint8"),
        (([numbered(9, 9)], ["training"], (0.5, 2)), "give 1 or more"),
        (([numbered(9, 9)], ["training"], (2, 1)), "the smaller one first"),
    ],
)
def test_bad_pictures_are_refused(arguments, words):
    with pytest.raises(UserError, match=words):
        TrainingPictures(*arguments)
