"""The study of extended depth of field by a designed pattern, in pieces and on a small bench."""

import json
import math
import tomllib
from dataclasses import replace

import cv2
import numpy as np
import pytest
import torch

from labapp.common.errors import UserError
from labapp.files.plan_file import PlanFile
from labapp.files.reading import bundled_path
from labapp.studies import edof_decoding
from labapp.studies.catalogue.edof import DISTANCES, EdofSettings
from labapp.studies.command import StudyRequest, carry_out_study
from labapp.studies.edof import NOTES, plan, result_rows
from labapp.studies.edof_decoding import DecodedPicture, NamedDecoder, decoders_of, score_picture
from labapp.studies.edof_pattern import pattern_in_pupil
from labapp.studies.edof_psfs import ComparedPSF, fit_shift, likeness_over_depth, move_picture
from optics.camera import Camera, Lens, Panel, Sensor
from optics.edof.dioptres import PUBLISHED_DISTANCES
from optics.edof.protocol_psfs import PupilPattern
from optics.slm import PanelMap

SCENE = tomllib.loads(bundled_path("studies/edof.toml").read_text())["targets"]


@pytest.fixture
def settings(tmp_path) -> EdofSettings:
    file = tmp_path / "pattern.png"
    file.write_bytes(b"looked at when the plan runs")
    return EdofSettings(pattern=str(file))


def bench() -> Camera:
    return Camera(lens=Lens(0.1, 5.6, math.inf), sensor=Sensor(shape=(1024, 1024), pitch=3.45e-6))


def test_the_plan_has_stars_and_prints_at_the_published_distances(settings):
    made = plan(settings, bench())
    assert isinstance(made, PlanFile)
    assert DISTANCES == PUBLISHED_DISTANCES
    stars, pictures, sharp = made.acquire
    assert len(stars.targets) == 10
    for block, word in ((stars, "star"), (pictures, "photograph")):
        for name, distance in zip(block.targets[:10], PUBLISHED_DISTANCES, strict=True):
            assert name.startswith(word)
            assert SCENE[name]["distance_m"] == pytest.approx(distance)
    assert pictures.targets[10:] == ("objects",)
    assert set(sharp.targets) == {"photograph-sharp", "objects-sharp"} <= SCENE.keys()
    assert sharp.patterns == ("neutral",)


def test_a_quick_plan_leaves_most_out(settings):
    quick = settings.model_copy(update={**EdofSettings.QUICK, "distances_m": (0.5, 50.0)})
    made = plan(quick, bench())
    assert [len(one.targets) for one in made.acquire] == [2, 2, 1]


def test_a_missing_pattern_is_told_with_a_way_to_make_one(settings):
    gone = settings.model_copy(update={"pattern": "nowhere.h5"})
    with pytest.raises(UserError, match=r"no pattern nowhere.h5.*labapp design edof"):
        plan(gone, bench())


@pytest.mark.parametrize("key", ["psf_px", "scored_px"])
def test_more_pixels_than_the_sensor_has_are_refused(settings, key):
    small = replace(bench(), sensor=Sensor(shape=(300, 300), pitch=3.45e-6))
    fits = {"psf_px": 201, "scored_px": 200}
    assert plan(settings.model_copy(update=fits), small)
    with pytest.raises(UserError, match=f"{key} is 400"):
        plan(settings.model_copy(update={**fits, key: 400}), small)


def test_stars_have_images_of_one_size():
    sizes = {
        name: one["diameter_um"] / one["distance_m"]
        for name, one in SCENE.items()
        if name.startswith("star-")
    }
    assert len(sizes) == 10
    assert list(sizes.values()) == pytest.approx([34.0] * 10)


def test_the_objects_in_focus_are_the_same_view():
    """Everything is 65536 times as large and as far: the same angles, and in focus at infinity."""

    def numbers(table) -> list[float]:
        lengths = []
        for key, value in table.items():
            if key.endswith(("_mm", "_m")):
                lengths += value if isinstance(value, list) else [value]
        return lengths

    near, far = SCENE["objects"]["layers"], SCENE["objects-sharp"]["layers"]
    for one, other in zip(near, far, strict=True):
        assert one["picture"]["kind"] == other["picture"]["kind"]
        for a, b in ((one, other), (one["picture"], other["picture"])):
            assert np.allclose(np.array(numbers(b)), 65536 * np.array(numbers(a)), rtol=1e-9)
    # The blur of the panel's half diagonal is below a tenth of a pixel.
    assert 8.81e-3 * 0.1 / far[0]["distance_m"] < 0.1 * 3.45e-6


