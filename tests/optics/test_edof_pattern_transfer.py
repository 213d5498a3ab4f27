"""OTFs of patterns against direct sums, closed forms, the PSF operator and finite differences."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from optics.camera import Camera, Lens, Panel, Sensor
from optics.camera.stop import Circle, Stop
from optics.edof.field_maps import CosineMatrixMap, CosineTransformMap, FoldedMap, chirp_map
from optics.edof.panel_transfer import FullTransfer, QuarterTransfer
from optics.edof.spectral_criterion import blind_error
from optics.edof.transfer_design import TransferDesign
from optics.psf import PSFOperator

WAVELENGTH = 520e-9
# Light of this panel repeats after 251.2 pixels; its OTF ends at an eighth of the sampling rate.
PANEL = Panel(shape=(24, 32), pitch=60e-6, unmodulated=0.0)
CAMERA = Camera(PANEL, Lens(0.1, 20.0, math.inf), Sensor(pitch=3.45e-6))
FOLDED = replace(CAMERA, sensor=Sensor(pitch=20e-6))
"""Its pixels are so large that they fold the OTF."""


def _direct_psf(design, phase, dioptre):
    """The light at the samples by sums over all panel pixels, float64."""
    camera = design.camera
    panel, samples = camera.panel, design.sample_positions().numpy()
    u = np.concatenate([-samples[:0:-1], samples]) * camera.sensor.pitch
    y, x = ((np.arange(n) - n // 2) * panel.pitch for n in panel.shape)
    turns = dioptre / (2 * WAVELENGTH) * (y[:, None] ** 2 + x[None, :] ** 2)
    wave = design.open_shares().numpy() * np.exp(1j * phase + 2j * np.pi * turns)
    rows = np.exp(-2j * np.pi * np.outer(u, y) / design.scale)
    columns = np.exp(-2j * np.pi * np.outer(x, u) / design.scale)
    light = np.abs(rows @ wave @ columns) ** 2
    return light * design.step**2 / (design.open_shares().numpy() ** 2).sum()


def _direct_otf(design, light, size):
    """The Fourier sum of the light at the sensor's frequencies."""
    samples = design.sample_positions().numpy()
    u = np.concatenate([-samples[:0:-1], samples])
    rows = np.exp(-2j * np.pi * np.outer(np.fft.fftfreq(size), u))
    columns = np.exp(-2j * np.pi * np.outer(u, np.fft.rfftfreq(size)))
    return rows @ light @ columns


def _phase(shape, seed=1, strength=3.0):
    generator = torch.Generator().manual_seed(seed)
    return strength * torch.randn(shape, generator=generator, dtype=torch.float64)


@pytest.mark.parametrize("fast", [True, False])
@pytest.mark.parametrize("camera", [CAMERA, FOLDED])
def test_full_pattern_has_the_otf_of_direct_sums(camera, fast):
    design = TransferDesign(camera, WAVELENGTH, 32, reach=20, fast=fast)
    phase = _phase(PANEL.shape)
    found = FullTransfer(design, torch.complex128)(phase, (0.0, 1.5))
    for one, dioptre in zip(found, (0.0, 1.5), strict=True):
        expected = _direct_otf(design, _direct_psf(design, phase.numpy(), dioptre), 32)
        np.testing.assert_allclose(one, expected, atol=1e-12)


@pytest.mark.parametrize("fast", [True, False])
def test_quarter_pattern_has_the_otf_of_direct_sums(fast):
    camera = replace(CAMERA, lens=replace(CAMERA.lens, focus_distance=0.8))
    # A panel without its first row and column would be symmetric about its origin pixel.
    design = TransferDesign(camera, WAVELENGTH, 32, reach=100, fast=fast)
    transfer = QuarterTransfer(design, torch.complex128)
    # A smooth pattern, which sends little light to the window's border: that moves with depth.
    quarter = 3 * torch.cos(torch.linspace(0, 3, 16, dtype=torch.float64)).expand(12, 16)
    depths = (0.0, 1.25, 3.0)
    found = transfer.on_axis(transfer(quarter, depths), depths)
    full = FullTransfer(design, torch.complex128)
    expected = full(transfer.mirror(quarter), depths)
    np.testing.assert_allclose(found, expected, atol=1e-3)
    np.testing.assert_allclose(found[1], expected[1], atol=1e-11)


