"""`labapp merge` of RAW files: DNGs of a scene whose light, colours and noise are known here."""

from __future__ import annotations

import json

import cv2
import h5py
import numpy as np
import pytest
import tifffile
from judges.raw_files import BLACK, BLACK_REPEAT, WHITE, dng
from scipy.ndimage import uniform_filter
from skimage import data

from optics import hdr

BLACK_COLUMNS, BLACK_ROWS, NOISE, TIME, ISO = 50715, 50716, 51041, 33434, 34855
ROWS, COLUMNS = 144, 160
TIMES = (1e-3, 4e-3, 16e-3, 64e-3)
GAIN, READ_NOISE, WHITE_LEVEL = 1.9, 3.1, 16000
LEVELS = np.array([[500, 512], [540, 523]])
PATCH, INNER = np.s_[60:84, 8:32], np.s_[64:80, 12:28]

# From XYZ to the camera, like a published one's; XYZ of linear sRGB by the primaries' xy and D65's.
CAMERA = np.array([[0.95, -0.33, -0.09], [-0.40, 1.25, 0.17], [-0.06, 0.16, 0.62]])
PRIMARIES = np.array([[0.64, 0.30, 0.15], [0.33, 0.60, 0.06], [0.03, 0.10, 0.79]])
D65 = np.array([0.3127, 0.3290, 0.3583]) / 0.3290
TO_XYZ = PRIMARIES * np.linalg.solve(PRIMARIES, D65)
NEUTRAL = CAMERA @ D65 / (CAMERA @ D65).max()
XTRANS = ("GBGGRG", "RGRBGB", "GBGGRG", "GRGGBG", "BGBRGR", "GRGGBG")


@pytest.fixture(autouse=True)
def plain_report(monkeypatch):
    """No figures in the report, which take most of a merge's time and know no RAW files."""
    monkeypatch.setattr("labapp.pictures.merging.merge_command.merge_page", lambda *_: "")


def scene():
    """Linear sRGB, electrons per second of white's brightest channel, with a grey patch."""
    levels = data.astronaut()[40 : 40 + ROWS, 150 : 150 + COLUMNS] / 255.0
    light = np.where(levels <= 0.04045, levels / 12.92, ((levels + 0.055) / 1.055) ** 2.4)
    light = (np.moveaxis(light, -1, 0) + 0.002) * np.logspace(-1.3, 0.6, COLUMNS)
    light[(slice(None), *PATCH)] = 0.1
    return 4e5 * light


def behind(light, letters):
    """The electrons per second of each pixel of the mosaic."""
    if letters is None:
        return light.mean(0)
    seen = np.einsum("cx,xs,sij->cij", CAMERA, TO_XYZ, light) / (CAMERA @ D65).max()
    mosaic, down, along = np.empty(light.shape[1:]), len(letters), len(letters[0])
    for y, x in np.ndindex(down, along):
        mosaic[y::down, x::along] = seen["RGB".index(letters[y][x]), y::down, x::along]
    return mosaic


