"""What a point's light adds up to behind a panel: parts that interfere, and parts that can't."""

import cmath
import math

import numpy as np
import pytest
import torch

from optics.camera import Camera, Lens, Panel
from optics.plane import Plane
from optics.psf import PSFOperator, modulated_psf
from optics.slm import Modulator
from simulator.formation.kernels import _interference_psf, _ray_psf
from simulator.formation.rays import RayOperator

WAVELENGTH = 550e-9
LENS = Lens(0.1, 20.0, 2.0)
PIXELS = Plane((24, 24), (3.45e-6, 3.45e-6))


def planned(panel: Panel) -> PSFOperator:
    camera = Camera(panel, LENS)
    return PSFOperator(camera, 1.9, WAVELENGTH, PIXELS, tol=1e-6, unmodulated=0.0)


def even(panel: Panel, phase: float) -> torch.Tensor:
    return torch.full(panel.shape, cmath.exp(1j * phase), dtype=torch.complex128)


@pytest.mark.parametrize("phase", [0.0, 1.0, math.pi])
@pytest.mark.parametrize("strength", [0.4, 0.3 - 0.5j, 0.0])
def test_an_even_pattern_interferes_by_its_phase_alone(phase, strength):
    """Of the pattern's field p = exp(i phase) q: Re(strength conj(p) q) is the neutral PSF times
    Re(strength exp(-i phase))."""
    panel = Panel((64, 96), 40e-6, 1.0, unmodulated=0.0)
    operator, modulator = planned(panel), Modulator(panel, WAVELENGTH)
    parts = [(0.25, even(panel, phase)), (0.75, even(panel, phase))]
    neutral = operator(None, even(panel, 0.0))
    found = _interference_psf(operator, modulator, iter(parts), complex(strength))
    expected = (1 + (strength * cmath.exp(-1j * phase)).real) * neutral
    assert float((found - expected).abs().max()) <= 1e-6 * float(neutral.max())


def test_moments_of_a_pattern_interfere_each_for_its_share_of_time():
    panel = Panel((64, 96), 40e-6, 1.0, unmodulated=0.0)
    operator, modulator = planned(panel), Modulator(panel, WAVELENGTH)
    parts = [(0.25, even(panel, 0.0)), (0.75, even(panel, math.pi))]
    neutral = operator(None, even(panel, 0.0))
    found = _interference_psf(operator, modulator, iter(parts), 0.4 + 0j)
    assert float((found - (1 + 0.4 * (0.25 - 0.75)) * neutral).abs().max()) <= 1e-6 * float(
        neutral.max()
    )


@pytest.mark.parametrize("unmodulated", [0.0, 0.3])
def test_rays_and_waves_behind_a_panel_have_the_same_light(unmodulated):
    """Far out of focus, where rays serve: the sum over the frame, and its spread."""
    panel = Panel((64, 96), 40e-6, 1.0, unmodulated=unmodulated)
    camera, pixels = Camera(panel, LENS), Plane((160, 160), (6.9e-6, 6.9e-6))
    modulator = Modulator(panel, WAVELENGTH)
    parts = [(1.0, even(panel, 0.7))]
    rays = _ray_psf(RayOperator(camera, 0.5, WAVELENGTH, pixels), modulator, iter(parts)).numpy()
    waves = modulated_psf(
        PSFOperator(camera, 0.5, WAVELENGTH, pixels, tol=1e-3, unmodulated=0.0), modulator, parts
    ).numpy()
    assert rays.sum() == pytest.approx(waves.sum(), rel=0.02)
    y = (np.arange(160) - 80)[:, None]
    spreads = [math.sqrt((light * y**2).sum() / light.sum()) for light in (rays, waves)]
    assert spreads[0] == pytest.approx(spreads[1], rel=0.05)


def test_what_jitter_scatters_goes_beyond_the_picture_of_rays():
    """Of a phase that jitters by sigma, exp(-sigma²) of the light goes where the pattern says."""
    panel = Panel((64, 96), 40e-6, 1.0, unmodulated=0.3, jitter=0.5)
    operator = RayOperator(Camera(panel, LENS), 0.5, WAVELENGTH, Plane((160, 160), (6.9e-6,) * 2))
    light = _ray_psf(operator, Modulator(panel, WAVELENGTH), iter([(1.0, even(panel, 0.7))]))
    assert float(light.sum()) == pytest.approx(0.7 * math.exp(-0.25) + 0.3, rel=0.01)
