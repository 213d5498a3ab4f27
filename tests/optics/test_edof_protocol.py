"""The evaluation protocol's statements, its pictures, PSFs, captures and borders."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
import torch
from scipy.integrate import quad
from scipy.ndimage import uniform_filter
from scipy.signal import convolve2d
from scipy.special import j0, j1

from optics.camera import Camera, Lens, Panel
from optics.edof.decoders import (
    decoding_period,
    extend_antisymmetrically,
    measure_training_spectrum,
)
from optics.edof.evaluation import SceneBlur, add_noise
from optics.edof.protocol import (
    AUTHORS,
    HIGH_NOISE,
    LOW_NOISE,
    STRICT,
    EdofProtocol,
    NoiseRange,
    decode_srgb,
    encode_srgb,
    prepare_scene,
)
from optics.edof.protocol_psfs import (
    CameraPSFs,
    PupilPattern,
    bin_psf,
    collected_share,
    compute_depth_psfs,
    compute_transfer,
    measured_depth_psfs,
    round_stop,
)
from optics.metrics import relative_error
from optics.plane import Plane
from optics.psf import PSFOperator

SMALL = EdofProtocol("small", psf_window=15, crop=24, centre=12, off_grid_count=6, design_count=4)

CAMERA = Camera(
    panel=Panel(shape=(54, 96), fill_factor=1.0, unmodulated=0.0),
    lens=Lens(focal_length=0.1, f_number=5.6, focus_distance=2.0),
)


def random_picture(*shape: int, seed: int = 0) -> torch.Tensor:
    return torch.rand(shape, generator=torch.Generator().manual_seed(seed))


def lopsided_psf(rows: int, columns: int) -> torch.Tensor:
    psf = random_picture(rows, columns, seed=3) ** 3
    return 0.9 * psf / psf.sum()


# What a protocol states.


def test_the_named_protocols_differ_as_the_published_one_does():
    assert (STRICT.detector_pitch, AUTHORS.detector_pitch) == (3.45e-6, 5 * 3.45e-6)
    assert AUTHORS.scored_in == ("linear", "srgb")
    assert len(STRICT.test_dioptres) == 10 + 40
    assert STRICT.off_grid == STRICT.off_grid
    assert not set(STRICT.on_grid) & set(STRICT.off_grid)


def test_blind_decoders_are_built_for_other_depths_than_those_of_the_test():
    assert not set(STRICT.design_dioptres) & set(STRICT.test_dioptres)


def test_noise_levels_lie_within_their_range():
    assert LOW_NOISE.deviations == pytest.approx((0.001 + 0.014 / 6, 0.008, 0.015 - 0.014 / 6))
    assert HIGH_NOISE.deviations[1] == pytest.approx(0.035)
    assert NoiseRange(0.01, 0.01).deviations == (0.01,)


@pytest.mark.parametrize(
    ("wrong", "name"),
    [
        ({"binning": 0}, "binning"),
        ({"pixel_pitch": -1.0}, "pixel_pitch"),
        ({"border": "mirror"}, "border"),
        ({"light": "log"}, "light"),
        ({"pixel_response": "disc"}, "pixel_response"),
        ({"scored_in": ()}, "scored_in"),
        ({"scored_in": ("linear",)}, "scored_in"),
        ({"centre": 600}, "centre"),
        ({"depth_range": (2.0, 0.0)}, "depth_range"),
        ({"on_grid": (-1.0,)}, "on_grid"),
        ({"shortest_edge": 0}, "shortest_edge"),
        ({"peak": 0.0}, "peak"),
    ],
)
def test_a_protocol_refuses_what_makes_no_sense(wrong, name):
    with pytest.raises(ValueError, match=name):
        replace(STRICT, **wrong)


@pytest.mark.parametrize(
    "wrong", [(0.0, 0.1, 3, 0.0), (0.2, 0.1, 3, 0.0), (0.1, 0.2, 0, 0.0), (0.1, 0.2, 3, 1.5)]
)
def test_a_noise_range_refuses_what_makes_no_sense(wrong):
    with pytest.raises(ValueError):
        NoiseRange(*wrong)


# Pictures.


def test_srgb_is_the_standards_curve():
    """The value of mid grey, and the linear part's end, by IEC 61966-2-1."""
    assert float(decode_srgb(torch.tensor(0.5))) == pytest.approx(0.2140411, rel=1e-5)
    assert float(decode_srgb(torch.tensor(0.02))) == pytest.approx(0.02 / 12.92)
    values = torch.linspace(0, 1, 101, dtype=torch.float64)
    torch.testing.assert_close(encode_srgb(decode_srgb(values)), values, rtol=0, atol=2e-5)
    assert encode_srgb(torch.tensor([-0.2, 1.3])).tolist() == pytest.approx([0, 1])


