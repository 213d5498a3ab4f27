"""Learned decoders in evaluations, and the filters before their network, beside linear ones."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from optics.camera import Camera, Lens, Panel
from optics.edof.decoders import (
    BlindDecoder,
    KnownDepthDecoder,
    blind_wiener,
    extend_antisymmetrically,
    known_depth_wiener,
)
from optics.edof.evaluation import MeasuredPattern, evaluate_patterns
from optics.edof.learned import (
    CaptureFilter,
    DecoderNetwork,
    DecoderSettings,
    NetworkShape,
    WienerFront,
    learned_decoder,
    wiener_front,
)
from optics.edof.learned.decoder_network import fit_psf
from optics.edof.learned.wiener_front import DepthStatistics, add_unmodulated_light
from optics.edof.protocol import EdofProtocol, NoiseRange
from optics.edof.protocol_psfs import measured_depth_psfs
from optics.edof.spectral_criterion import blind_filter

SHAPE = NetworkShape(channels=2, levels=2, fold=2)
CAMERA = Camera(
    panel=Panel(shape=(54, 96), pitch=80e-6, fill_factor=1.0, unmodulated=0.0),
    lens=Lens(focal_length=0.1, f_number=5.6, focus_distance=2.0),
)
PROTOCOL = EdofProtocol(
    "small",
    psf_window=31,
    crop=32,
    centre=16,
    noise=NoiseRange(0.01, 0.01),
    depth_range=(0.47, 0.53),
    on_grid=(0.475, 0.5, 0.52),
    off_grid_count=2,
    design_count=3,
)


def spectrum(n: int) -> torch.Tensor:
    """Falling with the square of the frequency."""
    f = torch.hypot(torch.fft.fftfreq(n)[:, None], torch.fft.rfftfreq(n)[None]).double()
    f[0, 0] = 1
    power = 1e-3 / f.square()
    power[0, 0] = 0
    return power


def gaussian(side: int, width: float) -> torch.Tensor:
    """PSF with its origin at n // 2."""
    away = torch.arange(side, dtype=torch.float64) - side // 2
    line = torch.exp(-((away / width) ** 2) / 2)
    return torch.outer(line, line) / line.sum() ** 2


def transfer_of(psf: torch.Tensor) -> torch.Tensor:
    return torch.fft.rfft2(torch.fft.ifftshift(psf, dim=(-2, -1)))


def random_transfers(count: int, n: int, seed: int = 0) -> torch.Tensor:
    """Of random PSFs of sum 1, complex."""
    psfs = torch.rand(count, n, n, generator=torch.Generator().manual_seed(seed)).double() ** 8
    return transfer_of(psfs / psfs.sum((1, 2), keepdim=True))


def random_network(**settings) -> DecoderNetwork:
    torch.manual_seed(3)
    network = DecoderNetwork(DecoderSettings(SHAPE, **settings))
    torch.nn.init.normal_(network.refining.tail.weight, std=0.2)
    return network.requires_grad_(False)


def picture(rows: int, columns: int, seed: int = 0) -> torch.Tensor:
    return torch.rand(rows, columns, generator=torch.Generator().manual_seed(seed))


# Filters.


def test_the_front_is_the_blind_filter_for_each_noise():
    transfers, levels = random_transfers(5, 24), [0.0, 0.003, 0.2]
    front = WienerFront.of_transfers(transfers, spectrum(24))
    found = front.response(torch.tensor(levels))
    assert found.shape == (3, 24, 13)
    for one, noise in zip(found, levels, strict=True):
        wanted = blind_filter(transfers, spectrum(24), noise).to(torch.complex64)
        assert one.isfinite().all()
        torch.testing.assert_close(one, wanted, rtol=1e-5, atol=1e-5)