# The comparison of PSFs.


def gaussian(y: float, x: float, side: int = 64) -> np.ndarray:
    v, u = np.mgrid[:side, :side] - side // 2
    return np.exp(-((v - y) ** 2 + (u - x) ** 2) / 8)


@pytest.mark.parametrize("side", [63, 64])
def test_a_shift_is_found_and_undone(side):
    """Of a Gaussian that is drawn elsewhere, by its formula."""
    there = gaussian(0.37, -0.81, side)
    shift = fit_shift(there, gaussian(0, 0, side))
    assert shift == pytest.approx((0.37, -0.81), abs=1e-3)
    assert np.allclose(move_picture(gaussian(0, 0, side), (0.37, -0.81)), there, atol=1e-6)


def test_a_shift_is_at_most_a_pixel():
    assert fit_shift(gaussian(3.0, -2.0), gaussian(0, 0)) == pytest.approx((1.0, -1.0))


def compared(difference: float, noise: float, measured=None) -> ComparedPSF:
    picture = gaussian(0, 0) if measured is None else measured
    return ComparedPSF(picture, picture, (0.0, 0.2), difference, noise)


def test_noise_is_taken_out_of_a_distance():
    assert compared(0.05, 0.03).beside_noise == pytest.approx(0.04)
    assert compared(0.02, 0.03).beside_noise == 0.0


def test_likeness_is_one_for_equal_psfs_and_less_for_others():
    same = {("designed", d): compared(0, 0) for d in (1.0, 2.0)}
    assert likeness_over_depth(same, "designed") == pytest.approx(1.0)
    apart = {
        ("designed", 1.0): compared(0, 0, np.eye(2)[:1]),
        ("designed", 2.0): compared(0, 0, np.eye(2)[1:]),
    }
    assert likeness_over_depth(apart, "designed") == pytest.approx(math.sqrt(0.5))


# Decoding.


def test_scores_are_of_the_middle_in_two_scales():
    """A difference of .1 in linear light is 20 dB; in sRGB it is what the standard makes of it."""
    truth = np.full((64, 64), 0.5)
    image = truth + 0.1
    image[:8] = 7.0
    found = score_picture(image, truth, 0.01, EdofSettings(scored_px=40))
    assert found.psnr == pytest.approx(20.0, abs=1e-6)
    srgb = [1.055 * value ** (1 / 2.4) - 0.055 for value in (0.5, 0.6)]
    assert found.srgb_psnr == pytest.approx(-20 * math.log10(srgb[1] - srgb[0]), abs=1e-4)


def test_one_filter_sharpens_what_is_out_of_focus(monkeypatch):
    """On a small panel without a pattern, for a narrow range of depths."""
    protocol = replace(
        edof_decoding.STRICT, psf_window=65, design_count=4, depth_range=(0.028, 0.032)
    )
    monkeypatch.setattr(edof_decoding, "STRICT", protocol)
    camera = Camera(
        Panel(shape=(54, 96), pitch=160e-6, unmodulated=0.0),
        Lens(0.1, 5.6, math.inf),
        Sensor(shape=(64, 64), pitch=3.45e-6),
    )
    settings = EdofSettings(frame_px=64, scored_px=32)
    plain, wiener, network = decoders_of(PupilPattern("none"), camera, settings)
    assert (plain.label, wiener.label) == ("as taken", "one Wiener filter, blind")
    assert network.label == "filter and network, blind"
    truth = np.zeros((64, 64))
    truth[:, 32:] = 1.0
    # The panel's size times .03 dioptres times the focal length, in pixels.
    blurred = cv2.blur(truth, (13, 7), borderType=cv2.BORDER_REPLICATE)
    taken = torch.from_numpy(blurred).float()
    scores = [
        score_picture(one.restore(taken, 0.01).double().numpy(), truth, 0.01, settings).psnr
        for one in (plain, wiener)
    ]
    assert scores[1] > scores[0] + 1