def test_a_scene_is_the_middle_of_the_photograph():
    picture = random_picture(20, 31)
    assert torch.equal(prepare_scene(picture, 8), picture[6:14, 11:19])
    numpy_scene = prepare_scene(picture.numpy(), 8)
    assert isinstance(numpy_scene, np.ndarray)


def test_colours_become_luminance_in_the_light_that_is_simulated():
    red = torch.zeros(4, 4, 3, dtype=torch.uint8)
    red[..., 0] = 188
    assert float(prepare_scene(red, 4, "linear")[0, 0]) == pytest.approx(0.2126 * 0.503, rel=2e-3)
    assert float(prepare_scene(red, 4, "srgb")[0, 0]) == pytest.approx(0.2126 * 188 / 255)


def test_a_photograph_is_resized_by_its_shortest_edge():
    """Against OpenCV's mean over areas, on a smooth picture."""
    picture = torch.from_numpy(uniform_filter(random_picture(40, 60).numpy(), 9, mode="mirror"))
    scene = prepare_scene(picture, 20, shortest_edge=20)
    peer = cv2.resize(picture.numpy(), (30, 20), interpolation=cv2.INTER_AREA)[:, 5:25]
    assert float((scene - torch.from_numpy(peer)).abs().max()) < 0.02


@pytest.mark.parametrize(
    ("picture", "words"),
    [
        (torch.rand(8, 8) + 1, "sRGB"),
        (torch.full((8, 8), torch.nan), "NaN"),
        (torch.rand(8, 8, 4), "rows, columns"),
        (torch.rand(6, 8), "needs 8 x 8"),
    ],
)
def test_a_photograph_that_does_not_fit_is_refused(picture, words):
    with pytest.raises(ValueError, match=words):
        prepare_scene(picture, 8)


# From fine pixels to detector pixels.


