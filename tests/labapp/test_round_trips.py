"""What a command writes, other commands read as the same light, to the rounding of the file."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
import tifffile
from judges import natural_image
from typer.testing import CliRunner

from labapp.cli import app
from labapp.common.errors import UserError
from labapp.files.picture.colour_picture import read_scene_picture, read_screen_colours
from labapp.files.picture.photograph import read_photograph
from labapp.files.picture.photograph_writing import encode_photograph
from labapp.pictures.reconstructing.psf_files import read_psf_file
from labapp.pictures.reconstructing.recorded_photograph import RecordSelection

ROUNDING = {".png": 2.0 / 65535, ".hdr": 1 / 128, ".exr": 1e-6, ".tiff": 1e-6, ".npy": 1e-6}
"""Share of the brightest light, where the result is of more than 8 bits."""

EIGHT_BITS = 2.4 / 1.055 / 255
"""Half a level of sRGB where its curve is steepest, and the same of another rounding."""


def run(*arguments) -> None:
    done = CliRunner().invoke(app, [str(one) for one in arguments])
    if done.exception is not None and not isinstance(done.exception, SystemExit):
        raise done.exception
    assert done.exit_code == 0, done.output


def as_scene(path):
    return np.moveaxis(read_scene_picture(path), -1, 0)


def as_screen(path):
    """The light of 8-bit colours, by the standard's own formula."""
    v = read_screen_colours(path) / 255.0
    return np.where(v <= 0.04045, v / 12.92, ((v + 0.055) / 1.055) ** 2.4)


def as_psf(path):
    return read_psf_file(path, 1, RecordSelection())[0]


READERS = {
    "photograph": lambda path: read_photograph(path).light,
    "scene": as_scene,
}


def off(light, truth) -> float:
    """Largest difference after the best common factor, in shares of the brightest light."""
    truth = np.broadcast_to(truth, light.shape).astype(np.float64)
    factor = (light * truth).sum() / (truth * truth).sum()
    return float(np.abs(light / factor - truth).max() / truth.max())


def colours() -> np.ndarray:
    return np.stack([natural_image(45, 39, seed) for seed in range(3)])


def written(folder, ending, light, in_srgb, white=1.0):
    """A result as commands write it."""
    path = folder / f"result{ending}"
    path.write_bytes(encode_photograph(path, light.astype(np.float32), in_srgb, white))
    return path


@pytest.mark.parametrize("reader", READERS)
@pytest.mark.parametrize("bands", [1, 3])
@pytest.mark.parametrize("in_srgb", [True, False])
@pytest.mark.parametrize("ending", ROUNDING)
def test_a_result_is_the_same_light_in_every_format(tmp_path, ending, in_srgb, bands, reader):
    light = colours()[:bands]
    path = written(tmp_path, ending, light, in_srgb)
    most = EIGHT_BITS if in_srgb and ending == ".png" else ROUNDING[ending]
    assert off(READERS[reader](path), light) <= most


@pytest.mark.parametrize("ending", ROUNDING)
def test_training_sees_the_light_of_a_result(tmp_path, ending):
    for in_srgb in (True, False):
        light = as_screen(written(tmp_path, ending, colours(), in_srgb))
        assert off(light, colours()) <= 2 * EIGHT_BITS


@pytest.mark.parametrize("source", ["eight.png", "linear.tif", "grey.tif"])
@pytest.mark.sweep
def test_a_restoration_is_the_same_light_in_every_format(tmp_path, source):
    light = np.moveaxis(colours(), 0, -1)
    coded = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
    cv2.imwrite(str(tmp_path / "eight.png"), np.rint(255 * coded)[..., ::-1].astype(np.uint8))
    numbers = np.rint(40000 * light).astype(np.uint16)
    tifffile.imwrite(tmp_path / "linear.tif", numbers, photometric="rgb")
    tifffile.imwrite(tmp_path / "grey.tif", numbers[..., 0])
    np.save(tmp_path / "point.npy", np.pad([[1.0]], 2))
    fixed = ["--psf", tmp_path / "point.npy", "--method", "wiener", "--weight", "0.001", "--force"]
    for ending in ROUNDING:
        out = tmp_path / f"out{ending}"
        run("reconstruct", tmp_path / source, "--out", out, "--picture", tmp_path / "x.png", *fixed)
    truth = read_photograph(tmp_path / "out.npy").light
    for ending in ROUNDING:
        most = EIGHT_BITS if (source, ending) == ("eight.png", ".png") else ROUNDING[ending]
        for read in READERS.values():
            assert off(read(tmp_path / f"out{ending}"), np.maximum(truth, 0)) <= most, ending


def test_a_picture_that_says_srgb_is_no_other_light_as_psf(tmp_path):
    """A PSF may be any picture; its own word on its encoding counts there too."""
    path = written(tmp_path, ".png", colours()[:1], True)
    assert off(as_psf(path), colours()[:1]) <= EIGHT_BITS


def test_a_computed_psf_is_the_same_in_every_format(tmp_path):
    lens = ["--focal-length", "0.1", "--f-number", "5.6", "--distance", "2", "--tol", "1e-2"]
    for name in ("array.npy", "float.tiff"):
        run("psf", *lens, "--out", tmp_path / name)
    truth = np.load(tmp_path / "array.npy")[None]
    assert off(as_psf(tmp_path / "float.tiff"), truth) < 1e-6
    with pytest.raises(UserError, match="a drawing that labapp made"):
        as_psf(tmp_path / "array.png")


def test_a_merged_bracket_is_the_same_in_every_format(tmp_path):
    light = natural_image(45, 39, 0)
    for name, factor in (("a", 3000), ("b", 12000)):
        frame = np.minimum(np.rint(factor * light), 10000).astype(np.uint16)
        tifffile.imwrite(tmp_path / f"{name}.tif", frame)
    noise = ["--gain", "2.6", "--read-noise", "2.4", "--black", "0", "--exposures", "0.01,0.04"]
    noise += ["--full-scale", "10000"]
    run("merge", tmp_path / "a.tif", tmp_path / "b.tif", *noise, "--out", tmp_path / "m.h5")
    merged = read_photograph(tmp_path / "m.tiff").light
    # What it merged are exact multiples of the light, but for rounding to whole numbers.
    assert off(merged, light[None]) < 2e-3
    assert off(as_scene(tmp_path / "m.tiff"), light[None]) < 2e-3


@pytest.mark.sweep
def test_a_simulated_picture_is_the_same_in_every_format(tmp_path):
    for ending in (".tiff", ".png"):
        run("simulate", "star", "--out", tmp_path / f"star{ending}")
    for read in (READERS["photograph"], as_scene):
        tiff, png = (read(tmp_path / f"star{ending}") for ending in (".tiff", ".png"))
        np.testing.assert_array_equal(tiff, png)
