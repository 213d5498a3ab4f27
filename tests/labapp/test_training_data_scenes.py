"""Pictures out of random numbers, and scenes of layers to train on."""

from __future__ import annotations

import numpy as np
import pytest

from labapp.common.errors import UserError
from labapp.training.pictures import TrainingPictures
from labapp.training.procedural_scenes import ProceduralPictures
from labapp.training.scenes import SceneSettings, draw_matte, draw_scene
from optics.edof import NATURAL_SPECTRUM, FrequencyGrid


def radial_slope(spectrum, frequency) -> float:
    """Slope of log power over log frequency, from 1/32 to 1/4 cycles per pixel."""
    edges = np.geomspace(1 / 32, 1 / 4, 7)
    ring = np.digitize(frequency, edges)
    rings = [ring == number for number in range(1, 7)]
    power = [np.log(spectrum[one].mean()) for one in rings]
    return np.polyfit([np.log(frequency[one]).mean() for one in rings], power, 1)[0]


def test_made_pictures_have_the_power_spectrum_of_photographs():
    side, total = 128, 0.0
    window = np.hanning(side)[:, None] * np.hanning(side)
    for seed in range(60):
        picture = ProceduralPictures().patch(np.random.default_rng((8, seed)), side)
        total = total + np.abs(np.fft.rfft2((picture - picture.mean()) * window)) ** 2
    frequency = np.hypot(np.fft.fftfreq(side)[:, None], np.fft.rfftfreq(side))
    slope = radial_slope(total, frequency)
    photographs = NATURAL_SPECTRUM.on_grid(FrequencyGrid(side)).numpy()
    assert abs(slope + 2) < 0.4
    assert abs(slope - radial_slope(photographs, frequency)) < 0.3


def test_made_pictures_are_random_greys():
    made = [ProceduralPictures().patch(np.random.default_rng((2, n)), 48) for n in range(20)]
    again = ProceduralPictures().patch(np.random.default_rng((2, 7)), 48)
    np.testing.assert_array_equal(again, made[7])
    assert len({one.tobytes() for one in made}) == 20
    for one in made:
        assert one.shape == (48, 48)
        assert one.dtype == np.float32
        assert 0 <= one.min() < one.max() <= 1
    assert 0.3 < np.mean(made) < 0.6
    assert np.std(made) > 0.15


def scenes(settings: SceneSettings, count: int = 120, side: int = 32):
    source = ProceduralPictures()
    return [draw_scene(source, np.random.default_rng((3, n)), side, settings) for n in range(count)]


def test_half_of_the_scenes_have_two_to_four_layers():
    drawn = scenes(SceneSettings())
    layers = [len(one.pictures) for one in drawn]
    assert abs(np.mean(np.array(layers) > 1) - 0.5) < 4 * np.sqrt(0.25 / 120)
    assert set(layers) == {1, 2, 3, 4}
    for one in drawn:
        assert one.pictures.shape == one.mattes.shape == (len(one.pictures), 32, 32)
        assert one.pictures.dtype == one.mattes.dtype == np.float32
        assert one.mattes.min() >= 0
        assert one.mattes.max() <= 1
        assert (one.mattes[-1] == 1).all()


@pytest.mark.parametrize(("share", "most", "expected"), [(0.0, 4, {1}), (1.0, 2, {2})])
def test_settings_decide_the_number_of_layers(share, most, expected):
    drawn = scenes(SceneSettings(share, most), 30)
    assert {len(one.pictures) for one in drawn} == expected


def test_a_scene_depends_on_its_generator_alone():
    first, again = (scenes(SceneSettings(1.0), 10) for _ in range(2))
    for one, other in zip(first, again, strict=True):
        np.testing.assert_array_equal(one.pictures, other.pictures)
        np.testing.assert_array_equal(one.mattes, other.mattes)


def test_no_layer_is_cut_from_another():
    """Correlations of different pictures stay far below those of equal ones."""
    for scene in scenes(SceneSettings(1.0), 20):
        between = np.corrcoef(scene.pictures.reshape(len(scene.pictures), -1))
        assert (np.abs(between - np.eye(len(between))) < 0.9).all()


def test_scenes_are_drawn_from_the_pictures_of_their_split():
    dark, bright = np.zeros((3, 40, 40), np.uint8), np.full((3, 40, 40), 255, np.uint8)
    pictures = TrainingPictures([dark, bright], ["training", "validation"])
    generator = np.random.default_rng(1)
    settings = SceneSettings(1.0)
    assert draw_scene(pictures, generator, 32, settings).pictures.max() == 0
    validation = draw_scene(pictures, generator, 32, settings, "validation")
    np.testing.assert_allclose(validation.pictures, 1, atol=1e-6)


def test_mattes_have_edges_of_about_a_pixel():
    """Most pixels are covered or free; partly covered ones lie along edges, between both."""
    mattes = [draw_matte(np.random.default_rng((4, n)), 64) for n in range(60)]
    partial = np.array([np.mean((one > 0) & (one < 1)) for one in mattes])
    assert (partial > 0).mean() > 0.9
    assert np.mean(partial) < 0.15
    assert all(0.03 <= one.mean() <= 0.7 for one in mattes)
    for one in mattes:
        # Two pixels from an edge a matte is 0 or 1: no step is spread over more than three pixels.
        rising = np.diff(one, axis=1)
        runs = (rising[:, :-3] > 0) & (rising[:, 1:-2] > 0) & (rising[:, 2:-1] > 0)
        assert np.mean(runs & (rising[:, 3:] > 0)) < 0.02


def test_bad_settings_and_sides_are_refused():
    with pytest.raises(UserError, match="give 0 to 1"):
        SceneSettings(1.5)
    with pytest.raises(UserError, match="give 2 or more"):
        SceneSettings(0.5, 1)
    generator = np.random.default_rng(1)
    with pytest.raises(UserError, match="give 8 or more"):
        draw_scene(ProceduralPictures(), generator, 7, SceneSettings())
    with pytest.raises(UserError, match="give 8 or more"):
        ProceduralPictures().patch(generator, 7)