def test_quarter_pattern_behind_a_round_stop_is_nearly_exact():
    stop = Stop(Circle(0.3))
    camera = replace(CAMERA, lens=replace(CAMERA.lens, stop=stop))
    design = TransferDesign(camera, WAVELENGTH, 32, reach=100)
    quarter, full = (kind(design, torch.complex128) for kind in (QuarterTransfer, FullTransfer))
    pattern = 3 * torch.cos(torch.linspace(0, 3, 16, dtype=torch.float64)).expand(12, 16)
    found = quarter.on_axis(quarter(pattern, (0.5,)), (0.5,))
    expected = full(quarter.mirror(pattern), (0.5,))
    # The panel's middle is half a pixel beside the stop's, whose radius is 12 pixels.
    np.testing.assert_allclose(found.abs(), expected.abs(), atol=1e-2)
    shares = design.open_shares().numpy() ** 2
    assert 0.5 < shares.sum() / (24 * 32) < 0.7


def test_fast_length_is_whole_and_a_little_longer():
    design = TransferDesign(CAMERA, WAVELENGTH, 32, reach=20)
    assert design.period == pytest.approx(251.208, abs=1e-3)
    assert design.transform_length == 252
    assert design.samples_per_pixel == pytest.approx(252 / 251.208, rel=1e-5)
    assert TransferDesign(CAMERA, WAVELENGTH, 32, reach=20, fast=False).transform_length is None


def test_panel_longer_than_the_period_is_folded():
    camera = replace(CAMERA, sensor=Sensor(pitch=30.96e-6))
    design = TransferDesign(camera, WAVELENGTH, 16, reach=12)
    assert design.transform_length < PANEL.shape[1]
    full, quarter = (kind(design, torch.complex128) for kind in (FullTransfer, QuarterTransfer))
    pattern = _phase(quarter.shape)
    whole = quarter.mirror(pattern)
    expected = _direct_otf(design, _direct_psf(design, whole.numpy(), 0.0), 16)
    np.testing.assert_allclose(full(whole, (0.0,))[0], expected, atol=1e-12)
    found = quarter.on_axis(quarter(pattern, (0.0,)), (0.0,))[0]
    np.testing.assert_allclose(found, expected, atol=1e-12)


def test_flat_pattern_in_focus_has_the_triangles_of_a_rectangle():
    design = TransferDesign(CAMERA, WAVELENGTH, 64, reach=125, pixel_size=True)
    panel = replace(PANEL, fill_factor=1.0)
    design = replace(design, camera=replace(CAMERA, panel=panel))
    transfer = QuarterTransfer(design)
    found = transfer(torch.zeros(transfer.shape), (0.0,))[0]
    fy, fx = (f / CAMERA.sensor.pitch for f in transfer.grid.frequencies())
    shift = design.scale / PANEL.pitch
    expected = (1 - fy * shift / 24).clamp(min=0) * (1 - fx * shift / 32).clamp(min=0)
    # Light outside the window is missing.
    np.testing.assert_allclose(found, expected, atol=0.03)
    assert 0.95 < float(found[0, 0]) < 1


# With more defocus the wave is curved inside the panel's pixels, which this model leaves out.
@pytest.mark.parametrize("dioptre", [0.0, 0.05])
def test_light_agrees_with_the_psf_operator(dioptre):
    design = TransferDesign(CAMERA, WAVELENGTH, 64, reach=30, fast=False, pixel_size=True)
    transfer = FullTransfer(design)
    phase = _phase(PANEL.shape)
    operator = PSFOperator(
        CAMERA,
        1 / dioptre if dioptre else math.inf,
        WAVELENGTH,
        CAMERA.sensor.window_plane((61, 61)),
        integrate=False,
        tol=1e-5,
    )
    light = operator(phase).double().numpy()
    expected = _direct_otf(design, light, 64)
    found = transfer(phase, (dioptre,))[0].numpy()
    # Both are scaled to their own light: the operator's counts what the panel absorbs.
    scale = expected[0, 0].real / found[0, 0].real
    error = np.linalg.norm(found * scale - expected) / np.linalg.norm(expected)
    assert error < 1e-3


@pytest.mark.parametrize("kind", [QuarterTransfer, FullTransfer])
def test_gradient_is_that_of_finite_differences(kind):
    transfer = kind(TransferDesign(CAMERA, WAVELENGTH, 16, reach=20), torch.complex128)
    spectrum = torch.rand(transfer.grid.shape, dtype=torch.float64)
    shares, depths = transfer.grid.shares(), (0.2, 1.0, 1.9)

    def error(phase):
        return blind_error(transfer(phase, depths), spectrum, shares, 0.05)

    phase = _phase(transfer.shape).requires_grad_()
    (gradient,) = torch.autograd.grad(error(phase), phase)
    direction = _phase(transfer.shape, seed=2)
    with torch.no_grad():
        change = float(error(phase + 1e-5 * direction) - error(phase - 1e-5 * direction)) / 2e-5
    assert float((gradient * direction).sum()) == pytest.approx(change, rel=1e-6)