def test_the_front_of_known_depths_has_a_filter_for_each_capture():
    transfers, levels = random_transfers(3, 24), [0.02, 0.003, 0.2]
    front = WienerFront.of_known_depths(transfers.to(torch.complex64), spectrum(24))
    found = front.response(torch.tensor(levels))
    for one, own, noise in zip(found, transfers, levels, strict=True):
        wanted = blind_filter(own[None], spectrum(24), noise).to(torch.complex64)
        torch.testing.assert_close(one, wanted, rtol=1e-5, atol=1e-5)


def test_a_front_filters_captures_by_their_own_noise():
    """By numpy's transforms."""
    front = WienerFront.of_transfers(random_transfers(4, 24), spectrum(24))
    captures, levels = torch.stack([picture(24, 24, k) for k in range(2)])[:, None], [0.01, 0.3]
    found = front(captures, torch.tensor(levels))
    for k, noise in enumerate(levels):
        response = blind_filter(random_transfers(4, 24), spectrum(24), noise).numpy()
        wanted = np.fft.irfft2(np.fft.rfft2(captures[k, 0].numpy()) * response)
        np.testing.assert_allclose(found[k, 0].numpy(), wanted, atol=1e-5)


def test_statistics_give_the_front_of_transfer_functions_that_are_mixed():
    transfers, flat = random_transfers(6, 20, 1), random_transfers(6, 20, 2)
    shares, levels = torch.tensor([0.0, 0.05, 0.4, 1.0]), torch.tensor([0.01, 0.02, 0.01, 0.3])
    known = DepthStatistics.of_transfers(transfers, flat, spectrum(20))
    found = known.front(shares).response(levels)
    for one, share, noise in zip(found, shares.tolist(), levels.tolist(), strict=True):
        mixed = (1 - share) * transfers + share * flat
        wanted = WienerFront.of_transfers(mixed, spectrum(20)).response(torch.tensor([noise]))
        torch.testing.assert_close(one, wanted[0], rtol=1e-4, atol=1e-5)
    mixed = add_unmodulated_light(transfers, flat, torch.full((6,), 0.4, dtype=torch.float64))
    torch.testing.assert_close(mixed, 0.6 * transfers + 0.4 * flat)


