"""The PSF behind a panel with effects, against sums over parts of pixels and many trials."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from judges import positions, relative
from scipy.ndimage import gaussian_filter

from optics.camera import Camera, Lens
from optics.plane import Plane
from optics.psf import PSFOperator, modulated_psf
from optics.slm import Modulator, PanelMap

WAVELENGTH = 550e-9


def with_panel(camera: Camera, **changes) -> Camera:
    return replace(camera, panel=replace(camera.panel, **changes))


def planned(camera: Camera, pixels: Plane | None = None, **settings) -> PSFOperator:
    pixels = pixels or camera.sensor.window_plane((12, 13))
    settings = {"unmodulated": 0.0, "tol": 1e-6, "integrate": False} | settings
    return PSFOperator(camera, 2.0, WAVELENGTH, pixels, **settings)


def random_phase(camera: Camera, seed: int = 0) -> torch.Tensor:
    return torch.from_numpy(np.random.default_rng(seed).uniform(0, 2 * np.pi, camera.panel.shape))


def still(camera: Camera, phase: torch.Tensor) -> tuple[Modulator, list]:
    modulator = Modulator(camera.panel, WAVELENGTH)
    return modulator, [(1.0, modulator.modulation(phase))]


def found(camera: Camera, phase: torch.Tensor, pixels: Plane | None = None) -> np.ndarray:
    return modulated_psf(planned(camera, pixels), *still(camera, phase)).numpy()


@pytest.fixture
def coarse(small_camera) -> Camera:
    """Few pixels, whose every part can be summed."""
    return with_panel(small_camera, shape=(6, 8))


def order(camera: Camera) -> float:
    """Metres on the sensor to the first diffraction order of the pixels."""
    return WAVELENGTH * camera.lens.image_distance / camera.panel.pitch


def fine(values: np.ndarray) -> np.ndarray:
    """20 x 20 parts a pixel."""
    return np.kron(values, np.ones((20, 20)))


def light_of_parts(camera: Camera, fields: np.ndarray, pixels: Plane) -> np.ndarray:
    """|Sum over all parts of all pixels|², as a share of the light on the open area."""
    panel, scale = camera.panel, WAVELENGTH * camera.lens.image_distance
    inside = (np.arange(20) + 0.5) / 20 - 0.5
    kernels = []
    for axis in (0, 1):
        x = (positions(panel.shape[axis], panel.pitch)[:, None] + inside * panel.pitch).ravel()
        u = positions(pixels.shape[axis], pixels.pitch[axis], pixels.centre[axis])
        # A part is a square.
        square = np.sinc(u * panel.pitch / 20 / scale)[:, None]
        kernels.append(square * np.exp(-2j * np.pi / scale * np.outer(u, x)))
    part = (panel.pitch / 20) ** 2
    field = kernels[0] @ fields @ kernels[1].T * part
    power = math.prod(panel.shape) * panel.active_side**2
    return np.abs(field) ** 2 * math.prod(pixels.pitch) / (scale**2 * power)


def open_parts(camera: Camera) -> np.ndarray:
    """A fill factor of 0.81 leaves 18 x 18 parts of a pixel."""
    one = np.zeros((20, 20), dtype=bool)
    one[1:19, 1:19] = True
    return np.tile(one, camera.panel.shape)


def test_a_panel_without_effects_gives_the_operators_own_psf(small_camera):
    camera = with_panel(small_camera, unmodulated=0.07)
    phase = random_phase(camera)
    own = PSFOperator(camera, 2.0, WAVELENGTH, camera.sensor.window_plane((12, 13)), tol=1e-6)
    both = modulated_psf(planned(camera, integrate=True), *still(camera, phase))
    assert relative(both.numpy(), own(phase).numpy()) <= 1e-6


def test_coupled_pixels_send_light_as_their_parts_do(coarse):
    """Blurred by scipy on 20 x 20 parts a pixel, near the axis where the pixel's mean tells."""
    camera = with_panel(coarse, coupling=8e-6)
    phase = random_phase(camera)
    near = Plane((7, 7), (order(camera) / 60, order(camera) / 60))
    blurred = gaussian_filter(fine(phase.numpy()), 4.0, mode="nearest", truncate=6)
    fields = np.where(open_parts(camera), np.exp(1j * blurred), 0)
    truth = light_of_parts(camera, fields, near)
    alone = light_of_parts(
        camera, np.where(open_parts(camera), np.exp(1j * fine(phase.numpy())), 0), near
    )
    assert relative(found(camera, phase, near), truth) <= 0.05
    assert relative(alone, truth) > 0.3


@pytest.mark.parametrize("number", [0, 1])
def test_the_pixels_frame_makes_diffraction_orders(coarse, number):
    """The dark frame between the pixels, on the axis and in the first order beside it."""
    side = order(coarse)
    pixels = Plane((5, 5), (side / 40, side / 40), (0.0, number * side))
    fields = np.where(open_parts(coarse), np.exp(1j * fine(random_phase(coarse).numpy())), 0)
    truth = light_of_parts(coarse, fields, pixels)
    assert relative(found(coarse, random_phase(coarse), pixels), truth) <= 1e-5


def test_a_bright_frame_adds_to_the_zeroth_order(coarse):
    camera = with_panel(coarse, gap_reflection=0.5)
    pixels = Plane((7, 7), (order(camera) / 60, order(camera) / 60))
    phase = random_phase(camera)
    fields = np.where(open_parts(camera), np.exp(1j * fine(phase.numpy())), 0.5)
    assert relative(found(camera, phase, pixels), light_of_parts(camera, fields, pixels)) <= 1e-2
    bare = found(with_panel(coarse), phase, pixels)
    assert relative(bare, light_of_parts(camera, fields, pixels)) > 0.1