def test_single_precision_keeps_five_digits_of_thousands_of_radians():
    design = TransferDesign(CAMERA, WAVELENGTH, 32, reach=60)
    phase = _phase(QuarterTransfer(design).shape, strength=2000.0)
    single = QuarterTransfer(design)(phase, (1.9,))
    double = QuarterTransfer(design, torch.complex128)(phase, (1.9,))
    assert float((single - double).norm() / double.norm()) < 1e-5


@pytest.mark.parametrize("binning", [2, 3])
def test_binned_otf_is_that_of_coarse_scenes(binning):
    size = 16
    design = TransferDesign(CAMERA, WAVELENGTH, size, binning=binning, reach=15, fast=False)
    transfer = FullTransfer(design, torch.complex128)
    phase = _phase(PANEL.shape)
    light = _direct_psf(design, phase.numpy(), 0.7)
    scene = np.random.default_rng(3).random((size, size))
    fine = np.kron(scene, np.ones((binning, binning)))
    kernel = np.zeros_like(fine)
    for row in range(-15, 16):
        for column in range(-15, 16):
            kernel[row % len(fine), column % len(fine)] += light[row + 15, column + 15]
    seen = np.fft.ifft2(np.fft.fft2(fine) * np.fft.fft2(kernel)).real
    binned = seen.reshape(size, binning, size, binning).mean(axis=(1, 3))
    found = transfer(phase, (0.7,))[0].numpy()
    expected = np.fft.irfft2(np.fft.rfft2(scene) * found, s=scene.shape)
    np.testing.assert_allclose(binned, expected, atol=1e-12)


def test_light_beyond_the_window_is_lost():
    phase = _phase((12, 16))
    designs = [TransferDesign(CAMERA, WAVELENGTH, 16, reach=reach) for reach in (10, 60, 125)]
    shares = [float(QuarterTransfer(one)(phase, (0.0,))[0, 0, 0]) for one in designs]
    assert shares[0] < 0.5 * shares[1] < shares[1] < shares[2]
    # 251 of 252 samples of a period are in the widest window.
    assert shares[2] == pytest.approx(1, abs=0.02)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"size": 15}, "size"),
        ({"reach": 0}, "reach"),
        ({"reach": 130}, "at most 125"),
        ({"binning": 0}, "binning"),
        ({"wavelength": -1.0}, "wavelength"),
        ({"camera": replace(CAMERA, separation=0.01)}, "separation"),
        (
            {"camera": replace(CAMERA, lens=replace(CAMERA.lens, aberrations=((4, 0, 1e-7),)))},
            "aberrations",
        ),
        ({"camera": replace(CAMERA, panel=replace(PANEL, shape=(24, 31)))}, "even"),
    ],
)
def test_bad_designs_are_refused(change, message):
    given = {"camera": CAMERA, "wavelength": WAVELENGTH, "size": 16, "reach": 20}
    with pytest.raises(ValueError, match=message):
        QuarterTransfer(TransferDesign(**(given | change)))


def test_pattern_of_another_shape_is_refused():
    transfer = QuarterTransfer(TransferDesign(CAMERA, WAVELENGTH, 16, reach=20))
    with pytest.raises(ValueError, match="phase is"):
        transfer(torch.zeros(24, 32), (0.0,))


def test_cosine_transforms_and_matrices_are_the_same_map():
    wave = torch.complex(_phase((12, 16)), _phase((12, 16), seed=2))
    fast, slow = (
        CosineTransformMap((12, 16), 9, 14),
        CosineMatrixMap((12, 16), 9, 1 / 28, torch.complex128),
    )
    torch.testing.assert_close(fast(wave), slow(wave))
    seen = fast(wave) + 1
    torch.testing.assert_close(fast.adjoint(seen), slow.adjoint(seen))


@pytest.mark.parametrize("shape", [(12, 16), (11, 16)])
@pytest.mark.parametrize("length", [14, 20])
def test_adjoints_keep_inner_products(shape, length):
    maps = [
        CosineTransformMap(shape, 6, length),
        FoldedMap(shape, 6, length),
        chirp_map(shape, 6, 1 / 17.3, torch.complex128),
    ]
    wave = torch.complex(_phase(shape), _phase(shape, seed=2))
    for one in maps:
        seen = one(wave)
        other = torch.complex(_phase(seen.shape, seed=3), _phase(seen.shape, seed=4))
        ahead = torch.vdot(other.flatten(), seen.flatten())
        back = torch.vdot(one.adjoint(other).flatten(), wave.flatten())
        torch.testing.assert_close(ahead, back)