def darkness(shape, rows=False):
    """The level of darkness of each pixel."""
    levels = np.tile(LEVELS, (shape[0] // 2 + 1, shape[1] // 2 + 1))[: shape[0], : shape[1]]
    return levels + (np.arange(shape[0])[:, None] % 3 - 0.5) * rows


def exposed(rate, time, seed, letters=("GB", "RG"), stated=None, rows=False, profile=False, **how):
    """The bytes of a DNG of the light of pixels; stated: another time than that of the exposure."""
    rng, shape = np.random.default_rng(seed), rate.shape
    electrons = rng.poisson(rate * time) + rng.normal(0, READ_NOISE, shape)
    numbers = np.clip(np.rint(electrons / GAIN + darkness(shape, rows)), 0, WHITE_LEVEL)
    tags = {WHITE: ("l", WHITE_LEVEL), BLACK_REPEAT: ("h", (2, 2)), BLACK: ("h", LEVELS.ravel())}
    if rows:
        tags[BLACK_ROWS] = ("q", np.arange(shape[0]) % 3 - 0.5)
    if profile:
        span = WHITE_LEVEL - LEVELS.mean()
        tags[NOISE] = ("d", (1 / (GAIN * span), (READ_NOISE / GAIN / span) ** 2))
    camera = {TIME: ("r", (stated or time,)), ISO: ("h", 200), 274: ("h", 6)}
    if letters is not None:
        camera |= {50721: ("q", CAMERA.ravel()), 50778: ("h", 21), 50728: ("r", NEUTRAL)}
    how = {"photometric": 34892} | how if letters is None else how
    camera |= how.pop("camera", {})
    return dng(numbers.astype(np.uint16), letters, tags=tags | how.pop("tags", {}), camera=camera,
               **how)  # fmt: skip


def bracket(folder, light=None, letters=("GB", "RG"), times=TIMES, **how):
    """The paths of a bracket's DNGs, and the light of each pixel."""
    rate = behind(scene() if light is None else light, letters)
    paths = [folder / f"{number}.dng" for number in range(len(times))]
    for number, (path, time) in enumerate(zip(paths, times, strict=True)):
        path.write_bytes(exposed(rate, time, number, letters, **how))
    return paths, rate


def merge(labapp, *arguments):
    """Merge by the command; return what it tells, rate, variance, state and colours."""
    out = arguments[0].parent / "merged.h5"
    code, printed, errors = labapp("merge", *arguments, "--out", out, "--json", "--force")
    assert code == 0, errors
    with h5py.File(out) as file:
        found = [file[name][:] for name in ("rate", "variance", "state")]
    return json.loads(printed), *found, tifffile.imread(out.with_suffix(".tiff"))


def refusal(labapp, *arguments):
    """What the command says of files that it doesn't merge."""
    out = arguments[0].parent / "merged.h5"
    code, _, errors = labapp("merge", *arguments, "--out", out, "--force")
    assert code != 0
    return " ".join(errors.split())


def squared_scores(rate, variance, state, truth):
    return ((rate - truth) ** 2 / variance)[state == 0]


def test_light_and_its_variance_are_right_in_all_pixels_of_the_cell(labapp, tmp_path):
    paths, truth = bracket(tmp_path, rows=True, profile=True)
    told, rate, variance, state, colours = merge(labapp, *paths)
    assert told["sensor"]["source"] == "the files' noise profile"
    assert told["sensor"]["gain_electrons_per_dn"] == pytest.approx(GAIN, rel=1e-3)
    assert told["sensor"]["read_noise_electrons"] == pytest.approx(READ_NOISE, rel=0.03)
    assert told["exposures_s"] == list(TIMES)
    assert told["warnings"] == []
    assert (state == 0).mean() > 0.9
    assert squared_scores(rate, variance, state, truth).mean() == pytest.approx(1, abs=0.05)
    score = np.where(state == 0, (rate - truth) / np.sqrt(variance), 0)
    for y, x in np.ndindex(6, 2):
        assert abs(score[y::6, x::2].mean()) < 4 / np.sqrt(score[y::6, x::2].size)
    np.testing.assert_allclose(colours[INNER].mean((0, 1)), 0.1 * 4e5, rtol=0.015)
    with h5py.File(tmp_path / "merged.h5") as file:
        said = dict(file["rate"].attrs)
    assert said["pattern"] == "GB/RG"
    assert said["white_balance"] == pytest.approx(NEUTRAL, abs=1e-3)
    assert np.array_equal(said["black"], LEVELS)
    assert (said["white"], said["orientation"]) == (WHITE_LEVEL, 6)
    assert any("orientation 6" in note for note in told["notes"])
    assert any("linear sRGB" in note for note in told["notes"])


def test_colours_hold_over_the_range_of_the_light(labapp, tmp_path):
    paths, _ = bracket(tmp_path, profile=True)
    *_, colours = merge(labapp, *paths)
    truth = scene()
    found = np.maximum(np.moveaxis(colours, -1, 0), 100)
    stray = np.log2(found / truth)[:, truth.min(0) > 2e3]
    assert np.sqrt((stray**2).mean()) < 0.25
    # Even what is a hundred times darker than the rest isn't smoothed away.
    dark = np.s_[:56, 6:46]
    for one, band in zip(np.log(truth), np.log(found), strict=True):
        assert np.corrcoef(one[dark].ravel(), band[dark].ravel())[0, 1] > 0.95
    picture = cv2.imread(str(tmp_path / "merged.png"))
    assert picture.shape == (ROWS, COLUMNS, 3)
    assert np.ptp(picture[INNER].mean((0, 1))) < 2


@pytest.mark.parametrize("letters", [("RG", "GB"), XTRANS, None])
def test_noise_that_no_one_states_is_seen_in_the_frames(labapp, tmp_path, letters):
    paths, truth = bracket(tmp_path, letters=letters)
    told, rate, variance, state, _ = merge(labapp, *paths)
    assert told["sensor"]["gain_electrons_per_dn"] == pytest.approx(GAIN, rel=0.1)
    assert told["sensor"]["read_noise_electrons"] == pytest.approx(READ_NOISE, rel=0.1)
    assert told["sensor"]["source"].startswith("noise estimated from the frames: gain 1.")
    # The unit of light is as uncertain as the gain.
    scale = told["sensor"]["gain_electrons_per_dn"] / GAIN
    scores = squared_scores(rate / scale, variance / scale**2, state, truth)
    assert scores.mean() == pytest.approx(1, abs=0.1)


def test_a_wrong_time_is_named_and_others_override_the_files(labapp, tmp_path):
    paths, truth = bracket(tmp_path)
    paths[1].write_bytes(exposed(truth, 4.5e-3, 1, stated=4e-3))
    told, *_ = merge(labapp, *paths)
    (words,) = told["warnings"]
    assert words.startswith("frame 2 has 1.1")
    assert told["factors"] == pytest.approx([1, 1.125, 1, 1], abs=0.005)
    told, rate, *_ = merge(
        labapp, *paths, "--exposures", "0.001,0.0045,0.016,0.064", "--gain", "1.9"
    )
    assert told["factors"] == pytest.approx([1] * 4, abs=0.005)
    assert "tells 0.004 s" in " ".join(told["warnings"])
    assert np.median(rate / truth) == pytest.approx(1, abs=0.01)


def test_what_is_clipped_in_all_exposures_is_white(labapp, tmp_path):
    light = scene()
    light[:, 20:50, 100:140] = 1e8
    paths, _ = bracket(tmp_path, light=light, profile=True)
    told, rate, _, state, colours = merge(labapp, *paths)
    assert (state[20:50, 100:140] == hdr.CLIPPED).all()
    assert told["states"]["CLIPPED"] == pytest.approx(30 * 40 / (ROWS * COLUMNS), rel=0.01)
    spot = colours[26:44, 106:134]
    least = (WHITE_LEVEL - LEVELS.max()) * GAIN / TIMES[0]
    assert rate[30, 120] == pytest.approx(least, rel=1e-3)
    np.testing.assert_allclose(spot, least, rtol=0.02)


def test_dark_frames_take_the_place_of_stated_levels(labapp, tmp_path):
    paths, truth = bracket(tmp_path, profile=True)
    darks = []
    for number in range(3):
        darks.append(tmp_path / f"dark{number}.dng")
        darks[-1].write_bytes(exposed(np.zeros_like(truth), 1e-3, 9 + number))
    given = [part for path in darks for part in ("--dark", path)]
    told, rate, variance, state, _ = merge(labapp, *paths, *given)
    assert squared_scores(rate, variance, state, truth).mean() == pytest.approx(1, abs=0.05)
    assert told["warnings"] == []
    told, *_ = merge(labapp, *paths, "--black", "700")
    assert "are too bright" in " ".join(told["warnings"])


def test_frames_that_moved_are_named_though_filters_stay_where_they_are(labapp, tmp_path):
    light = scene()
    paths, _ = bracket(tmp_path, profile=True)
    moved = behind(np.roll(light, (3, -4), (1, 2)), ("GB", "RG"))
    paths[2].write_bytes(exposed(moved, TIMES[2], 2, profile=True))
    told, *_ = merge(labapp, *paths)
    assert told["motion"]["moved"] == [3]
    (words,) = [one for one in told["warnings"] if "at the same places" in one]
    assert "keep the camera still" in words
    assert "can't be moved" in refusal(labapp, *paths, "--align")


def test_files_that_do_not_fit_together_are_refused(labapp, tmp_path):
    paths, truth = bracket(tmp_path)
    other = tmp_path / "other.dng"

    def against(**how):
        other.write_bytes(exposed(how.pop("rate", truth), 1e-3, 7, **how))
        return refusal(labapp, *paths, other)

    assert "pattern of filters RG/GB" in against(letters=("RG", "GB"))
    assert "size 144 x 158" in against(rate=truth[:, :-2])
    assert "white level 15000" in against(tags={WHITE: ("l", 15000)})
    assert "camera Judge Cone" in against(camera={272: ("s", "Cone")})
    assert "apertures or ISO numbers" in against(camera={ISO: ("h", 800)})
    tifffile.imwrite(tmp_path / "picture.tiff", np.full((ROWS, COLUMNS), 600, np.uint16))
    assert "is a picture" in refusal(labapp, *paths, tmp_path / "picture.tiff")
    assert "is a picture" in refusal(labapp, *paths, "--dark", tmp_path / "picture.tiff")
    assert "proportional to light" in refusal(labapp, *paths, "--encoding", "srgb")
    assert "2 times for 4 files" in refusal(labapp, *paths, "--exposures", "0.1,0.2")
    assert "--gain" in refusal(labapp, paths[0])


def test_a_merged_mosaic_is_restored_in_colour(labapp, tmp_path):
    width = 5
    blurred = np.stack([uniform_filter(band, width, mode="reflect") for band in scene()])
    paths, _ = bracket(tmp_path, light=blurred, profile=True)
    merge(labapp, *paths)
    np.save(tmp_path / "psf.npy", np.full((width, width), 1 / width**2))
    code, printed, errors = labapp(
        "reconstruct", tmp_path / "merged.h5", "--psf", tmp_path / "psf.npy", "--json", "--force"
    )
    assert code == 0, errors
    told = json.loads(printed)
    bands = np.moveaxis(tifffile.imread(told["file"]), -1, 0)
    found = np.tensordot(told["colours"]["matrix_to_linear_srgb"], bands, axes=1)
    inner = np.s_[:, 8:-8, 8:-8]
    before, after = (np.mean((one - scene())[inner] ** 2) for one in (blurred, found))
    assert after < before / 2


def test_a_mosaic_of_unknown_colours_is_merged_in_grey_and_not_restored(labapp, tmp_path):
    rate = scene().mean(0)
    paths = [tmp_path / f"{number}.dng" for number in range(2)]
    for number, path in enumerate(paths):
        tags = {
            WHITE: ("l", WHITE_LEVEL),
            BLACK_REPEAT: ("h", (2, 2)),
            BLACK: ("h", LEVELS.ravel()),
        }
        numbers = np.rint(rate * TIMES[number] / GAIN + darkness(rate.shape)).astype(np.uint16)
        camera = {TIME: ("r", (TIMES[number],))}
        path.write_bytes(dng(numbers, ("CM", "YG"), tags=tags, camera=camera))
    told, *_, shown = merge(labapp, *paths, "--gain", "1.9", "--read-noise", "3.1")
    assert "show the mosaic in grey" in " ".join(told["warnings"])
    assert shown.shape == rate.shape
    np.save(tmp_path / "psf.npy", np.ones((3, 3)) / 9)
    code, _, errors = labapp(
        "reconstruct", tmp_path / "merged.h5", "--psf", tmp_path / "psf.npy", "--force"
    )
    assert code != 0
    assert "colours can't be restored" in " ".join(errors.split())
