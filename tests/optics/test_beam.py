"""The light along the axis, against closed forms and against the PSF on the sensor."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from scipy.special import fresnel

from optics.beam import beam_irradiance
from optics.camera import Camera, Lens, Panel, Sensor
from optics.camera.pupil import open_area
from optics.plane import Plane
from optics.progress import Cancelled, Progress
from optics.psf import PSFOperator

WAVELENGTH = 520e-9
PANEL = Panel((60, 80), 16e-6, 1.0, unmodulated=0.0)


def camera(separation: float = 0.04, f_number: float = 10.0, panel: Panel = PANEL) -> Camera:
    return Camera(panel, Lens(0.03, f_number, 1.0), Sensor(), separation=separation)


def row(half: float, count: int = 41, middle: float = 0.0) -> Plane:
    return Plane((1, count), (half, 2 * half / (count - 1)), (0.0, middle))


def strip(low: float, high: float, x: np.ndarray, scale: float) -> np.ndarray:
    """Fresnel's integral over a strip of constant light, from low to high."""
    unit = math.sqrt(2 / abs(scale))
    (s1, c1), (s0, c0) = fresnel((high - x) * unit), fresnel((low - x) * unit)
    return ((c1 - c0) + 1j * (s1 - s0)) / math.sqrt(2)


@pytest.mark.parametrize("distance", [math.inf, 0.3])
def test_between_panel_and_lens_it_is_fresnels_rectangle(distance: float) -> None:
    depths, across = [0.003, 0.02, 0.04], row(0.9e-3)
    light = beam_irradiance(camera(), None, distance, WAVELENGTH, depths, across)
    # Pixels stand around n // 2: half a pixel more on one side.
    edges = [((-n / 2 - 0.5) * 16e-6, (n / 2 - 0.5) * 16e-6) for n in PANEL.shape]
    for depth, found in zip(depths, light, strict=True):
        stretch = 1 + depth / distance
        scale = WAVELENGTH * depth / stretch
        wave_x = strip(*edges[1], across.coordinates(1).numpy() / stretch, scale)
        wave_y = strip(*edges[0], np.zeros(1), scale)
        truth = np.abs(wave_x * wave_y) ** 2 / stretch**2
        assert np.allclose(found, truth, rtol=2e-3, atol=2e-3)


@pytest.mark.parametrize("separation", [0.0, 1e-9])
def test_on_the_axis_behind_a_round_stop_it_is_known(separation: float) -> None:
    lens = Lens(0.03, 40.0, 1.0)
    whole = Camera(Panel((100, 100), 10e-6, 1.0, unmodulated=0.0), lens, separation=separation)
    radius, depths = lens.stop_diameter / 2, np.array([0.022, 0.0285, 0.030, 0.0315, 0.04])
    light = beam_irradiance(whole, None, math.inf, WAVELENGTH, depths.tolist(), row(1e-6, 3))[:, 1]
    # The integral of a disc with a parabolic wave, in closed form.
    bend = 1 / depths - 1 / lens.focal_length
    half = np.pi * radius**2 * bend / (2 * WAVELENGTH)
    truth = (np.pi * radius**2 / (WAVELENGTH * depths) * np.sinc(half / np.pi)) ** 2
    assert np.allclose(light, truth, rtol=0.02, atol=0.02 * truth.max())


@pytest.mark.parametrize("field", [(0.0, 0.0), (0.15e-3, -0.2e-3)])
@pytest.mark.parametrize("separation", [0.0, 0.03])
def test_on_the_sensor_it_is_the_psf(separation: float, field: tuple[float, float]) -> None:
    rng = np.random.default_rng(3)
    phase = torch.from_numpy(rng.uniform(0, 2, PANEL.shape))
    whole, distance = camera(separation), 0.7
    pixels = Plane((1, 61), (3e-6, 3e-6))
    psf = PSFOperator(whole, distance, WAVELENGTH, pixels, integrate=False, field=field, tol=1e-3)(
        phase
    )
    depth = separation + whole.lens.image_distance
    across = Plane((1, 61), (3e-6, 3e-6), (0.0, field[1]))
    light = beam_irradiance(whole, phase, distance, WAVELENGTH, [depth], across, field=field)[0]
    truth = psf[0] * open_area(whole) / 9e-12
    assert float((light - truth).norm() / truth.norm()) < 0.03


def test_beyond_the_focus_left_is_right() -> None:
    tilted = 0.5 * torch.arange(80.0, dtype=torch.float64)[None].expand(60, 80)
    one = camera(0.0)
    near, far = (
        beam_irradiance(one, tilted, math.inf, WAVELENGTH, [depth], row(5e-3, 1001))[0]
        for depth in (0.005, 0.12)
    )
    place = row(5e-3, 1001).coordinates(1)
    middles = [float((light * place).sum() / light.sum()) for light in (near, far)]
    # The slope of the phase times the way: the lens doesn't bend the ray through its centre.
    slope = 0.5 * WAVELENGTH / (2 * math.pi * 16e-6)
    expected = [slope * 0.005 - 8e-6 * (1 - 0.005 / 0.03), slope * 0.12 + 8e-6 * 3]
    assert np.allclose(middles, expected, atol=2e-5)


def test_light_that_ignores_the_pattern_is_added() -> None:
    phase = torch.full(PANEL.shape, 1.0, dtype=torch.float64)
    phase[:, ::2] += math.pi
    asked = (math.inf, WAVELENGTH, [0.04 + 0.0309], row(2e-5, 9))
    coded, plain = beam_irradiance(camera(), phase, *asked), beam_irradiance(camera(), None, *asked)
    mixed = beam_irradiance(camera(), phase, *asked, unmodulated=0.3)
    assert torch.allclose(mixed, 0.7 * coded + 0.3 * plain)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"depths": [0.0]}, "depths are .* behind the panel"),
        ({"depths": [math.inf]}, "depths are"),
        ({"sample_row": Plane((2, 9), (1e-6, 1e-6))}, "sample_row has 2 rows"),
        ({"phase": torch.zeros(3, 4)}, r"phase is \(3, 4\)"),
        ({"distance": -1.0}, "distance is -1"),
        ({"unmodulated": 1.5}, "unmodulated is 1.5"),
    ],
)
def test_bad_input_is_named(change: dict, words: str) -> None:
    asked = {
        "camera": camera(), "phase": None, "distance": 1.0, "wavelength": WAVELENGTH,
        "depths": [0.05], "sample_row": row(1e-3),
    }  # fmt: skip
    with pytest.raises(ValueError, match=words):
        beam_irradiance(**(asked | change))


def test_it_can_be_cancelled() -> None:
    progress = Progress()
    progress.cancel()
    with pytest.raises(Cancelled):
        beam_irradiance(camera(), None, 1.0, WAVELENGTH, [0.05], row(1e-3), progress=progress)