def test_a_calibrated_panel_adds_its_flatness_to_the_pattern(rng):
    """A path of a tenth of a wave at one pixel, beside a linear response."""
    path = torch.zeros(6, 8, dtype=torch.float64)
    path[2, 3] = 52e-9
    panel = Panel(shape=(6, 8), max_phase=((520e-9, 4 * math.pi),))
    grey = torch.from_numpy(rng.integers(0, 100, panel.shape).astype(np.uint8))
    linear = 4 * math.pi * grey.double() / 255
    plain = pattern_in_pupil("plain", grey, Camera(panel=panel), 520e-9)
    assert plain.amplitude is None
    assert torch.allclose(plain.phase, linear)
    bent = replace(panel, flatness=PanelMap(path))
    seen = pattern_in_pupil("bent", grey, Camera(panel=bent), 520e-9)
    expected = torch.exp(1j * (linear + 2 * math.pi / 520e-9 * path))
    assert torch.allclose(torch.polar(seen.amplitude, seen.phase), expected)


def test_fringing_dims_pixels_beside_jumps():
    grey = torch.zeros(6, 8, dtype=torch.uint8)
    grey[:, 4:] = 128
    panel = Panel(shape=(6, 8), max_phase=((520e-9, 2 * math.pi),), coupling=3e-6)
    amplitude = pattern_in_pupil("jump", grey, Camera(panel=panel), 520e-9).amplitude
    assert amplitude[:, 3:5].max() < 0.95
    assert torch.allclose(amplitude[:, :2], torch.ones(6, 2, dtype=torch.float64), atol=1e-3)


def test_the_rows_say_what_a_decoder_knows():
    settings = EdofSettings(distances_m=(0.5, 50.0))
    names = ("designed", "rings", "neutral")
    psfs = {
        (name, distance): compared(0.05, 0.03)
        for name in names[:2]
        for distance in settings.distances_m
    }
    labels = [
        NamedDecoder("as taken", None, lambda picture, noise: picture).label,
        NamedDecoder("filter", True, lambda picture, noise: picture).label,
        NamedDecoder("other", False, lambda picture, noise: picture).label,
    ]
    assert labels == ["as taken", "filter, blind", "other, told the depth"]
    image = np.zeros((4, 4))
    targets = ("photograph-50cm", "photograph-5000cm", "objects")
    pictures = {
        (target, name, label): DecodedPicture(image, 20.0 + k, 21.0, 0.5, 0.01)
        for k, target in enumerate(targets)
        for name in names
        for label in labels
    }
    rows = result_rows(psfs, pictures, settings)
    assert rows[0].value == pytest.approx(0.04)
    prints = [row for row in rows if "print at 2 distances" in row.what]
    assert len(prints) == 9
    assert all(row.value == pytest.approx(20.5) for row in prints)
    assert all(row.published == "-" for row in prints if "as taken" in row.what)
    assert [row.value for row in rows if "objects" in row.what] == [22.0] * 9
    assert any("9th percentile" in note for note in NOTES)


# A whole study.

_SMALL = {
    "width = 1920": "width = 128",
    "height = 1080": "height = 72",
    "pitch_um = 8.0": "pitch_um = 40.0",
    "width = 1024": "width = 64",
    "height = 1024": "height = 64",
}


def test_a_study_on_a_small_bench(tmp_path, monkeypatch):
    protocol = replace(edof_decoding.STRICT, psf_window=49, design_count=3)
    monkeypatch.setattr(edof_decoding, "STRICT", protocol)
    text = bundled_path("studies/edof-bench.toml").read_text()
    for old, new in _SMALL.items():
        assert old in text
        text = text.replace(old, new)
    (tmp_path / "bench.toml").write_text(text)
    grey = np.random.default_rng(0).integers(0, 80, (72, 128)).astype(np.uint8)
    assert cv2.imwrite(str(tmp_path / "pattern.png"), grey)
    keys = [
        f"pattern={tmp_path / 'pattern.png'}",
        "distances_m=[2.0, 50.0]",
        "psf_px=49",
        "frame_px=64",
        "scored_px=32",
        "layered=false",
        "star_ms=[30, 1000]",
    ]
    request = StudyRequest("edof", keys, bench=tmp_path / "bench.toml")
    account = carry_out_study(request, tmp_path / "study")
    found = json.loads((tmp_path / "study/study.json").read_text())
    # The bench's own description predicts its PSFs.
    assert all(one["beside_noise"] <= 0.03 for one in found["data"]["psfs"])
    assert len(found["data"]["pictures"]) == 2 * 3 * 3
    assert len(account.results.figures) == 3
    far = {
        (one["pattern"], one["decoder"]): one["psnr_db"]
        for one in found["data"]["pictures"]
        if one["target"] == "photograph-5000cm"
    }
    # At 50 m, next to infinity, nothing is sharper than no pattern.
    assert far["neutral", "as taken"] > far["designed", "as taken"] + 1
