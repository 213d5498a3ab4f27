"""The network of learned decoders: what a pixel sees, its size, tiles, and the screen's scale."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from optics.edof.learned import DecoderNetwork, DecoderSettings, NetworkShape, UNet
from optics.edof.learned.decoder_network import decode_screen, encode_screen
from optics.edof.learned.u_net import apply_in_tiles, tile_side
from optics.edof.protocol import encode_srgb

SMALL = NetworkShape(channels=2, levels=2, fold=1)
SHAPES = [
    SMALL,
    NetworkShape(channels=2, levels=3, fold=2),
    NetworkShape(channels=2, levels=2, fold=2, convolutions=3),
    NetworkShape(channels=2, levels=3, fold=1, dilations=(1, 2, 4)),
    NetworkShape(channels=2, levels=3, fold=1, overlapping=True),
    NetworkShape(channels=2, levels=2, fold=3, convolutions=2, dilations=(3,), overlapping=True),
    NetworkShape(channels=2, levels=1, fold=2),
]


def alive(module: torch.nn.Module) -> torch.nn.Module:
    """Random positive weights and biases, so that no path is cut by a ReLU and nothing cancels."""
    generator = torch.Generator().manual_seed(5)
    with torch.no_grad():
        for weight in module.parameters():
            weight.copy_(torch.rand(weight.shape, generator=generator, dtype=torch.float64))
            if weight.ndim > 1:
                weight /= weight[0].numel()
    return module


def random_network(shape: NetworkShape, **settings) -> DecoderNetwork:
    """Weights as they are before training, and a random last convolution."""
    torch.manual_seed(2)
    network = DecoderNetwork(DecoderSettings(shape, **settings))
    torch.nn.init.normal_(network.refining.tail.weight, std=0.3)
    return network.requires_grad_(False)


def measured_reach(shape: NetworkShape) -> int:
    """Largest distance along an axis from a changed pixel to an output that changes with it."""
    network = alive(UNet(shape, 1).double()).requires_grad_(False)
    multiple = shape.multiple
    side = (2 * (shape.reach // multiple) + 5) * multiple
    flat = torch.zeros(1, 1, 2 * multiple, side, dtype=torch.float64)
    before, most = network(flat), 0
    middle = side // 2 // multiple * multiple
    for place in range(middle, middle + multiple):
        changed = flat.clone()
        changed[..., multiple, place] = 1
        columns = (network(changed) != before).any(2).flatten().nonzero().flatten()
        assert 0 < columns.min() < columns.max() < side - 1
        most = max(most, int((columns - place).abs().max()))
    return most


@pytest.mark.parametrize("shape", SHAPES)
def test_a_pixel_of_the_result_sees_as_far_as_is_said(shape):
    measured = measured_reach(shape)
    assert measured <= shape.reach
    # Tiles would be larger than they need to be.
    assert shape.reach - measured <= 2 * shape.multiple


def test_sides_are_multiples_of_the_coarsest_pixels():
    assert [one.multiple for one in SHAPES] == [2, 8, 4, 4, 4, 6, 2]
    network = random_network(SHAPES[1])
    network.refining(torch.zeros(1, 3, 16, 24))
    with pytest.raises(RuntimeError):
        network.refining(torch.zeros(1, 3, 16, 20))


def test_the_weights_are_as_many_as_counted_by_hand():
    """Two levels of 2 and 4 channels: head, block, down, bottom, up, block, tail, with biases."""
    counts = [3 * 2 * 9 + 2, 2 * (2 * 2 * 9 + 2), 2 * 4 * 4 + 4, 2 * (4 * 4 * 9 + 4)]
    counts += [4 * 2 * 4 + 2, 2 * (2 * 2 * 9 + 2), 2 * 9 + 1]
    assert sum(one.numel() for one in UNet(SMALL, 3).parameters()) == sum(counts)


def test_the_thesis_network_has_17_million_weights():
    shape = NetworkShape(64, 4, 1, 3, (1, 2, 4), overlapping=True)
    with torch.device("meta"):
        count = sum(one.numel() for one in UNet(shape, 3).parameters())
    assert 15e6 < count < 18e6


def test_it_starts_as_zero_and_has_no_statistics_of_batches():
    network = DecoderNetwork(DecoderSettings(SHAPES[1]))
    pictures = torch.rand(3, 1, 16, 16, generator=torch.Generator().manual_seed(0))
    filtered, noise = pictures.flip(0), torch.tensor([0.01, 0.02, 0.03])
    with torch.no_grad():
        assert torch.equal(network(pictures, noise, filtered), filtered)
        network = random_network(SHAPES[1]).train()
        together = network(pictures, noise, filtered)
        assert (together - filtered).abs().max() > 1e-3
        for k in range(3):
            one = slice(k, k + 1)
            alone = network(pictures[one], noise[one], filtered[one])
            torch.testing.assert_close(alone, together[one], rtol=0, atol=1e-6)


@pytest.mark.parametrize("size", [(75, 90), (64, 33), (17, 130)])
@pytest.mark.parametrize("shape", [SHAPES[1], SHAPES[3], SHAPES[4]])
def test_tiles_have_no_seams(size, shape):
    network = random_network(shape).refining
    picture = torch.rand(1, 3, *size, generator=torch.Generator().manual_seed(1))
    with torch.no_grad():
        whole = apply_in_tiles(network, picture, shape.multiple, shape.reach, tile=10**6)
        tiles = apply_in_tiles(network, picture, shape.multiple, shape.reach, tile=16)
        # The whole is what the network gives for the picture, continued to full pixels.
        more = [-n % shape.multiple for n in size]
        padded = torch.nn.functional.pad(picture, (0, more[1], 0, more[0]), mode="replicate")
        direct = network(padded)[..., : size[0], : size[1]]
    assert tiles.shape == (1, 1, *size)
    torch.testing.assert_close(whole, direct, rtol=0, atol=1e-6)
    torch.testing.assert_close(tiles, whole, rtol=0, atol=1e-5)


def test_tiles_of_all_networks_take_as_much_memory():
    """2**24 values of the finest level, whose pixels are `fold` wide."""
    assert (tile_side(16, 2), tile_side(64, 1), tile_side(4, 1)) == (2048, 512, 2048)


def test_a_margin_that_is_too_small_makes_seams():
    shape = SHAPES[1]
    network = random_network(shape).refining
    picture = torch.rand(1, 3, 48, 90, generator=torch.Generator().manual_seed(1))
    with torch.no_grad():
        whole = apply_in_tiles(network, picture, shape.multiple, shape.reach, tile=10**6)
        tiles = apply_in_tiles(network, picture, shape.multiple, shape.multiple, tile=16)
    assert (tiles - whole).abs().max() > 1e-4


def test_the_encoding_for_the_network_is_srgb_and_goes_on_below_black():
    light = torch.linspace(-0.02, 1.2, 400, dtype=torch.float64)
    encoded = encode_screen(light)
    assert (encoded.diff() > 0).all()
    torch.testing.assert_close(decode_screen(encoded), light, rtol=0, atol=1e-6)
    inside = light.clamp(0, 1)
    torch.testing.assert_close(encode_screen(inside), encode_srgb(inside), rtol=0, atol=1e-6)
    assert encode_screen(torch.tensor(-0.01)) == pytest.approx(-0.1292)
    limits = encode_screen(torch.tensor([-0.25, -9.0, 1.5, 9.0]))
    assert limits[0] == limits[1]
    assert limits[2] == limits[3]


@pytest.mark.parametrize("function", [encode_screen, decode_screen])
def test_gradients_of_the_encoding_are_finite_everywhere(function):
    values = torch.tensor([-1.0, -0.1, 0.0, 1e-9, 0.003, 0.5, 1.0, 2.0], dtype=torch.float64)
    values.requires_grad_()
    function(values).sum().backward()
    assert values.grad.isfinite().all()
    assert (values.grad[1:7] > 0).all()


def test_linear_light_is_refined_in_srgb_and_restored_as_light():
    """By hand: the network's correction is added to the sRGB values of the filtered picture."""
    network = random_network(SHAPES[1], light="linear")
    generator = torch.Generator().manual_seed(4)
    capture, filtered = torch.rand(2, 20, 24, generator=generator) * 1.1 - 0.05
    channels = [encode_screen(capture), encode_screen(filtered), torch.full((20, 24), 0.2)]
    padded = torch.nn.functional.pad(torch.stack(channels)[None], (0, 0, 0, 4), mode="replicate")
    wanted = decode_screen(channels[1] + network.refining(padded)[0, 0, :20])
    found = network.restore(capture, 0.01, filtered)
    torch.testing.assert_close(found, wanted, rtol=1e-5, atol=1e-6)


