"""Files from outside: what is refused before it's read, and that good ones are read as before."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import zipfile
from pathlib import Path

import cv2
import h5py
import numpy as np
import pytest
import tifffile
from hostile import plain_files
from scipy.io import savemat

from labapp.common import free_memory
from labapp.common.errors import UserError
from labapp.files.array_file import read_npy, read_npz, require_plain_zip
from labapp.files.cubes import read_cube
from labapp.files.file_lookup import require_file
from labapp.files.guarded_reading import (
    FREE_EXPANSION,
    open_regular,
    read_bytes,
    require_memory,
    require_regular,
)
from labapp.files.number_file import read_matlab, read_numbers
from labapp.files.picture.headers import find_header
from labapp.files.picture.opening import count_pages
from labapp.files.picture.photograph import read_photograph
from labapp.files.plain_data import parse_json, parse_toml, require_plain
from labapp.files.plain_hdf5 import open_plain_hdf5, read_hdf5_arrays
from labapp.files.reading import read_text


def test_the_bytes_of_a_file_are_read_up_to_a_limit(tmp_path):
    path = tmp_path / "data"
    path.write_bytes(bytes(range(100)))
    assert read_bytes(path) == bytes(range(100))
    assert read_bytes(path, 100) == bytes(range(100))
    with pytest.raises(UserError, match=r"data: has 100 bytes, and such a file has at most 99"):
        read_bytes(path, 99)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (plain_files.pipe, "it is a named pipe. Give a regular file"),
        (plain_files.device, "it is a device"),
        (plain_files.directory, "it is a folder"),
        (plain_files.listener, "it is a socket"),
        (plain_files.missing, "there is no such file"),
        (plain_files.endless_name, "it is too long"),
    ],
)
def test_what_is_no_file_is_told(tmp_path, make, words):
    for read in (read_bytes, require_file, require_regular):
        with pytest.raises(UserError, match=words):
            read(make(tmp_path))


def test_a_link_to_a_file_is_that_file(tmp_path):
    (tmp_path / "data").write_bytes(b"x")
    (tmp_path / "link").symlink_to("data")
    assert read_bytes(tmp_path / "link") == b"x"
    (tmp_path / "circle").symlink_to("circle")
    with pytest.raises(UserError, match="circle: cannot be read"):
        read_bytes(tmp_path / "circle")


def test_a_path_with_a_nul_is_no_path(tmp_path):
    with pytest.raises(UserError, match="it has a NUL"):
        read_bytes(tmp_path / "a\0b")


def test_a_failure_while_a_file_is_read_is_told(tmp_path):
    (tmp_path / "data").write_bytes(b"x")
    with (
        pytest.raises(UserError, match="data: cannot be read: Input/output error"),
        open_regular(tmp_path / "data"),
    ):
        raise OSError(5, "Input/output error")


def test_a_file_of_holes_is_told_by_what_is_stored(tmp_path):
    path = tmp_path / "holes"
    path.write_bytes(b"begin")
    os.truncate(path, FREE_EXPANSION)
    assert len(read_bytes(path)) == FREE_EXPANSION
    os.truncate(path, FREE_EXPANSION + 1)
    with pytest.raises(UserError, match=r"would take 67.1 MB, and .* are stored"):
        read_bytes(path)


@pytest.mark.parametrize("data", [b"a\0b", b"\xe9\x01", b"\xff\xfe\0\x81"])
def test_what_is_no_text_is_told(tmp_path, data):
    (tmp_path / "file.toml").write_bytes(data)
    with pytest.raises(UserError, match=r"is not a text file\. Give a plan"):
        read_text(tmp_path / "file.toml", "a plan")


def test_plain_data_are_parsed_as_they_are():
    assert parse_toml('a.b = [1, 2.5, "x"]', "here") == {"a": {"b": [1, 2.5, "x"]}}
    assert parse_json('{"a": [null, true, -1e3]}', "here") == {"a": [None, True, -1000.0]}
    assert parse_json('"\\u00e9 \\ud83d\\ude00"', "here") == "é 😀"


@pytest.mark.parametrize("levels", [30, 31, 32, 400, 100_000])
@pytest.mark.parametrize("form", ["toml", "json"])
def test_data_may_have_32_levels(form, levels):
    nested = "[" * levels + "]" * levels
    parse = {"toml": parse_toml, "json": parse_json}[form]
    text = f"a = {nested}" if form == "toml" else f'{{"a": {nested}}}'
    if levels < 32:
        parse(text, "here")
    else:
        with pytest.raises(UserError, match="here: is nested in more than 32 levels"):
            parse(text, "here")


def test_keys_of_many_parts_are_too_deep():
    assert parse_toml("a" + ".a" * 20 + " = 1", "here")
    assert parse_toml(f"a = [{'0.5, ' * 10_000}]", "here"), "numbers have dots, too"
    with pytest.raises(UserError, match="levels"):
        parse_toml("a" + ". a" * 200_000 + " = 1", "here")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('"\\u0000"', "character U.0000"),
        ('"\\ud800"', "character U.D800"),
        ('{"\\ud800": 1}', "character U.D800"),
        ("9223372036854775808", "beyond 64 bits"),
        ("-9223372036854775809", "beyond 64 bits"),
        ("9" * 5000, "not valid JSON"),
        ("{", "not valid JSON"),
        ("[" + "[]," * 600_000 + "[]]", "more values"),
        ("[" + "1," * 4_000_001 + "1]", "more values"),
    ],
)
def test_data_that_cannot_be_kept_are_refused(text, words):
    with pytest.raises(UserError, match=f"here: .*{words}"):
        parse_json(text, "here")


def test_numbers_of_64_bits_are_kept():
    require_plain([2**63 - 1, -(2**63), {"a": 0}], "here")


@pytest.mark.parametrize("dtype", [np.uint8, np.float32, ">f8", np.int64])
def test_arrays_come_back_as_numpy_wrote_them(tmp_path, dtype):
    values = np.arange(24).reshape(2, 3, 4).astype(dtype)
    np.save(tmp_path / "a.npy", values)
    np.save(tmp_path / "f.npy", np.asfortranarray(values))
    np.savez_compressed(tmp_path / "a.npz", one=values, two=values[0])
    for name in ("a.npy", "f.npy"):
        np.testing.assert_array_equal(read_npy(tmp_path / name), values, strict=True)
    found = read_npz(tmp_path / "a.npz")
    assert sorted(found) == ["one", "two"]
    np.testing.assert_array_equal(found["one"], values, strict=True)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (plain_files.huge_npy, "cut short: 64 of 1000000000000 bytes"),
        (plain_files.object_npy, "Python objects"),
        (plain_files.hole_npy, "would take 1.07 GB"),
        (plain_files.empty, "cannot be read as a NumPy array"),
    ],
)
def test_what_is_no_array_is_told(tmp_path, make, words):
    with pytest.raises(UserError, match=words):
        read_npy(make(tmp_path))


def test_arrays_that_grow_are_refused_before_they_do(tmp_path):
    bomb = plain_files.bomb_npz(tmp_path)
    assert bomb.stat().st_size < 2e6
    for read in (read_npz, require_plain_zip):
        with pytest.raises(UserError, match="would take 210 MB"):
            read(bomb)
    with zipfile.ZipFile(tmp_path / "other.npz", "w", zipfile.ZIP_LZMA) as archive:
        archive.writestr("a.npy", b"x")
    with pytest.raises(UserError, match="compressed in another way"):
        read_npz(tmp_path / "other.npz")
    with pytest.raises(UserError, match=r"cannot be read as \.npz"):
        read_npz(plain_files.broken_npz(tmp_path))


def test_matlab_files_are_read_by_their_numbers(tmp_path):
    cube = np.arange(24.0).reshape(2, 3, 4)
    savemat(tmp_path / "a.mat", {"cube": cube, "note": "a text"}, do_compression=True)
    found = read_matlab(tmp_path / "a.mat")
    assert list(found) == ["cube"]
    np.testing.assert_array_equal(found["cube"], cube)
    with pytest.raises(UserError, match=r"bytes stand for \d+ MB and more"):
        read_matlab(plain_files.bomb_mat(tmp_path))
    with pytest.raises(UserError, match=r"cannot be read as \.mat"):
        read_matlab(plain_files.empty(tmp_path))


def picture_size(path):
    header = find_header(path.read_bytes())
    return None if header is None else (header.width, header.height)


@pytest.mark.parametrize("ending", [".png", ".jpg", ".bmp", ".webp"])
@pytest.mark.parametrize("colour", [False, True])
def test_the_size_of_a_picture_is_that_of_its_header(tmp_path, ending, colour):
    picture = np.random.default_rng(0).integers(0, 255, (37, 61, 3), dtype=np.uint8)
    path = tmp_path / f"picture{ending}"
    cv2.imwrite(str(path), picture if colour else picture[..., 0])
    assert picture_size(path) == (61, 37)
    # WebP has no grey pictures.
    bands = 3 if colour or ending == ".webp" else 1
    assert read_photograph(path).levels.shape == (bands, 37, 61)


@pytest.mark.parametrize("kind", [cv2.IMWRITE_JPEG_PROGRESSIVE, cv2.IMWRITE_JPEG_RST_INTERVAL])
def test_other_kinds_of_jpeg_and_webp_have_their_size(tmp_path, kind):
    picture = np.random.default_rng(0).integers(0, 255, (100, 130, 3), dtype=np.uint8)
    cv2.imwrite(str(tmp_path / "a.jpg"), picture, [kind, 1])
    assert picture_size(tmp_path / "a.jpg") == (130, 100)
    cv2.imwrite(str(tmp_path / "a.webp"), picture, [cv2.IMWRITE_WEBP_QUALITY, 101])
    assert picture_size(tmp_path / "a.webp") == (130, 100), "without loss"
    alpha = np.dstack([picture, picture[..., 0]])
    cv2.imwrite(str(tmp_path / "b.webp"), alpha, [cv2.IMWRITE_WEBP_QUALITY, 80])
    assert picture_size(tmp_path / "b.webp") == (130, 100), "with transparency"


def test_pages_have_their_own_sizes(tmp_path):
    with tifffile.TiffWriter(tmp_path / "pages.tiff") as file:
        file.write(np.zeros((8, 9), np.uint16))
        file.write(np.zeros((20, 30), np.uint16))
    path = tmp_path / "pages.tiff"
    assert count_pages(path, path.read_bytes()) == 2
    shapes = [read_photograph(path, page=page).levels.shape for page in (0, 1)]
    assert shapes == [(1, 8, 9), (1, 20, 30)]
    with pytest.raises(UserError, match=r"page 2: .* holds 2 pictures"):
        read_photograph(path, page=2)
    path = plain_files.tiff_circle(tmp_path)
    assert count_pages(path, path.read_bytes()) <= 2


@pytest.mark.parametrize(
    ("make", "size"),
    [
        (plain_files.png_header, (60_000, 60_000)),
        (plain_files.png_bomb, (30_000, 30_000)),
        (plain_files.jpeg_header, (65_500, 65_500)),
        (plain_files.bmp_header, (60_000, 60_000)),
        (plain_files.webp_header, (65_536, 65_536)),
        (plain_files.tiff_header, (60_000, 60_000)),
    ],
)
def test_a_picture_larger_than_its_file_is_refused(tmp_path, make, size):
    path = make(tmp_path)
    with pytest.raises(UserError, match=f"{size[0]} x {size[1]} pixels by its header"):
        read_photograph(path)


def test_a_large_black_picture_is_read(tmp_path):
    path = tmp_path / "black.png"
    cv2.imwrite(str(path), np.zeros((4000, 6000), np.uint8))
    assert path.stat().st_size < 1e5
    assert read_photograph(path).levels.shape == (1, 4000, 6000)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (plain_files.png_cut, "a PNG that is damaged, cut short"),
        (plain_files.gif, "65535 x 65535 pixels by its header"),
        (plain_files.empty, "is empty"),
    ],
)
def test_what_is_no_picture_is_refused_by_its_name(tmp_path, make, words):
    with pytest.raises(UserError, match=words):
        read_photograph(make(tmp_path))


def test_hdf5_files_of_others_are_read(tmp_path):
    cube = np.random.default_rng(0).random((20, 30, 8))
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_dataset("group/cube", data=cube, chunks=True, compression="gzip", shuffle=True)
        file["text"] = "of variable length"
        file.attrs["note"] = "x"
    np.testing.assert_array_equal(read_numbers(tmp_path / "a.h5", "group/cube"), cube)
    assert set(read_hdf5_arrays(tmp_path / "a.h5")) == {"group/cube", "text"}


def test_an_hdf5_file_that_is_none_is_told(tmp_path):
    with (
        pytest.raises(UserError, match="cannot be read as HDF5"),
        open_plain_hdf5(plain_files.empty(tmp_path)),
    ):
        pass


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (plain_files.many_bands_header, "Write 1000000000000000, one for each band"),
        (plain_files.blank_header, "has no 'bands'"),
    ],
)
def test_an_envi_header_does_not_ask_for_more_than_it_has(tmp_path, make, words):
    with pytest.raises(UserError, match=words):
        read_cube(make(tmp_path))


def test_the_figures_of_a_command_are_plain_data(tmp_path):
    """What labapp writes as JSON, it reads."""
    data = {"rows": [{"a": 1.5, "b": None, "c": "é\n"}] * 100}
    assert parse_json(json.dumps(data, indent=2), "here") == data


@pytest.mark.parametrize(
    ("stored", "whole", "pixels"),
    [
        (60_000, 96_000_000, 48_000_000),  # a star on black in 16 bits
        (60_000, 576_000_000, 300_000_000),
        (60_000, 192_000_000, None),
        (4_000_000, 400_000_000, None),
        (20_000_000, 1_300_000_000, 450_000_000),
    ],
)
def test_data_that_a_sensor_can_give_are_expanded(monkeypatch, stored, whole, pixels):
    monkeypatch.setattr(free_memory, "available_memory", lambda: 2_000_000_000)
    require_memory(Path("dark.png"), stored, whole, pixels=pixels)


@pytest.mark.parametrize(
    ("stored", "whole", "pixels", "words"),
    [
        (300, 3_600_000_000, 3_600_000_000, "would take 3.6 GB, and 300 bytes are stored"),
        (112_000, 900_000_000, 900_000_000, "would take 900 MB, and 112 kB are stored"),
        (900_000, 210_000_000, None, "would take 210 MB, and 900 kB are stored"),
        (50_000_000, 1_700_000_000, 100_000_000, "1.7 GB of memory, and 2 GB are free. Close"),
    ],
)
def test_more_than_a_sensor_gives_or_the_memory_holds_is_refused(
    monkeypatch, stored, whole, pixels, words
):
    monkeypatch.setattr(free_memory, "available_memory", lambda: 2_000_000_000)
    with pytest.raises(UserError, match=f"bomb.png: its picture would take .*{words}|{words}"):
        require_memory(Path("bomb.png"), stored, whole, "its picture", pixels=pixels)


def test_a_star_on_black_is_read_from_compressed_arrays(tmp_path):
    """Of 30 million pixels of 32 bits, in some kilobytes: more than 64 MiB."""
    star = np.zeros((4000, 7500), np.uint32)
    star[2000, 3000] = 40_000
    np.savez_compressed(tmp_path / "star.npz", star=star)
    assert 1000 * (tmp_path / "star.npz").stat().st_size < star.nbytes
    assert read_npz(tmp_path / "star.npz")["star"].max() == 40_000


def test_the_free_memory_is_what_every_limit_leaves(tmp_path, monkeypatch):
    free = free_memory.available_memory()
    assert 0 < free < 1 << 44
    folder = tmp_path / "box" / "inner"
    folder.mkdir(parents=True)
    (folder.parent / "memory.max").write_text("1000000\n")
    (folder.parent / "memory.current").write_text("900000\n")
    (folder.parent / "memory.stat").write_text("anon 5\ninactive_file 50000\n")
    (folder / "memory.max").write_text("max\n")
    (folder / "memory.current").write_text("100\n")
    names = ("memory.max", "memory.current", "inactive_file")
    assert list(free_memory._room_in_groups([folder, folder.parent], names)) == [150_000]
    monkeypatch.setattr(free_memory, "_group_memory", lambda: [150_000])
    assert free_memory.available_memory() == 150_000


def test_a_limit_of_the_process_is_told_before_a_file_is_read(tmp_path):
    np.save(tmp_path / "large.npy", np.zeros(40_000_000, np.float32))
    script = (
        "import resource; from pathlib import Path; from labapp.files.array_file import read_npy\n"
        "size = int(Path('/proc/self/statm').read_text().split()[0]) * resource.getpagesize()\n"
        "resource.setrlimit(resource.RLIMIT_AS, (size + 150_400_000, -1))\n"
        f"read_npy(Path({str(tmp_path / 'large.npy')!r}))\n"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert "would take 160 MB of memory, and 150 MB are free" in done.stderr