def test_jitter_spreads_light_as_many_trials_do(small_camera):
    """The mean over 2000 panels, each with errors of its own: 2 % are left to chance."""
    camera = with_panel(small_camera, jitter=0.6)
    phase = random_phase(camera)
    rng, operator = np.random.default_rng(1), planned(small_camera, tol=1e-4)
    mean = torch.zeros(12, 13, dtype=torch.float64)
    for _ in range(10):
        noise = torch.from_numpy(rng.normal(0, 0.6, (200, *camera.panel.shape)))
        mean += operator(phase + noise).mean(0).to(torch.float64) / 10
    assert relative(found(camera, phase), mean.numpy()) <= 0.03
    assert relative(found(with_panel(small_camera), phase), mean.numpy()) > 0.2


def test_scattered_light_is_dimmed_where_the_stop_covers_pixels(small_camera):
    """The same behind a round stop that cuts pixels, and with an uneven beam."""
    x = np.arange(32.0)[None, :]
    camera = replace(
        with_panel(
            small_camera, jitter=1.0, illumination=PanelMap(np.exp(-((x - 12.0) ** 2) / 200))
        ),
        lens=Lens(0.125, 0.125 / 0.8e-3, 2.0),
    )
    modulator, exposures = still(camera, random_phase(camera))
    operator = planned(camera, tol=1e-4)
    noise = torch.from_numpy(np.random.default_rng(1).normal(0, 1.0, (2000, 24, 32)))
    mean = operator(noise, exposures[0][1]).mean(0)
    assert relative(modulated_psf(operator, modulator, exposures).numpy(), mean.numpy()) <= 0.03


def test_no_light_is_lost_or_made(small_camera):
    """Of pixels so small that each sends light evenly: a whole period of their orders holds the
    fill factor's share, whatever is shown, scattered and left unmodulated."""
    camera = with_panel(small_camera, fill_factor=0.01, jitter=0.5, unmodulated=0.1)
    pixels = Plane((64, 64), (order(camera) / 64, order(camera) / 64))
    for seed in range(3):
        assert found(camera, random_phase(camera, seed), pixels).sum() == pytest.approx(0.01, 0.01)


def test_the_unmodulated_light_has_its_own_wave(small_camera):
    """Flatness bends what went through the panel and not what the glass reflects: the three
    pictures by themselves, added by hand."""
    y, x = np.mgrid[:24, :32]
    flatness = PanelMap(3e-7 * ((x - 16) ** 2 + (y - 12) ** 2) / 100)
    camera = with_panel(
        small_camera, flatness=flatness, unmodulated=0.2, front_reflection=0.06, reflectivity=0.6
    )
    phase, operator = random_phase(camera), planned(small_camera)
    bent = 2 * math.pi * flatness.values / WAVELENGTH
    shown, through, glass = operator(phase + bent), operator(bent), operator()
    truth = 0.9 * 0.8 * shown + 0.9 * 0.2 * through + 0.1 * glass
    assert relative(found(camera, phase), truth.numpy()) <= 1e-6


def test_exposures_are_averaged_by_their_shares(small_camera):
    camera = with_panel(small_camera, unmodulated=0.1)
    modulator, operator = Modulator(camera.panel, WAVELENGTH), planned(camera)
    phases = [random_phase(camera, s) for s in range(3)]
    exposures = ((s, modulator.modulation(p)) for s, p in zip((0.5, 0.2, 0.3), phases, strict=True))
    mean = sum(s * operator(p) for s, p in zip((0.5, 0.2, 0.3), phases, strict=True))
    truth = 0.9 * mean + 0.1 * operator()
    assert relative(modulated_psf(operator, modulator, exposures).numpy(), truth.numpy()) <= 1e-6


def test_light_is_differentiable_in_the_phase(coarse):
    camera = with_panel(coarse, shape=(2, 3), jitter=0.3, coupling=8e-6, unmodulated=0.1)
    operator = planned(camera, camera.sensor.window_plane((2, 2)), tol=1e-8)
    phase = random_phase(camera).requires_grad_()
    assert torch.autograd.gradcheck(lambda p: modulated_psf(operator, *still(camera, p)), phase)


def test_what_does_not_belong_together_is_refused(small_camera):
    camera = with_panel(small_camera, unmodulated=0.1)
    modulator, exposures = still(camera, random_phase(camera))
    pixels = camera.sensor.window_plane((4, 4))
    with pytest.raises(ValueError, match=r"operator adds 0\.1 .* unmodulated=0"):
        modulated_psf(planned(camera, unmodulated=None), modulator, exposures)
    with pytest.raises(ValueError, match="timed_fields is empty"):
        modulated_psf(planned(camera), modulator, [])
    with pytest.raises(ValueError, match="operator is of a lens alone"):
        modulated_psf(PSFOperator(camera.lens, 2.0, WAVELENGTH, pixels), modulator, exposures)
    with pytest.raises(ValueError, match=r"operator's panel has \(6, 8\) pixels .* \(24, 32\)"):
        modulated_psf(planned(with_panel(camera, shape=(6, 8))), modulator, exposures)
    with pytest.raises(ValueError, match="planned for 550 nm and the modulator for 600 nm"):
        modulated_psf(planned(camera), Modulator(camera.panel, 600e-9), exposures)