@pytest.mark.parametrize("binning", [2, 3, 5])
@pytest.mark.parametrize("side", [14, 15])
def test_a_binned_psf_is_that_of_enlarging_blurring_and_averaging(binning, side):
    """Each step as published: nearest neighbour up, a direct sum, the mean over squares."""
    psf = lopsided_psf(side, side).double()
    scene = random_picture(9, 9).double()
    fine = scene.repeat_interleave(binning, 0).repeat_interleave(binning, 1).numpy()
    blurred = np.zeros_like(fine)
    for y in range(side):
        for x in range(side):
            shift = (y - side // 2, x - side // 2)
            blurred += float(psf[y, x]) * np.roll(fine, shift, (0, 1))
    wanted = blurred.reshape(9, binning, 9, binning).mean((1, 3))
    kernel = bin_psf(psf, binning)
    assert float(kernel.sum()) == pytest.approx(float(psf.sum()))
    transfer = compute_transfer(kernel, (9, 9))
    found = torch.fft.irfft2(torch.fft.rfft2(scene) * transfer, s=(9, 9))
    np.testing.assert_allclose(found.numpy(), wanted, atol=1e-12)


@pytest.mark.parametrize(("rows", "columns"), [(15, 15), (61, 40), (8, 9)])
@pytest.mark.parametrize("period", [(24, 24), (13, 17)])
def test_a_psf_larger_than_the_period_is_folded_without_loss(rows, columns, period):
    psf = lopsided_psf(rows, columns).double()
    folded = np.zeros(period)
    for y in range(rows):
        for x in range(columns):
            folded[(y - rows // 2) % period[0], (x - columns // 2) % period[1]] += float(psf[y, x])
    found = compute_transfer(psf, period).numpy()
    np.testing.assert_allclose(found, np.fft.rfft2(folded), atol=1e-12)


# Captures.


def test_a_periodic_capture_is_a_circular_sum():
    scene, psf = random_picture(24, 24), lopsided_psf(15, 15)
    wanted = torch.zeros(24, 24)
    for y in range(15):
        for x in range(15):
            wanted += psf[y, x] * torch.roll(scene, (y - 7, x - 7), (0, 1))
    torch.testing.assert_close(SceneBlur(psf, SMALL)(scene), wanted, rtol=0, atol=1e-6)


@pytest.mark.parametrize("side", [15, 14])
def test_a_true_capture_is_the_middle_of_a_larger_scene(side):
    """Against scipy's direct convolution of the scene, which is dark beyond its border."""
    protocol = SMALL.with_border("true")
    assert protocol.scene_side == 24 + 14
    scene, psf = random_picture(38, 38), lopsided_psf(side, side)
    whole = convolve2d(scene.numpy(), psf.numpy())
    first = 7 + side // 2
    wanted = whole[first : first + 24, first : first + 24]
    found = SceneBlur(psf, protocol)(scene)
    np.testing.assert_allclose(found.numpy(), wanted, atol=1e-6)


def test_a_capture_refuses_scenes_and_psfs_that_do_not_fit():
    with pytest.raises(ValueError, match="needs 24 x 24"):
        SceneBlur(lopsided_psf(15, 15), SMALL)(random_picture(38, 38))
    with pytest.raises(ValueError, match="kernel reaches 9"):
        SceneBlur(lopsided_psf(19, 19), SMALL.with_border("true"))


def test_noise_grows_as_the_light_falls():
    image = torch.zeros(200, 200)
    for share in (1.0, 0.25, 0.01):
        noise = add_noise(image, 0.01, share, torch.Generator().manual_seed(0))
        # The relative standard error of a standard deviation of 40000 values is 0.0035.
        assert float(noise.std()) == pytest.approx(0.01 / share, rel=0.015)


def test_photon_noise_grows_with_light_and_only_as_the_root_of_its_share():
    for level in (0.25, 1.0):
        capture = add_noise(
            torch.full((200, 200), level), 0.01, 0.25, torch.Generator().manual_seed(0), 1.0
        )
        assert float(capture.std()) == pytest.approx(0.01 * (level / 0.25) ** 0.5, rel=0.015)


def test_the_same_generator_gives_the_same_noise_for_every_share():
    image = torch.zeros(8, 8)
    one, other = (add_noise(image, 0.01, t, torch.Generator().manual_seed(9)) for t in (1.0, 0.5))
    torch.testing.assert_close(other, 2 * one)


@pytest.mark.parametrize(
    ("deviation", "share", "shot", "name"),
    [(0.0, 1.0, 0.0, "deviation"), (0.1, 0.0, 0.0, "light"), (0.1, 1.1, 0.0, "light"),
     (0.1, 1.0, 2.0, "share")],
)  # fmt: skip
def test_noise_refuses_numbers_out_of_range(deviation, share, shot, name):
    with pytest.raises(ValueError, match=name):
        add_noise(torch.zeros(4, 4), deviation, share, torch.Generator(), shot)


# What lies beyond the border.


@pytest.mark.parametrize("shape", [(22, 25), (44, 50), (31, 38)])
@pytest.mark.parametrize(("noise", "depth"), [(0.0, 1), (0.035, 2), (0.15, 8), (9.0, 16)])
def test_the_extension_keeps_the_capture_and_mirrors_in_points_on_its_edges(shape, noise, depth):
    """Left of a row: twice the mean of a patch at the edge, minus the row beyond the patch."""
    capture = random_picture(22, 25)
    whole = extend_antisymmetrically(capture, shape, noise)
    top, left = shape[0] // 2 - 11, shape[1] // 2 - 12
    torch.testing.assert_close(whole[top : top + 22, left : left + 25], capture)
    centred, row = (capture - capture.mean()).numpy(), 3
    edge = centred[max(row - depth + 1, 0) : row + depth, 0:depth].mean()
    for away in range(1, left + 1):
        fade = 0.5 * (1 + np.cos(np.pi * away / (left + 1)))
        wanted = fade * (2 * edge - centred[row, min(depth - 1 + away, 24)])
        assert float(whole[top + row, left - away] - capture.mean()) == pytest.approx(
            float(wanted), abs=1e-6
        )


def test_the_extension_treats_left_and_right_alike():
    capture = random_picture(22, 22)
    whole = extend_antisymmetrically(capture, (44, 44))
    turned = extend_antisymmetrically(capture.flip(1), (44, 44)).flip(1)
    torch.testing.assert_close(turned[11:33], whole[11:33])


def test_a_slope_goes_on_beyond_the_border():
    ramp = torch.arange(32.0).expand(32, 32)
    whole = extend_antisymmetrically(ramp, (64, 64))
    # The fade begins with a slope of zero, so that the first steps beyond differ little.
    assert float((whole[32].diff()[14:48] - 1).abs().max()) < 0.5


@pytest.mark.parametrize("shape", [(10, 15), (25, 15), (12, 31)])
def test_an_extension_refuses_periods_that_do_not_fit(shape):
    with pytest.raises(ValueError, match="can be extended"):
        extend_antisymmetrically(random_picture(12, 15), shape)


@pytest.mark.parametrize("noise", [-0.1, float("inf"), float("nan")])
def test_an_extension_refuses_noise_that_makes_no_sense(noise):
    with pytest.raises(ValueError, match="noise"):
        extend_antisymmetrically(random_picture(12, 15), (24, 30), noise)


@pytest.mark.parametrize("crop", [24, 31, 512])
def test_a_true_border_is_decoded_in_an_even_period_of_up_to_twice_the_capture(crop):
    protocol = replace(SMALL, crop=crop, centre=8, border="true")
    rows, columns = decoding_period(protocol)
    assert rows == columns
    assert rows % 2 == 0
    assert 1.9 * crop < rows <= 2 * crop
    assert decoding_period(protocol.with_border("periodic")) == (crop, crop)


# PSFs and their light.


def test_a_stop_collects_the_share_of_its_area():
    camera = Camera(panel=Panel(shape=(540, 960)), lens=Lens(0.1, 8.0, 2.0))
    stop = round_stop(camera.panel, 2e-3)
    assert collected_share(stop, camera) == pytest.approx(
        np.pi * 1e-6 / (540 * 960 * 64e-12), rel=5e-3
    )
    assert collected_share(PupilPattern("free", torch.zeros(540, 960)), camera) == 1


def test_a_stop_larger_than_the_lens_collects_all_light():
    camera = Camera(panel=Panel(shape=(54, 96)), lens=Lens(0.1, 500.0, 2.0))
    assert collected_share(round_stop(camera.panel, 4e-4), camera) == 1


def test_psfs_are_computed_with_their_energy():
    """Between the encircled energies of an Airy disc within and around the square window."""
    pattern = round_stop(CAMERA.panel, 2e-4)
    psfs = compute_depth_psfs(pattern, [0.5], CAMERA, replace(SMALL, psf_window=255))
    assert psfs.collected == pytest.approx(np.pi * 1e-8 / (54 * 96 * 64e-12), rel=0.03)
    image_distance = 1 / (1 / 0.1 - 1 / 2.0)
    radii = 127.5 * 3.45e-6 * np.array([1, np.sqrt(2)])
    v = np.pi * 2e-4 * radii / (520e-9 * image_distance)
    within, around = 1 - j0(v) ** 2 - j1(v) ** 2
    assert within - 0.005 < psfs.energies[0] < around
    assert float(psfs.kernels[0].sum()) == pytest.approx(psfs.energies[0], rel=1e-5)


def test_a_narrow_window_loses_light_and_says_so():
    """Of a rectangle's diffraction pattern: the integrals of squared sincs over the window."""
    pattern = PupilPattern("free", torch.zeros(54, 96))
    protocol = replace(SMALL, psf_window=21, pixel_response="area")
    energy = compute_depth_psfs(pattern, [0.5], CAMERA, protocol).energies[0]
    image_distance = 1 / (1 / 0.1 - 1 / 2.0)
    wanted = 1.0
    for pixels in (54, 96):
        half = 10.5 * 3.45e-6 * pixels * 8e-6 / (520e-9 * image_distance)
        wanted *= 2 * quad(lambda t: np.sinc(t) ** 2, 0, half)[0]
    assert energy == pytest.approx(wanted, rel=2e-3)


def test_psfs_are_the_same_whether_or_not_a_pattern_is_symmetric():
    """A symmetric pattern's PSFs are planned for a quarter, those of its shifted self aren't."""
    rows, columns = torch.arange(54.0) - 26.5, torch.arange(96.0) - 47.5
    phase = 1e-3 * (rows[:, None] ** 2 + columns**2).double()
    protocol = replace(SMALL, psf_window=31)
    source = CameraPSFs(CAMERA, protocol)
    whole = PSFOperator(
        CAMERA, 1.0, protocol.wavelength, Plane((31, 31), (3.45e-6, 3.45e-6)), integrate=False
    )(phase)
    assert relative_error(source(PupilPattern("even", phase), [1.0])[0], whole) < 2e-3
    tilted = phase + 1e-9 * columns
    assert relative_error(source(PupilPattern("odd", tilted), [1.0])[0], whole) < 2e-3


def test_psfs_with_more_light_than_is_collected_are_refused():
    psf = lopsided_psf(15, 15)[None]
    assert measured_depth_psfs(psf, [1.0], 0.95, SMALL).energies[0] == pytest.approx(0.9 / 0.95)
    with pytest.raises(ValueError, match="sum to 1 at most"):
        measured_depth_psfs(psf, [1.0], 0.5, SMALL)


@pytest.mark.parametrize(
    ("psfs", "dioptres", "collected", "name"),
    [
        (torch.full((1, 15, 15), torch.nan), [1.0], 1.0, "NaN"),
        (torch.zeros(1, 15, 15), [1.0], 1.0, "hold"),
        (torch.ones(1, 15, 15) / 300, [1.0, 2.0], 1.0, "for 2 depths"),
        (torch.ones(1, 17, 15) / 300, [1.0], 1.0, "window"),
        (torch.ones(1, 15, 15) / 300, [-1.0], 1.0, "dioptres"),
        (torch.ones(1, 15, 15) / 300, [1.0], 0.0, "collected"),
    ],
)
def test_measured_psfs_that_make_no_sense_are_refused(psfs, dioptres, collected, name):
    with pytest.raises(ValueError, match=name):
        measured_depth_psfs(psfs, dioptres, collected, SMALL)


@pytest.mark.parametrize(
    ("phase", "amplitude", "words"),
    [
        (torch.full((54, 96), torch.nan), None, "phase"),
        (None, torch.zeros(54, 96), "amplitude goes"),
        (None, 2 * torch.ones(54, 96), "amplitude goes"),
        (torch.zeros(5, 9), None, "the panel has"),
    ],
)
def test_patterns_that_make_no_sense_are_refused(phase, amplitude, words):
    with pytest.raises(ValueError, match=words):
        collected_share(PupilPattern("bad", phase, amplitude), CAMERA)


@pytest.mark.parametrize("diameter", [0.0, -1.0, 1e-6])
def test_a_stop_must_hold_a_pixel(diameter):
    with pytest.raises(ValueError, match="diameter"):
        round_stop(CAMERA.panel, diameter)


# The spectrum of training pictures.


def test_the_training_spectrum_is_that_of_pictures_at_the_protocols_size():
    """Independent pixels have the same power at all frequencies; enlarged they have no detail."""
    pictures = [random_picture(64, 64, seed=k) for k in range(6)]
    plain = measure_training_spectrum(pictures, SMALL, 64)(32)
    assert plain.shape == (32, 17)
    assert float(plain[0, 0]) == 0
    assert float(plain[8:24, 8:].mean()) == pytest.approx(1 / 12, rel=0.05)
    enlarged = replace(SMALL, shortest_edge=128)
    smooth = measure_training_spectrum(pictures, enlarged, 64)(32)
    assert float(smooth[16, 16]) < 0.02 / 12
    linear = replace(SMALL, light="linear")
    dim = [0.3 * one for one in pictures]
    variance = float(decode_srgb(torch.stack(dim)).var())
    found = measure_training_spectrum(dim, linear, 64)(32)
    assert float(found[8:24, 8:].mean()) == pytest.approx(variance, rel=0.05)
    assert variance < 0.2 * 0.09 / 12


def test_a_training_spectrum_needs_pictures():
    with pytest.raises(ValueError, match="empty"):
        measure_training_spectrum([], SMALL)
