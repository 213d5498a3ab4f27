"""Evaluations of extended depth of field: what decoders are told, scores, and alarms."""

import random
from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.linalg import circulant
from scipy.stats import ttest_rel
from skimage.metrics import peak_signal_noise_ratio, structural_similarity

from optics.camera import Camera, Lens, Panel
from optics.edof.decoders import (
    BlindDecoder,
    KnownDepthDecoder,
    blind_wiener,
    decoding_transfers,
    extend_antisymmetrically,
    known_depth_wiener,
    no_decoder,
)
from optics.edof.evaluation import MeasuredPattern, evaluate_patterns
from optics.edof.protocol import EdofProtocol, NoiseRange
from optics.edof.protocol_psfs import (
    CameraPSFs,
    PupilPattern,
    compute_depth_psfs,
    measured_depth_psfs,
)
from optics.edof.scoring import (
    Alarm,
    CaptureScores,
    check_energy,
    check_off_grid,
    check_repeatability,
    check_sampler,
    compare_scores,
    on_grid_advantage,
    score_picture,
)
from optics.progress import Cancelled, Progress

# Pixels of 80 um, so that few of them fill a pupil of 4.3 x 7.7 mm.
CAMERA = Camera(
    panel=Panel(shape=(54, 96), pitch=80e-6, fill_factor=1.0, unmodulated=0.0),
    lens=Lens(focal_length=0.1, f_number=5.6, focus_distance=2.0),
)
OPEN = PupilPattern("open", torch.zeros(54, 96, dtype=torch.float64))
SMALL = EdofProtocol(
    "small",
    psf_window=31,
    crop=32,
    centre=16,
    noise=NoiseRange(0.002, 0.002),
    depth_range=(0.47, 0.53),
    on_grid=(0.475, 0.5, 0.52),
    off_grid_count=4,
    design_count=3,
)


