"""`labapp merge` on brackets as cameras make them: times in words, motion, pages, 8-bit faults."""

from types import SimpleNamespace

import cv2
import numpy as np
import pytest
import tifffile
from judges.picture_files import make_file
from test_merge_command import NOISE, merged

from labapp.common.errors import UserError
from labapp.files.picture.photograph_writing import encode_png
from labapp.pictures.merging.bracket_files import SensorNumbers, read_bracket_files
from labapp.pictures.merging.exposure_facts import contradictions, times_of_files
from labapp.pictures.merging.exposure_words import parse_exposures

pytestmark = pytest.mark.usefixtures("white_sheets")

TIMES = (0.01, 0.03, 0.09, 0.27)


def scene():
    """A rise of two decades, and waves in all directions, which tell a shift."""
    rows, columns = np.indices((120, 160))
    rng, light = np.random.default_rng(1), np.linspace(-0.9, 1.1, 120)[:, None] * np.ones((1, 160))
    for _ in range(12):
        way, period = rng.uniform(0, np.pi), rng.uniform(9, 30)
        place = rows * np.sin(way) + columns * np.cos(way)
        light = light + 0.06 * np.sin(2 * np.pi * place / period + rng.uniform(0, 6.3))
    return 10**light


def write_pictures(folder, change=lambda light, number: light):
    rng, paths = np.random.default_rng(2), []
    for number, time in enumerate(TIMES):
        light = change(scene(), number)
        share = np.clip(light * time * 2 + rng.normal(0, 0.002, light.shape), 0, 1)
        paths.append(folder / f"{number}.png")
        cv2.imwrite(str(paths[-1]), np.rint(255 * share ** (1 / 2.2)).astype(np.uint8))
    return paths


@pytest.mark.parametrize(
    ("text", "seconds"),
    [
        ("1/250,1/60,0.25", [1 / 250, 1 / 60, 0.25]),
        ("4e-3, 2s ,1/8s", [0.004, 2, 0.125]),
        ("-2ev,0EV,+1.5 ev", [0.25, 1, 2**1.5]),
    ],
)
def test_times_are_seconds_fractions_or_steps(text, seconds):
    assert parse_exposures(text) == pytest.approx(seconds)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("1/250,1/x", "'1/x' isn't a time"),
        ("1/0,1", "'1/0' isn't a time"),
        ("0.1,,1", "'' isn't a time"),
        ("-2ev,0.1", r"'0.1' isn't in EV"),
        ("0.1,-1", "-1 can't be; all must be positive"),
    ],
)
def test_the_time_that_is_not_understood_is_named(text, words):
    with pytest.raises(UserError, match=words):
        parse_exposures(text)


def told(*exposures):
    return [
        SimpleNamespace(path=SimpleNamespace(name=f"{k}.jpg"), exposure=SimpleNamespace(
            exposure_time=time, f_number=number, iso=iso))
        for k, (time, number, iso) in enumerate(exposures)
    ]  # fmt: skip


def test_times_are_those_of_the_files_as_cameras_mean_them():
    times, notes = times_of_files(told((1 / 60, 8, 100), (1 / 15, 8, 100)), True)
    assert times == pytest.approx([1 / 64, 1 / 16])
    assert "1/64 s for 1/60 s" in notes[0]
    # A stop of aperture is half the light.
    photographs = told((1 / 8, 8, 100), (1 / 8, 4, 200))
    times, notes = times_of_files(photographs, True)
    assert times == pytest.approx([1 / 8, 1])
    assert "different apertures or ISO" in notes[1]
    with pytest.raises(UserError, match="different apertures or ISO numbers"):
        times_of_files(photographs, False)
    with pytest.raises(UserError, match=r"1\.jpg.*doesn't tell its exposure time"):
        times_of_files([*told((1, 8, 100)), SimpleNamespace(path="1.jpg", exposure=None)], True)


def test_told_times_that_contradict_the_files_are_named():
    photographs = told((1 / 60, 8, 100), (1 / 15, 8, 100), (1 / 4, 8, 100))
    assert contradictions(photographs, [1 / 64, 1 / 16, 1 / 4]) == []
    (words,) = contradictions(photographs, [1 / 60, 1 / 30, 1 / 4])
    assert words.startswith("--exposures says 0.03333 s for 1.jpg, which itself tells 0.06667 s")


def test_a_frame_that_moved_is_named_and_aligned(tmp_path):
    def change(light, number):
        return np.roll(light, (2, -3), (0, 1)) if number == 1 else light

    paths = write_pictures(tmp_path, change)
    arguments = [*paths, "--exposures", "0.01,0.03,0.09,0.27", "--out", tmp_path / "m.h5"]
    said = merged(arguments)
    assert said["motion"]["moved"] == [2]
    assert any("frame 2 moved 2 px down and -3 px right" in one and "--align" in one
               for one in said["warnings"])  # fmt: skip
    aligned = merged([*arguments, "--align", "--force"])
    assert aligned["motion"]["aligned"]
    assert len(aligned["warnings"]) == 1
    assert any("registered to frame" in one for one in aligned["notes"])
    assert aligned["states"]["MOVED"] < 0.2 * said["states"]["MOVED"]


