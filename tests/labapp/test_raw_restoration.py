"""`labapp reconstruct` of RAW files: scenes in linear sRGB, seen by a camera made up here."""

from __future__ import annotations

import json

import cv2
import numpy as np
import pytest
import tifffile
from judges.raw_files import AREA, BLACK, BLACK_REPEAT, WHITE, dng
from scipy.signal import fftconvolve
from skimage import data

from labapp.files.raw import read_raw
from labapp.pictures.analysis.raw_colours import raw_filters
from labapp.pictures.merging.mosaic_colours import merged_colours

pytestmark = pytest.mark.usefixtures("white_sheets")

SIDE, REACH = 96, 4
WHITE_LEVEL, LEVELS = 4000, np.array([[100, 140], [180, 220]])

# From XYZ to the camera, like a published one's, and XYZ of linear sRGB by the primaries' xy and
# D65's: solved here from the chromaticities of IEC 61966-2-1.
CAMERA = np.array([[0.95, -0.33, -0.09], [-0.40, 1.25, 0.17], [-0.06, 0.16, 0.62]])
PRIMARIES = np.array([[0.64, 0.30, 0.15], [0.33, 0.60, 0.06], [0.03, 0.10, 0.79]])
D65 = np.array([0.3127, 0.3290, 0.3583]) / 0.3290
TO_XYZ = PRIMARIES * np.linalg.solve(PRIMARIES, D65)
NEUTRAL = CAMERA @ D65 / (CAMERA @ D65).max()


def scene():
    """Linear sRGB of a photograph, (3, rows, columns), with a margin for the blur."""
    side = SIDE + 2 * REACH
    levels = data.astronaut()[20 : 20 + side, 170 : 170 + side] / 255.0
    light = np.where(levels <= 0.04045, levels / 12.92, ((levels + 0.055) / 1.055) ** 2.4)
    return 0.9 * np.moveaxis(light, -1, 0)


def disk():
    y, x = np.mgrid[-REACH : REACH + 1, -REACH : REACH + 1]
    inside = (x**2 + y**2 <= 3.3**2).astype(float)
    return inside / inside.sum()


def blurred(light, psf):
    return np.stack([fftconvolve(band, psf, "valid") for band in light])