def flat_spectrum(n: int) -> torch.Tensor:
    """Of pictures whose pixels are independent, with a variance of 1 / 12."""
    power = torch.full((n, n // 2 + 1), 1 / 12, dtype=torch.float64)
    power[0, 0] = 0
    return power


def pictures(count: int, side: int = 32) -> list[torch.Tensor]:
    generator = torch.Generator().manual_seed(7)
    return [torch.rand(side, side, generator=generator) for _ in range(count)]


def delta(depths: int, side: int = 31) -> torch.Tensor:
    psfs = torch.zeros(depths, side, side)
    psfs[:, side // 2, side // 2] = 1
    return psfs


def box(depths: int, width: int, side: int = 31) -> torch.Tensor:
    psfs, first = torch.zeros(depths, side, side), side // 2 - width // 2
    psfs[:, first : first + width, first : first + width] = 1 / width**2
    return psfs


def measured(name: str, test: torch.Tensor, design: torch.Tensor | None = None) -> MeasuredPattern:
    design = test[:1].expand(SMALL.design_count, -1, -1) if design is None else design
    return MeasuredPattern(
        name,
        measured_depth_psfs(design, SMALL.design_dioptres, 1.0, SMALL),
        measured_depth_psfs(test, SMALL.test_dioptres, 1.0, SMALL),
    )


def kinds(alarms) -> set[str]:
    return {one.kind for one in alarms}


# What a decoder is told.


def test_a_blind_decoder_is_built_before_captures_and_gets_nothing_else():
    """It gets the same whatever the depths of the test are, and captures in no order of depth."""
    told = []

    def run(on_grid):
        events = []

        def build(design, noise):
            events.append(("build", design.clone(), noise))

            def restore(*given):
                events.append(("restore", *given))
                return given[0]

            return restore

        protocol = replace(SMALL, on_grid=on_grid)
        evaluate_patterns(
            [OPEN], pictures(1), CAMERA, protocol, [BlindDecoder("spy", build)], with_ssim=False
        )
        told.append(events)

    run((0.475, 0.5, 0.52))
    run((0.48, 0.49, 0.51))
    for events in told:
        assert [one[0] for one in events[:8]] == ["build"] + 7 * ["restore"]
        assert all(len(one) == 2 for one in events if one[0] == "restore")
    assert torch.equal(told[0][0][1], told[1][0][1])
    assert told[0][0][2] == told[1][0][2] == pytest.approx(0.002)


def test_the_blind_filter_restores_a_capture_in_the_same_way_at_every_depth():
    design = decoding_transfers(
        compute_depth_psfs(OPEN, SMALL.design_dioptres, CAMERA, SMALL), SMALL
    )
    restore = blind_wiener(flat_spectrum).build(design, 0.01)
    capture = pictures(1)[0]
    restored = restore(capture)
    for other in pictures(3):
        restore(other)
    assert torch.equal(restore(capture), restored)


def test_a_decoder_that_counts_captures_raises_an_alarm():
    def build(design, noise):
        calls = []

        def restore(capture):
            calls.append(1)
            return capture + 0.01 * len(calls)

        return restore

    table = evaluate_patterns(
        [measured("sharp", delta(7))],
        pictures(1),
        CAMERA,
        SMALL,
        [BlindDecoder("counting", build), no_decoder()],
        with_ssim=False,
    )
    assert "stateful" in kinds(table.find("sharp", "counting").alarms)
    assert "stateful" not in kinds(table.find("sharp", "capture").alarms)


def test_a_known_depth_decoder_gets_the_psf_of_each_depth_and_is_not_called_blind():
    seen = set()

    def build(transfer, noise):
        seen.add(round(float(transfer[0, 0].real), 6))
        return lambda capture: capture

    psfs = torch.linspace(0.4, 1, 7)[:, None, None] * delta(7)
    table = evaluate_patterns(
        [measured("dimming", psfs)],
        pictures(1),
        CAMERA,
        SMALL,
        [KnownDepthDecoder("oracle", build)],
        with_ssim=False,
    )
    assert {round(0.4 + 0.1 * k, 6) for k in range(7)} <= seen
    assert not table.find("dimming", "oracle").is_blind


def test_the_wiener_filters_are_those_of_least_squares():
    """Against the covariances' dense matrices, on a ring of 6 x 6 pixels."""
    n, noise = 6, 0.3
    generator = torch.Generator().manual_seed(1)
    psfs = torch.rand(3, n, n, generator=generator, dtype=torch.float64) / n**2
    transfers = torch.fft.rfft2(torch.fft.ifftshift(psfs, dim=(-2, -1)))
    capture = torch.rand(n, n, generator=generator, dtype=torch.float64)
    capture = capture - capture.mean()

    def matrix(kernel):
        blocks = [circulant(row) for row in kernel]
        return np.block([[blocks[(i - j) % n] for j in range(n)] for i in range(n)])

    def lmmse(kernels):
        blurs = [matrix(np.fft.ifftshift(one)) for one in kernels]
        # Independent pixels without their mean.
        prior = (np.eye(n * n) - 1 / n**2) / 12
        seen = sum(b @ prior @ b.T for b in blurs) / len(blurs) + noise**2 * np.eye(n * n)
        cross = prior @ sum(blurs).T / len(blurs)
        return (cross @ np.linalg.solve(seen, capture.numpy().ravel())).reshape(n, n)

    blind = blind_wiener(flat_spectrum).build(transfers, noise)(capture)
    known = known_depth_wiener(flat_spectrum).build(transfers[1], noise)(capture)
    np.testing.assert_allclose(blind.numpy(), lmmse(psfs.numpy()), atol=1e-6)
    np.testing.assert_allclose(known.numpy(), lmmse(psfs[1:2].numpy()), atol=1e-6)


def test_a_true_border_costs_little_in_the_centre():
    """A broad blur, one filter, and the scene beyond the capture unknown."""
    generator = torch.Generator().manual_seed(3)
    frequencies = np.hypot(np.fft.fftfreq(160)[:, None], np.fft.fftfreq(160)[None])
    frequencies[0, 0] = 1
    noise = torch.randn(160, 160, generator=generator).numpy()
    rough = np.fft.ifft2(np.fft.fft2(noise) / frequencies**1.2).real
    picture = torch.from_numpy((rough - rough.min()) / np.ptp(rough)).float()

    def spectrum(n):
        f = torch.hypot(torch.fft.fftfreq(n)[:, None], torch.fft.rfftfreq(n)[None]).double()
        f[0, 0] = 1
        power = 1e-5 * f**-2.4
        power[0, 0] = 0
        return power

    base = replace(SMALL, crop=96, centre=48)
    pattern = measured("blur", box(7, 7))
    found = {}
    for border in ("periodic", "true"):
        table = evaluate_patterns(
            [pattern], [picture], CAMERA, base.with_border(border), [blind_wiener(spectrum)],
            with_ssim=False,
        )  # fmt: skip
        found[border] = {row.part: row.scores.mean for row in table.rows if row.pattern == "blur"}
    assert found["true"]["frame"] > found["periodic"]["frame"] - 1.3
    assert found["true"]["centre"] > found["periodic"]["centre"] - 0.3


def test_a_filter_restores_a_smaller_capture_by_its_extension_for_the_noise():
    """By numpy's transforms; with this noise, the value at the edge is a mean over five pixels."""
    capture, noise = pictures(1)[0], 0.09
    transfers = torch.full((1, 64, 33), 0.5 + 0j)
    restored = blind_wiener(flat_spectrum).build(transfers, noise)(capture)
    gain = 0.5 / 12 / (0.25 / 12 + noise**2)
    response = np.full((64, 33), gain)
    response[0, 0] = 2
    whole = extend_antisymmetrically(capture, (64, 64), noise).numpy()
    wanted = np.fft.irfft2(np.fft.rfft2(whole) * response)[16:48, 16:48]
    np.testing.assert_allclose(restored.numpy(), wanted, atol=1e-5)
    other = extend_antisymmetrically(capture, (64, 64)).numpy()
    assert np.abs(whole - other).max() > 0.1


# What is always in the table.


def test_stops_are_always_in_the_table_with_their_loss_of_light_in_the_noise():
    """A grey scene leaves nothing but noise in the capture."""
    grey = [torch.full((32, 32), 0.5)]
    table = evaluate_patterns([OPEN], grey, CAMERA, SMALL, [no_decoder()], with_ssim=False)
    rows = {row.pattern: row for row in table.rows}
    assert list(rows) == ["open", "stop 1 mm", "stop 2 mm", "stop 4 mm"]
    area = 54 * 96 * (80e-6) ** 2
    for diameter in (1e-3, 2e-3):
        row = rows[f"stop {diameter * 1e3:g} mm"]
        share = np.pi * diameter**2 / 4 / area
        assert row.collected == pytest.approx(share, rel=0.1)
        energy = np.mean(row.energies)
        wanted = -20 * np.log10(0.002 / row.collected / energy)
        assert row.scores.mean == pytest.approx(wanted, abs=0.6)


def test_decoders_are_told_the_noise_of_a_stop():
    noises = []

    def build(design, noise):
        noises.append(noise)
        return lambda capture: capture

    table = evaluate_patterns(
        [OPEN], pictures(1), CAMERA, SMALL, [BlindDecoder("spy", build)], with_ssim=False
    )
    shares = [row.collected for row in table.rows if row.part == "frame"]
    assert noises == pytest.approx([0.002 / one for one in shares])


def test_every_depth_of_the_protocol_is_scored():
    table = evaluate_patterns([OPEN], pictures(2), CAMERA, SMALL, [no_decoder()], with_ssim=False)
    scores = table.find("open", "capture").scores
    assert scores.dioptres == SMALL.test_dioptres
    assert scores.psnr.shape == (2, 7)
    assert bool((scores.psnr > 0).all())
    assert scores.mean_ssim is None


def test_every_pattern_sees_the_same_noise():
    table = evaluate_patterns(
        [measured("one", delta(7)), measured("other", delta(7))],
        pictures(2),
        CAMERA,
        SMALL,
        [no_decoder()],
    )
    one, other = (table.find(name, "capture").scores for name in ("one", "other"))
    assert torch.equal(one.psnr, other.psnr)
    assert torch.equal(one.ssim, other.ssim)
    assert compare_scores(one, other).mean == 0


def test_noise_levels_are_known_and_pictures_take_turns():
    noises = []

    def build(design, noise):
        noises.append(noise)
        return lambda capture: capture

    protocol = replace(SMALL, noise=NoiseRange(0.01, 0.03, 2))
    table = evaluate_patterns(
        [measured("sharp", delta(7))],
        pictures(3),
        CAMERA,
        protocol,
        [BlindDecoder("spy", build)],
        with_ssim=False,
    )
    assert noises[:2] == pytest.approx([0.015, 0.025])
    found = table.find("sharp", "spy").scores.psnr.mean(1).numpy()
    np.testing.assert_allclose(found, -20 * np.log10([0.015, 0.025, 0.015]), atol=0.4)


# How a protocol is gamed, and what it says.


def test_psfs_that_are_cropped_and_normalised_raise_an_alarm():
    """By the energy that they should have, or by the light in the rim of their window."""
    protocol = replace(SMALL, psf_window=15)
    honest = CameraPSFs(CAMERA, protocol)(OPEN, [0.47])
    energy = float(honest.sum())
    assert energy < 0.95
    cropped = honest / energy
    for expected in ([energy], None):
        given = (protocol, expected)
        assert check_energy(measured_depth_psfs(honest, [0.47], 1.0, *given)) is None
        alarm = check_energy(measured_depth_psfs(cropped, [0.47], 1.0, *given))
        assert alarm is not None
        assert alarm.kind == "renormalised"


def test_a_source_that_normalises_its_psfs_raises_an_alarm():
    own = CameraPSFs(CAMERA, SMALL)

    def normalised(pattern, dioptres):
        psfs = own(pattern, dioptres)
        share = (pattern.amplitude**2).mean() if pattern.amplitude is not None else 1.0
        return share * psfs / psfs.sum((1, 2), keepdim=True)

    for source, alarmed in ((normalised, {"renormalised"}), (lambda *given: own(*given), set())):
        table = evaluate_patterns(
            [OPEN], pictures(1), CAMERA, SMALL, [no_decoder()], source=source, with_ssim=False
        )
        assert kinds(table.find("open", "capture").alarms) - {"off-grid"} == alarmed


def test_a_design_for_the_published_depths_alone_raises_an_alarm():
    gamed = torch.cat([delta(3), box(4, 5)])
    table = evaluate_patterns(
        [measured("ten depths", gamed), measured("even", box(7, 5))],
        pictures(2),
        CAMERA,
        SMALL,
        [blind_wiener(flat_spectrum)],
        with_ssim=False,
    )
    assert "off-grid" in kinds(table.find("ten depths", "blind Wiener").alarms)
    assert table.find("even", "blind Wiener").alarms == ()


def test_a_lens_in_focus_on_the_grid_raises_no_alarm():
    """One depth of the grid is sharp by chance; PSNR falls evenly to both sides of it."""
    dioptres = (0.0, 0.5, 1.0, 0.1, 0.3, 0.7, 0.9)
    psnr = torch.tensor([[30 - 10 * one for one in dioptres]], dtype=torch.float64)
    psnr[0, 0] += 6
    scores = CaptureScores(dioptres, 3, psnr, torch.zeros(1, 0))
    assert on_grid_advantage(scores) == pytest.approx(0)
    assert check_off_grid(scores) is None
    psnr[0, :3] += 2.7
    assert on_grid_advantage(scores) == pytest.approx(2.7)
    assert check_off_grid(scores).kind == "off-grid"


def test_a_sampler_that_leaves_out_half_a_metre_is_named_in_the_row():
    generator = random.Random(3)
    depths = SMALL.on_grid
    alarm = check_sampler(lambda: int(generator.random() * (len(depths) - 1)), depths)
    assert alarm.kind == "undrawn"
    assert "0.52 dioptres" in alarm.message
    assert check_sampler(lambda: generator.randrange(len(depths)), depths) is None
    table = evaluate_patterns(
        [measured("trained", delta(7))],
        pictures(1),
        CAMERA,
        SMALL,
        [no_decoder()],
        known_alarms={"trained": [alarm]},
        with_ssim=False,
    )
    assert alarm in table.find("trained", "capture").alarms
    assert alarm not in table.find("stop 1 mm", "capture").alarms


def test_a_decoder_is_repeatable_if_it_gives_the_same_again():
    capture = pictures(1)[0]
    assert check_repeatability(lambda one: 2 * one, capture, 2 * capture) is None
    assert isinstance(check_repeatability(lambda one: 3 * one, capture, 2 * capture), Alarm)


# Scores.


@pytest.mark.parametrize("part", ["frame", "centre"])
def test_scores_are_those_of_a_peer(part):
    protocol = replace(SMALL, light="linear", scored_in=("linear", "srgb"))
    reference, other = pictures(2)
    restored = 0.9 * reference + 0.1 * other
    cut = (slice(8, 24), slice(8, 24)) if part == "centre" else (slice(None), slice(None))
    a, b = reference[cut].double().numpy(), restored[cut].double().numpy()
    for scale in ("linear", "srgb"):
        if scale == "srgb":
            a, b = (np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1 / 2.4) - 0.055)
                    for x in (a, b))  # fmt: skip
        found, similarity = score_picture(restored, reference, protocol, scale, part)
        assert found == pytest.approx(peak_signal_noise_ratio(a, b, data_range=1), abs=1e-3)
        peer = structural_similarity(
            a, b, data_range=1, gaussian_weights=True, sigma=1.5, use_sample_covariance=False
        )
        assert similarity == pytest.approx(peer, abs=1e-4)


def test_the_difference_of_two_patterns_is_that_of_a_paired_test():
    generator = torch.Generator().manual_seed(0)
    first = torch.rand(8, 5, generator=generator, dtype=torch.float64)
    second = first + 0.1 * torch.rand(8, 5, generator=generator, dtype=torch.float64)
    dioptres, none = (0.0, 0.5, 1.0, 1.5, 2.0), torch.zeros(8, 0)
    found = compare_scores(
        CaptureScores(dioptres, 2, second, none), CaptureScores(dioptres, 2, first, none)
    )
    peer = ttest_rel(second.mean(1).numpy(), first.mean(1).numpy())
    assert found.mean / found.standard_error == pytest.approx(peer.statistic)
    assert found.pictures == 8


def test_means_and_the_worst_depth_are_over_pictures():
    psnr = torch.tensor([[10.0, 20.0, 30.0], [20.0, 12.0, 30.0]], dtype=torch.float64)
    scores = CaptureScores((1.0, 2.0, 0.5), 2, psnr, torch.tensor([[0.5], [0.7]]))
    assert (scores.on_grid, scores.off_grid) == (15.5, 30.0)
    assert scores.worst == (1.0, 15.0)
    assert scores.psnr_by_depth == (15.0, 16.0, 30.0)
    assert scores.mean_ssim == pytest.approx(0.6)


def test_only_scores_of_the_same_pictures_and_depths_are_paired():
    scores = CaptureScores((1.0, 2.0), 1, torch.zeros(3, 2), torch.zeros(3, 0))
    with pytest.raises(ValueError, match="second has"):
        compare_scores(scores, replace(scores, dioptres=(1.0, 1.5)))
    single = replace(scores, psnr=torch.zeros(1, 2))
    with pytest.raises(ValueError, match="standard error"):
        compare_scores(single, single)
    with pytest.raises(ValueError, match="both kinds"):
        on_grid_advantage(replace(scores, on_grid_count=2))


# What an evaluation refuses.


def test_an_evaluation_refuses_what_makes_no_sense():
    decoders = [no_decoder()]
    with pytest.raises(ValueError, match="'open' more than once"):
        evaluate_patterns([OPEN, OPEN], pictures(1), CAMERA, SMALL, decoders)
    with pytest.raises(ValueError, match="pictures is empty"):
        evaluate_patterns([OPEN], [], CAMERA, SMALL, decoders)
    with pytest.raises(ValueError, match="decoders is empty"):
        evaluate_patterns([OPEN], pictures(1), CAMERA, SMALL, [])
    with pytest.raises(ValueError, match="needs 62 x 62"):
        evaluate_patterns([OPEN], pictures(1), CAMERA, SMALL.with_border("true"), decoders)
    pattern = measured("sharp", delta(7))
    with pytest.raises(ValueError, match="measure at its test_dioptres"):
        evaluate_patterns(
            [pattern], pictures(1), CAMERA, replace(SMALL, seed=2), decoders, with_ssim=False
        )


def test_a_row_that_is_not_there_is_refused():
    table = evaluate_patterns([OPEN], pictures(1), CAMERA, SMALL, [no_decoder()], with_ssim=False)
    with pytest.raises(ValueError, match="it has open with capture"):
        table.find("open", "oracle")


def test_an_evaluation_reports_and_can_be_cancelled():
    messages = []

    def listen(fraction, message):
        messages.append((fraction, message))
        if "open with capture" in message:
            progress.cancel()

    progress = Progress(listen)
    with pytest.raises(Cancelled):
        evaluate_patterns(
            [OPEN], pictures(1), CAMERA, SMALL, [no_decoder()], progress=progress, with_ssim=False
        )
    assert messages[0] == (0.0, "PSFs of open")