@pytest.mark.parametrize("size", [(60, 60), (46, 60), (20, 33)])
def test_a_filter_for_captures_is_that_of_evaluations(size):
    """The front's kernel on the capture's own period, by numpy's transforms."""
    noise, side = 0.01, 64
    transfers = torch.stack([transfer_of(gaussian(side, width)) for width in (0.7, 1.1)])
    front = WienerFront.of_transfers(transfers, spectrum(side))
    capture = picture(*size)
    found = CaptureFilter(front, noise)(capture)
    assert found.shape == size
    response = blind_filter(transfers, spectrum(side), noise)
    kernel = np.fft.fftshift(np.fft.irfft2(response.numpy(), (side, side)))
    # Periods that hold the kernel and the extension, however the filter chooses its own.
    period = tuple(min(2 * n, n + side // 2) // 2 * 2 for n in size)
    whole = extend_antisymmetrically(capture, period, noise).double().numpy()
    folded = np.zeros(period)
    for y, x in np.ndindex(side, side):
        folded[(y - side // 2) % period[0], (x - side // 2) % period[1]] += kernel[y, x]
    filtered = np.fft.irfft2(np.fft.rfft2(whole) * np.fft.rfft2(folded), period)
    first = [p // 2 - n // 2 for p, n in zip(period, size, strict=True)]
    wanted = filtered[first[0] : first[0] + size[0], first[1] : first[1] + size[1]]
    inside = (slice(6, -6), slice(6, -6))
    np.testing.assert_allclose(found[inside].numpy(), wanted[inside], atol=3e-3)


def test_a_filter_for_captures_is_the_evaluations_decoder_where_periods_agree():
    noise, side = 0.01, 64
    transfers = random_transfers(3, side)
    decoder = blind_wiener(spectrum).build(transfers, noise)
    front = WienerFront.of_transfers(transfers, spectrum(side))
    for size in (32, 33):
        assert CaptureFilter(front, noise)._extended_length(size) == 64
        capture = picture(size, size)
        torch.testing.assert_close(
            CaptureFilter(front, noise)(capture), decoder(capture), rtol=0, atol=1e-5
        )


@pytest.mark.parametrize("size", [(150, 90), (31, 201), (131, 131)])
def test_parts_are_filtered_as_one_transform_would(monkeypatch, size):
    front = WienerFront.of_transfers(random_transfers(3, 32), spectrum(32))
    capture = picture(*size)
    whole = CaptureFilter(front, 0.01)(capture)
    monkeypatch.setattr(wiener_front, "_LARGEST_PERIOD", 72)
    parts = CaptureFilter(front, 0.01)(capture)
    torch.testing.assert_close(parts, whole, rtol=0, atol=1e-5)
    monkeypatch.setattr(wiener_front.CaptureFilter, "_extended_length", lambda self, n: n + n % 2)
    assert (CaptureFilter(front, 0.01)(capture) - whole).abs().max() > 1e-3


@pytest.mark.parametrize("size", [(40, 40), (41, 53), (1, 7), (300, 20)])
def test_a_constant_picture_stays_constant(monkeypatch, size):
    monkeypatch.setattr(wiener_front, "_LARGEST_PERIOD", 128)
    transfers = torch.stack([transfer_of(gaussian(32, width)) for width in (1.0, 2.0)])
    found = CaptureFilter(WienerFront.of_transfers(transfers, spectrum(32)), 0.02)(
        torch.full(size, 0.6)
    )
    torch.testing.assert_close(found, torch.full(size, 0.6), rtol=0, atol=1e-5)


# Decoders.


def measured(name: str, widths: list[float]) -> MeasuredPattern:
    design = torch.stack([gaussian(31, one).float() for one in np.linspace(0.6, 1.6, 3)])
    test = torch.stack([gaussian(31, one).float() for one in widths])
    return MeasuredPattern(
        name,
        measured_depth_psfs(design, PROTOCOL.design_dioptres, 1.0, PROTOCOL),
        measured_depth_psfs(test, PROTOCOL.test_dioptres, 1.0, PROTOCOL),
    )


@pytest.mark.parametrize("border", ["periodic", "true"])
@pytest.mark.parametrize("light", ["srgb", "linear"])
def test_a_decoder_whose_network_is_zero_is_a_wiener_filter(border, light):
    protocol = replace(PROTOCOL.with_border(border), light=light)
    decoders = [blind_wiener(spectrum), known_depth_wiener(spectrum)]
    for front in ("blind", "known"):
        network = DecoderNetwork(DecoderSettings(SHAPE, front, light=light))
        decoders.append(learned_decoder(network, spectrum, f"learned {front}"))
    pattern = measured("blur", [0.7, 0.9, 1.1, 1.3, 1.5])
    table = evaluate_patterns([pattern], [picture(64, 64)], CAMERA, protocol, decoders)
    for scale in protocol.scored_in:
        for name, own in (("blind Wiener", "learned blind"), ("known-depth Wiener", None)):
            plain = table.find("blur", name, scale)
            learned = table.find("blur", own or "learned known", scale)
            assert learned.is_blind == plain.is_blind
            np.testing.assert_allclose(learned.scores.psnr, plain.scores.psnr, atol=1e-4)


@pytest.mark.parametrize("front", ["blind", "known", "none"])
@pytest.mark.parametrize("psf_channel", [False, True])
def test_what_is_told_the_depth_is_no_blind_decoder(front, psf_channel):
    network = random_network(front=front, psf_channel=psf_channel)
    decoder = learned_decoder(network, spectrum)
    told = front == "known" or psf_channel
    assert isinstance(decoder, KnownDepthDecoder if told else BlindDecoder)
    pattern = measured("blur", [0.7, 0.9, 1.1, 1.3, 1.5])
    table = evaluate_patterns([pattern], [picture(32, 32)], CAMERA, PROTOCOL, [decoder])
    row = table.find("blur", "learned")
    assert row.is_blind is not told
    assert "stateful" not in {one.kind for one in row.alarms}
    again = evaluate_patterns([pattern], [picture(32, 32)], CAMERA, PROTOCOL, [decoder])
    assert np.array_equal(again.find("blur", "learned").scores.psnr, row.scores.psnr)


def test_the_order_of_captures_changes_nothing():
    """Captures of two depths exchanged: the same results, bit for bit."""
    transfers = torch.stack([transfer_of(gaussian(32, width)) for width in (0.8, 1.5)])
    captures = [
        torch.fft.irfft2(torch.fft.rfft2(picture(32, 32).double()) * one).float()
        for one in transfers
    ]
    decoder = learned_decoder(random_network(), spectrum)
    first, second = (decoder.build(transfers, 0.01) for _ in range(2))
    forwards = [first(one) for one in captures]
    backwards = [second(one) for one in reversed(captures)][::-1]
    assert all(torch.equal(a, b) for a, b in zip(forwards, backwards, strict=True))
    assert not torch.equal(forwards[0], forwards[1])


def test_the_psf_channel_is_the_psf_with_a_peak_of_one():
    """In the period, in a smaller capture, and in a larger one."""
    transfer, channels = transfer_of(gaussian(32, 1.3)), []
    network = random_network(psf_channel=True)
    network.refining.register_forward_pre_hook(lambda module, given: channels.append(given[0]))
    restore = learned_decoder(network, spectrum).build(transfer, 0.01)
    restore(picture(32, 32))
    restore(picture(20, 20))
    whole = gaussian(32, 1.3) / gaussian(32, 1.3).max()
    wanted = [whole, whole[6:26, 6:26]]
    for found, psf in zip(channels, wanted, strict=True):
        torch.testing.assert_close(found[0, 3], psf.float(), rtol=0, atol=1e-6)
        torch.testing.assert_close(found[0, 2], torch.full_like(found[0, 2], 0.2))
    larger = fit_psf(gaussian(32, 1.3), (40, 37))
    assert larger.shape == (40, 37)
    assert larger[20, 18] == larger.max() == 1
    assert larger[:4].abs().max() == 0


def test_a_network_that_is_given_too_much_or_too_little_says_so():
    with pytest.raises(ValueError, match="front is blind; give what it made of captures"):
        random_network().restore(picture(8, 8), 0.01)
    with pytest.raises(ValueError, match="front is none; leave filtered out"):
        random_network(front="none").restore(picture(8, 8), 0.01, picture(8, 8))
    with pytest.raises(ValueError, match="psf_channel is True; give the PSFs of captures"):
        random_network(psf_channel=True).restore(picture(8, 8), 0.01, picture(8, 8))
    with pytest.raises(ValueError, match="psf_channel is False; leave psfs out"):
        random_network().restore(picture(8, 8), 0.01, picture(8, 8), picture(8, 8))
    with pytest.raises(ValueError, match=r"filtered .*\(8, 9\)"):
        random_network().restore(picture(8, 8), 0.01, picture(8, 9))
    with pytest.raises(ValueError, match=r"captures are \(1, 1, 10, 8\); .*multiples of 4"):
        random_network(front="none")(torch.zeros(1, 1, 10, 8), torch.tensor([0.01]))


@pytest.mark.parametrize("noise", [-0.1, float("nan"), float("inf")])
def test_noise_that_can_not_be(noise):
    network, front = random_network(), WienerFront.of_transfers(random_transfers(2, 8), spectrum(8))
    with pytest.raises(ValueError, match="noise is"):
        network.restore(picture(8, 8), noise, picture(8, 8))
    with pytest.raises(ValueError, match="noise is"):
        CaptureFilter(front, noise)


def test_captures_that_are_not_finite_are_refused():
    capture = picture(8, 8)
    capture[2, 3] = torch.nan
    front = WienerFront.of_transfers(random_transfers(2, 8), spectrum(8))
    with pytest.raises(ValueError, match="capture"):
        CaptureFilter(front, 0.01)(capture)
    with pytest.raises(ValueError, match="capture"):
        random_network(front="none").restore(capture, 0.01)