def test_a_wrong_time_of_8_bit_pictures_is_named_and_corrected_unless_it_is_trusted(tmp_path):
    paths = write_pictures(tmp_path)
    arguments = [*paths, "--exposures", "0.01,0.03,0.06,0.27", "--out", tmp_path / "m.h5"]
    said = merged(arguments)
    assert said["time_check"]["suspects"] == [3]
    assert said["time_check"]["corrections"][2] == pytest.approx(1.5, rel=0.02)
    assert any(one.startswith("frame 3 has 1.5 times the light") for one in said["warnings"])
    assert merged([*arguments, "--as-given", "--force"])["time_check"] is None


def test_the_pages_of_a_tiff_are_a_bracket(tmp_path):
    rng = np.random.default_rng(3)
    rate = 1e5 * scene()
    pages = [
        np.clip(np.rint((rng.poisson(rate * t) + rng.normal(0, 2.4, rate.shape)) / 2.6 + 64),
                0, 4095).astype(np.uint16)
        for t in (1e-3, 4e-3)
    ]  # fmt: skip
    tifffile.imwrite(tmp_path / "s.tif", np.stack(pages), photometric="minisblack")
    arguments = ["--exposures", "1/1000,0.004", *NOISE, "--out", tmp_path / "m.h5", "--force"]
    said = merged([tmp_path / "s.tif", *arguments])
    assert said["files"] == ["s.tif, page 1", "s.tif, page 2"]
    assert said["motion"]["moved"] == []
    tifffile.imwrite(tmp_path / "one.tif", pages[0])
    with pytest.raises(UserError, match=r"s\.tif: has 2 pages"):
        merged([tmp_path / "s.tif", tmp_path / "one.tif", *arguments])
    with pytest.raises(UserError, match="3 times for 2 pages"):
        merged([tmp_path / "s.tif", "--exposures", "1,2,3", *NOISE, "--out", tmp_path / "n.h5"])


def test_linear_frames_that_moved_are_named_and_aligned(tmp_path):
    rng = np.random.default_rng(3)
    paths = []
    for number, time in enumerate((1e-3, 4e-3, 16e-3)):
        rate = 1e5 * (np.roll(scene(), 4, 1) if number == 2 else scene())
        seen = rng.poisson(rate * time) + rng.normal(0, 2.4, rate.shape)
        paths.append(tmp_path / f"{number}.tiff")
        tifffile.imwrite(paths[-1], np.clip(np.rint(seen / 2.6 + 64), 0, 4095).astype(np.uint16))
    arguments = [*paths, "--exposures", "0.001,0.004,0.016", *NOISE, "--out", tmp_path / "m.h5"]
    said = merged(arguments)
    assert said["motion"]["moved"] == [3]
    assert any("Give --align" in one for one in said["warnings"])
    aligned = merged([*arguments, "--align", "--force"])
    assert not aligned["warnings"]
    assert aligned["states"].get("MOVED", 0) < 0.2 * said["states"]["MOVED"]


def test_a_file_of_12_bits_is_full_at_4095(tmp_path):
    """Packed 12-bit numbers keep their range, and with it the level of clipped pixels."""
    path = make_file("TIFF, grey of 12 bits", 0, tmp_path).path
    noise = SensorNumbers(gain=2.0, read_noise=3.0)
    bracket = read_bracket_files([path, path], [0.01, 0.02], [], None, noise, None)
    assert bracket.sensor.full_scale == 4095


def test_frames_of_two_encodings_are_refused_and_one_is_told(tmp_path):
    """Half of them would be made linear, in another unit."""
    levels = np.arange(48, dtype=np.uint8).reshape(6, 8)
    for name, in_srgb in (("a.png", False), ("b.png", True), ("c.png", False)):
        (tmp_path / name).write_bytes(encode_png(tmp_path / name, levels, in_srgb))
    noise, times = SensorNumbers(gain=2.0, read_noise=3.0), [0.01, 0.02]
    with pytest.raises(UserError, match=r"b\.png: is srgb .*a\.png linear .* --encoding"):
        read_bracket_files([tmp_path / "a.png", tmp_path / "b.png"], times, [], None, noise, None)
    both = [tmp_path / "a.png", tmp_path / "c.png"]
    bracket = read_bracket_files(both, times, [], None, noise, None)
    assert any(note.startswith("numbers are linear: its chunk") for note in bracket.notes)
