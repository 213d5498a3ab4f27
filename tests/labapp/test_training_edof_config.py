"""The configuration and the photographs of `labapp train edof`: what is refused, and how."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
import torch
from figures.edof_published import read_published_config
from skimage import data
from tiny_edof import make_config, write_files
from typer.testing import CliRunner

from labapp.cli import app
from labapp.common.errors import UserError
from labapp.training.edof.command import DEFAULT_STEPS
from labapp.training.edof.config import BUNDLED_CONFIG, EdofTrainingConfig, read_edof_config
from labapp.training.edof.training_data import measure_spectrum
from labapp.training.manifest import read_manifest
from labapp.training.scenes import SceneSettings
from optics.edof.learned import DecoderNetwork

pytestmark = pytest.mark.usefixtures("white_sheets")


def train(folder, *arguments):
    """Run the command line, with two steps unless others are asked for."""
    given = [str(one) for one in arguments]
    if "--steps" not in given:
        given += ["--steps", "2"]
    options = ["--out", str(folder / "a.h5"), "--device", "cpu", *given]
    return CliRunner().invoke(app, ["train", "edof", str(folder / "train.toml"), *options])


def photograph(name: str, share: float = 0.3):
    picture = np.ascontiguousarray(getattr(data, name)()[..., ::-1])
    return cv2.resize(picture, None, fx=share, fy=share, interpolation=cv2.INTER_AREA)


@pytest.fixture
def photographs(tmp_path):
    """Photographs, and pictures of noise, so that some are for validation."""
    where = tmp_path / "photographs"
    where.mkdir()
    rng = np.random.default_rng(0)
    for number in range(12):
        smooth = cv2.GaussianBlur(rng.random((60, 70, 3)), (0, 0), 2)
        values = 255 * (smooth - smooth.min()) / np.ptp(smooth)
        cv2.imwrite(str(where / f"{number}.png"), values.astype(np.uint8))
    cv2.imwrite(str(where / "cat.png"), photograph("chelsea"))
    return where


def test_the_bundled_configuration_is_read():
    config = read_edof_config(BUNDLED_CONFIG)
    assert config.training.side % config.decoder.settings("srgb").shape.multiple == 0
    assert DEFAULT_STEPS > 0


def test_the_published_configuration_of_the_guide_is_read():
    config = EdofTrainingConfig.model_validate(read_published_config())
    network = DecoderNetwork(config.decoder.settings(config.scenes.light))
    assert not config.decoder.settings("linear").is_blind
    # 64, 128, 256 and 512 channels; an independent count of the published code has 16.9 million.
    assert network.weight_count == pytest.approx(16.9e6, rel=0.06)


def test_a_configuration_becomes_settings():
    changes = {"decoder": {"dilations": [1, 2], "fold": 1, "levels": 3, "overlapping": True}}
    config = make_config({**changes, "scenes": {"layered_share": 0.25, "most_layers": 3}})
    shape = config.decoder.settings("linear").shape
    assert (shape.fold, shape.levels, shape.dilations) == (1, 3, (1, 2))
    assert shape.overlapping
    assert config.decoder.settings("linear").light == "linear"
    assert config.scenes.settings == SceneSettings(0.25, 3)
    assert config.wavelength == pytest.approx(520e-9)
    settings = config.as_settings()
    assert settings["config.decoder.dilations"] == [1, 2]
    assert settings["config.near_dioptre"] == 0.9
    assert not any(isinstance(one, dict) for one in settings.values())


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"training": {"patches": 8}}, "key 'training.patches' is unknown. Remove it, or check"),
        ({"": {"depth": 3}}, "key 'depth' is unknown"),
        ({"": {"version": 2}}, "key 'version' is 2"),
        ({"": {"near_dioptre": 0.2}}, "near_dioptre is 0.2 and far_dioptre 0.3; near must be more"),
        ({"": {"near_dioptre": 0.3}}, "near_dioptre is 0.3 and far_dioptre 0.3; near must be more"),
        ({"": {"far_dioptre": -0.1}}, "key 'far_dioptre' is -0.1: input should be greater than"),
        ({"": {"wavelength_nm": 0}}, "key 'wavelength_nm' is 0"),
        ({"": {"seed": -1}}, "key 'seed' is -1"),
        ({"training": {"side": 36}, "decoder": {"levels": 4}}, "side is 36; .*multiple of 16 pix"),
        ({"training": {"side": 33}}, "key 'training.side' is 33: give an even number of pixels"),
        ({"training": {"side": 16}}, "key 'training.side' is 16"),
        ({"training": {"loss": "absolute"}}, "key 'training.loss' is 'absolute': .*level.*squared"),
        ({"training": {"last_rate": 0.1}}, "last_rate is 0.1 and first_rate 0.001"),
        ({"joint": {"last_rate": 0.1}}, "last_rate is 0.1 and first_rate 0.001"),
        ({"joint": {"share": 1.5}}, "key 'joint.share' is 1.5"),
        ({"pattern": {"start": "ring"}}, "key 'pattern.start' is 'ring': choose rings, sweep"),
        ({"pattern": {"start": "none.h5"}}, r'start = "none.h5" in \[pattern\]: .*none.h5 doesn'),
        ({"pattern": {"parameters": "half"}}, "key 'pattern.parameters' is 'half': choose quarter"),
        ({"pattern": {"design_noise": 0}}, "key 'pattern.design_noise' is 0"),
        ({"scenes": {"light": "raw"}}, "key 'scenes.light' is 'raw': .*srgb.*linear"),
        ({"scenes": {"most_layers": 1}}, "key 'scenes.most_layers' is 1"),
        ({"capture": {"noise": [0.02, 0.01]}}, "noise is .0.02, 0.01.; give the smaller deviation"),
        ({"capture": {"noise": [0.0, 0.01]}}, "key 'capture.noise.0' is 0.0"),
        ({"capture": {"unmodulated": [0.3, 0.1]}}, "unmodulated is .0.3, 0.1.; give the smaller"),
        ({"capture": {"unmodulated": [0.3, 1.1]}}, "key 'capture.unmodulated.1' is 1.1"),
        ({"depths": {"importance": "random"}}, "key 'depths.importance' is 'random'"),
        ({"depths": {"distances_m": [1.0, 0.0]}}, "key 'depths.distances_m.1' is 0.0"),
        ({"depths": {"count": 0}}, "key 'depths.count' is 0"),
        ({"decoder": {"front": "wiener"}}, "key 'decoder.front' is 'wiener': .*blind.*known.*none"),
        ({"decoder": {"convolutions": 1}}, "convolutions is 1; choose 2 or more"),
        ({"": {"bench": "no.toml"}}, r"no\.toml"),
    ],
)
def test_configurations_that_can_not_be(tmp_path, changes, said):
    write_files(tmp_path, changes)
    before = set(tmp_path.iterdir())
    done = train(tmp_path)
    assert isinstance(done.exception, UserError), done.output
    with pytest.raises(UserError, match=said):
        raise done.exception
    assert set(tmp_path.iterdir()) == before


def test_a_bench_that_patterns_are_not_designed_for_is_refused(tmp_path):
    write_files(tmp_path)
    bench = tmp_path / "bench" / "bench.toml"
    whole = bench.read_text()
    bench.write_text(whole.replace("max_phase_pi = { 452 = 9.0", "max_phase_pi = { 452 = 1.1"))
    bench.write_text(bench.read_text().replace("532 = 6.7, 633 = 5.4", "532 = 1.0, 633 = 0.9"))
    done = train(tmp_path)
    assert isinstance(done.exception, UserError), done.output
    assert "wavelength_nm = 520" in str(done.exception)
    bench.write_text(whole.replace("pitch_um = 3.45", "pitch_um = 3450"))
    assert isinstance(train(tmp_path).exception, UserError)


def test_a_start_of_another_panel_is_refused(tmp_path):
    write_files(tmp_path)
    assert train(tmp_path, "--steps", "1").exit_code == 0
    (tmp_path / "a.h5").rename(tmp_path / "start.h5")
    for name in ("a.png", "a_training.png"):
        (tmp_path / name).unlink()
    write_files(tmp_path, {"pattern": {"start": "start.h5"}})
    bench = tmp_path / "bench" / "bench.toml"
    bench.write_text(bench.read_text().replace("width = 192", "width = 160"))
    before = set(tmp_path.iterdir())
    done = train(tmp_path)
    assert isinstance(done.exception, UserError)
    assert "is for 192x108 pixels, and the bench's panel has 160x108" in str(done.exception)
    assert set(tmp_path.iterdir()) == before


def test_photographs_are_trained_on_and_listed(tmp_path, photographs):
    write_files(tmp_path, {"scenes": {"spectrum": "measured"}})
    with (tmp_path / "test.png").open("wb") as file:
        file.write(cv2.imencode(".png", photograph("astronaut"))[1].tobytes())
    options = ["--data", photographs, "--test-pictures", tmp_path / "test.png"]
    done = train(tmp_path, *options)
    assert done.exit_code == 0, done.output
    assert len(read_manifest(tmp_path / "a_data.json").pictures) == 13
    assert f"wrote {tmp_path / 'a_data.json'}" in done.output.replace("\n", "")
    again = train(tmp_path, *options)
    assert isinstance(again.exception, UserError)
    assert "exist" in str(again.exception)
    assert train(tmp_path, *options, "--force").exit_code == 0


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ("missing", r"nowhere"),
        ("foreign", r"broken\.png.*not a picture"),
        ("one", "one picture|only one|single"),
        ("small", r"small\.png.*20"),
        ("copy", r"cat\.png.*test\.png|near-duplicate"),
    ],
)
def test_photographs_that_can_not_be_trained_on(tmp_path, photographs, change, said):
    write_files(tmp_path)
    test = photograph("astronaut")
    if change == "foreign":
        (photographs / "broken.png").write_bytes(b"no picture")
    elif change == "one":
        for number in range(12):
            (photographs / f"{number}.png").unlink()
    elif change == "small":
        cv2.imwrite(str(photographs / "small.png"), np.zeros((20, 20, 3), np.uint8))
    elif change == "copy":
        test = photograph("chelsea", 0.5)
    cv2.imwrite(str(tmp_path / "test.png"), test)
    before = set(tmp_path.iterdir())
    folder = tmp_path / "nowhere" if change == "missing" else photographs
    done = train(tmp_path, "--data", folder, "--test-pictures", tmp_path / "test.png")
    assert isinstance(done.exception, UserError), done.output
    with pytest.raises(UserError, match=f"(?s){said}"):
        raise done.exception
    assert set(tmp_path.iterdir()) == before


def test_other_options_that_can_not_be(tmp_path):
    write_files(tmp_path)
    for options, said in (
        (["--minutes", "1"], "--minutes and --steps: give one"),
        (["--device", "tpu"], "--device tpu: is unknown"),
        (["--out", tmp_path / "a.pt"], "written as .h5"),
    ):
        done = train(tmp_path, *options)
        assert isinstance(done.exception, UserError)
        assert said in str(done.exception)
    assert {one.name for one in tmp_path.iterdir()} == {"bench", "train.toml"}


def test_the_measured_spectrum_is_that_of_the_pictures():
    """Of noise whose pixels are independent it is flat: their variance at all frequencies."""

    class Noise:
        def patch(self, generator, side, split="training"):
            return (0.5 + 0.1 * generator.standard_normal((side, side))).astype(np.float32)

    config = make_config({"scenes": {"spectrum": "measured"}})
    from optics.edof.picture_spectrum import FrequencyGrid

    found = measure_spectrum(Noise(), config).on_grid(FrequencyGrid(32))
    inside = found[2:10, 2:10]
    torch.testing.assert_close(inside, torch.full_like(inside, 0.01), rtol=0.2, atol=0)