def test_what_each_decoder_is_given():
    front = DecoderSettings(SMALL)
    cases = {
        front: (True, 3),
        replace(front, front="none"): (True, 2),
        replace(front, front="known"): (False, 3),
        replace(front, psf_channel=True): (False, 4),
        replace(front, front="none", psf_channel=True): (False, 3),
        replace(front, front="known", psf_channel=True): (False, 4),
    }
    for settings, (is_blind, inputs) in cases.items():
        assert (settings.is_blind, settings.inputs) == (is_blind, inputs)
        assert UNet(SMALL, inputs).head.in_channels == inputs
        assert DecoderSettings.from_data(settings.as_data()) == settings


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: NetworkShape(channels=0), "channels.* 0"),
        (lambda: NetworkShape(levels=0), "levels.* 0"),
        (lambda: NetworkShape(fold=-1), "fold.* -1"),
        (lambda: NetworkShape(convolutions=0), "convolutions.* 0"),
        (lambda: NetworkShape(convolutions=1), "convolutions is 1; choose 2 or more"),
        (lambda: NetworkShape(dilations=(1, 0)), "dilations.* 0"),
        (lambda: DecoderSettings(front="wiener"), "front is 'wiener'; choose blind, known or none"),
        (lambda: DecoderSettings(light="raw"), "light is 'raw'; choose srgb or linear"),
        (lambda: NetworkShape.from_data({"width": 3}), "isn't the shape of a network.*width"),
        (lambda: DecoderSettings.from_data({}), "isn't the settings of a decoder.*shape"),
        (lambda: DecoderSettings.from_data({"shape": {}, "size": 1}), "settings.*size"),
    ],
)
def test_sizes_and_words_that_can_not_be(make, said):
    with pytest.raises(ValueError, match=said):
        make()