def exposed(light, letters=("GB", "RG"), noise=0.002, seed=0, matrix=True, **how):
    """The bytes of a DNG of a scene in linear sRGB, behind filters that begin at an odd pixel."""
    seen = np.einsum("cx,xs,sij->cij", CAMERA, TO_XYZ, light) if matrix else light
    seen = seen / (CAMERA @ D65).max() if matrix else seen
    rows, columns = light.shape[1:]
    mosaic = np.empty((rows, columns))
    black = np.tile(LEVELS, (rows // 2 + 1, columns // 2 + 1))[:rows, :columns]
    for y, x in np.ndindex(2, 2):
        mosaic[y::2, x::2] = seen["RGB".index(letters[y][x]), y::2, x::2]
    mosaic += np.random.default_rng(seed).normal(0, noise, mosaic.shape)
    numbers = np.rint(np.clip(black + mosaic * (WHITE_LEVEL - black), 0, WHITE_LEVEL))
    whole = np.full((rows + 3, columns + 1), 77, np.uint16)
    whole[3:, 1:] = numbers
    tags = {
        AREA: ("l", (3, 1, rows + 3, columns + 1)), WHITE: ("l", WHITE_LEVEL),
        BLACK_REPEAT: ("h", (2, 2)), BLACK: ("h", LEVELS.ravel()),
    }  # fmt: skip
    camera = {50721: ("q", CAMERA.ravel()), 50778: ("h", 21), 50728: ("r", NEUTRAL)}
    how = {"camera": camera | {274: ("h", 6)} if matrix else {}} | how
    return dng(whole, letters, tags=tags, **how)


@pytest.fixture
def photo(tmp_path):
    """The path of a blurred RAW photograph with its PSF beside it."""
    (tmp_path / "photo.dng").write_bytes(exposed(blurred(scene(), disk())))
    np.save(tmp_path / "psf.npy", disk())
    return tmp_path / "photo.dng"


def inner(light):
    """The truth in the frame that the camera sees."""
    return light[:, REACH:-REACH, REACH:-REACH]


def psnr(light, truth):
    return 10 * np.log10(1 / np.mean((light - truth) ** 2))


def reconstruct(labapp, photo, *options):
    """Run the command on a photograph, with the PSF beside it; return what it tells."""
    psf = () if "--blind" in options else ("--psf", photo.parent / "psf.npy")
    code, printed, errors = labapp("reconstruct", photo, *psf, "--force", "--json", *options)
    assert code == 0, errors
    return json.loads(printed)


def refusal(labapp, photo, *options):
    """Run the command on a photograph that it can't restore so; return what it says."""
    code, _, errors = labapp("reconstruct", photo, "--force", *options)
    assert code != 0
    return " ".join(errors.split())


def restored(told):
    """The restored picture in linear sRGB, by the matrix that the command tells."""
    bands = np.moveaxis(tifffile.imread(told["file"]), -1, 0)
    return np.tensordot(told["colours"]["matrix_to_linear_srgb"], bands, axes=1)


@pytest.fixture(scope="module")
def sharp():
    return inner(scene())


@pytest.mark.usefixtures("drawn")
def test_colours_and_detail_come_back(labapp, photo, sharp):
    told = reconstruct(labapp, photo)
    found = restored(told)
    before = psnr(blurred(scene(), disk()), sharp)
    assert psnr(found, sharp) > before + 3
    np.testing.assert_allclose(found.mean((1, 2)), sharp.mean((1, 2)), rtol=0.02)
    assert told["colours"]["gains"] == pytest.approx(NEUTRAL.tolist(), abs=1e-3)
    assert any("orientation 6" in note for note in told["notes"])
    assert any("black 100 to 220, white 4000" in note for note in told["notes"])


def test_a_png_shows_srgb_in_the_sensors_order(labapp, photo, sharp):
    out = photo.parent / "out.png"
    reconstruct(labapp, photo, "--out", out)
    levels = cv2.imread(str(out))[..., ::-1] / 255.0
    light = np.where(levels <= 0.04045, levels / 12.92, ((levels + 0.055) / 1.055) ** 2.4)
    seen = np.moveaxis(light, -1, 0)
    scale = sharp.mean() / seen.mean()  # what counts as white is chosen
    assert psnr(seen * scale, sharp) > psnr(blurred(scene(), disk()), sharp) + 2.5


def test_a_truth_in_linear_srgb_is_compared_with(labapp, photo, sharp):
    np.save(photo.parent / "truth.npy", np.moveaxis(sharp, 0, -1).astype(np.float32))
    before, after = reconstruct(labapp, photo, "--truth", photo.parent / "truth.npy")["score"][
        "psnr_db"
    ]
    assert after > before + 2.5
    assert after > 25


def test_grey_takes_the_scene_for_one_band(labapp, tmp_path, sharp):
    grey = np.broadcast_to(scene().mean(0), scene().shape)
    (tmp_path / "photo.dng").write_bytes(exposed(blurred(grey, disk())))
    np.save(tmp_path / "psf.npy", disk())
    told = reconstruct(labapp, tmp_path / "photo.dng", "--grey")
    found, truth = tifffile.imread(told["file"]), sharp.mean(0)
    assert psnr(found, truth) > psnr(blurred(grey, disk())[0], truth) + 4


@pytest.mark.usefixtures("drawn")
def test_a_sensor_without_filters_gives_a_grey_picture(labapp, tmp_path):
    light = scene().mean(0)
    numbers = np.rint(64 + 3000 * fftconvolve(light, disk(), "valid")).astype(np.uint16)
    tags = {BLACK: ("h", 64), WHITE: ("l", 3064)}
    (tmp_path / "photo.dng").write_bytes(dng(numbers, None, photometric=34892, tags=tags))
    np.save(tmp_path / "psf.npy", disk())
    found = tifffile.imread(reconstruct(labapp, tmp_path / "photo.dng")["file"])
    assert found.shape == numbers.shape
    assert psnr(found, inner(light[None])[0]) > 28


def test_each_colour_can_have_a_psf_of_its_own(labapp, tmp_path, sharp):
    point = np.zeros_like(disk())
    point[REACH, REACH] = 1
    psfs = np.stack([disk(), point, disk()])
    light = np.stack([blurred(scene()[[n]], psfs[n])[0] for n in range(3)])
    (tmp_path / "photo.dng").write_bytes(exposed(light, matrix=False))
    np.save(tmp_path / "psf.npy", np.moveaxis(psfs, 0, -1))
    told = reconstruct(labapp, tmp_path / "photo.dng")
    assert any("no white balance" in note for note in told["notes"])
    assert any("no colour matrix" in note for note in told["notes"])
    assert psnr(restored(told), sharp) > psnr(light, sharp) + 4


@pytest.mark.usefixtures("drawn")
def test_clipped_pixels_are_counted_and_left_out(labapp, photo, sharp):
    (photo.parent / "bright.dng").write_bytes(exposed(2.2 * blurred(scene(), disk())))
    raw = read_raw(photo.parent / "bright.dng")
    share = float((raw.mosaic >= WHITE_LEVEL).mean())
    assert share > 0.01
    told = reconstruct(labapp, photo.parent / "bright.dng")
    assert told["clipped_share"] == pytest.approx(share)
    told = reconstruct(labapp, photo, "--clip", "2000", "--dark", "100")
    assert told["clipped_share"] == pytest.approx(float((read_raw(photo).mosaic >= 2000).mean()))
    assert any("black 100 as told" in note for note in told["notes"])


@pytest.mark.sweep
def test_an_unknown_blur_is_looked_for_in_the_colours_together(labapp, photo):
    told = reconstruct(labapp, photo, "--blind", "9")
    found = (
        tifffile.imread(told["psf_file"])
        if "tif" in told["psf_file"]
        else np.load(told["psf_file"])
    )
    true = np.zeros_like(found)
    middle = found.shape[0] // 2
    span = slice(middle - REACH, middle + REACH + 1)
    true[span, span] = disk()
    likeness = (found * true).sum() / np.sqrt((found**2).sum() * (true**2).sum())
    assert likeness > 0.8


def test_options_that_a_raw_file_does_not_have_are_refused(labapp, photo):
    psf = ("--psf", photo.parent / "psf.npy")
    assert "proportional to light" in refusal(labapp, photo, *psf, "--encoding", "srgb")
    assert "is one RAW photograph" in refusal(labapp, photo, *psf, "--frame", "0")
    assert "is a RAW file" in refusal(labapp, photo, *psf, "--truth", photo)
    assert "Give less" in refusal(labapp, photo, *psf, "--dark", "4000")
    assert "every pixel is clipped" in refusal(labapp, photo, *psf, "--clip", "0")
    assert "--grey" in refusal(labapp, photo, "--decoder", "edof")
    assert "what has blurred it?" in refusal(labapp, photo)


def test_merged_light_becomes_the_colours_of_the_scene(tmp_path):
    colour = np.array([0.6, 0.2, 0.3])[:, None, None] * np.ones((1, 40, 44))
    (tmp_path / "even.dng").write_bytes(exposed(colour, noise=0))
    raw = read_raw(tmp_path / "even.dng")
    light = 1000 * raw.light()
    state = np.zeros(light.shape, np.uint8)
    found = merged_colours(light, np.ones_like(light), state, raw_filters(raw)[0])
    assert found.shape == (3, 40, 44)
    np.testing.assert_allclose(found / 1000, colour, atol=0.002)
