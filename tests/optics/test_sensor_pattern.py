"""Colour filters, fixed patterns, shutters and draws of chosen stages."""

import gc
import math
import weakref
from dataclasses import replace

import numpy as np
import pytest
import scipy.stats as st
import torch

from optics.camera import Sensor
from optics.light import Spectrum
from optics.sensor import Mosaic, fixed_pattern, row_starts, sample_frame
from optics.sensor.frame_sampling import electrons_from_normal
from optics.sensor.readout import frame_duration

SENSOR = Sensor(shape=(300, 400), prnu=0.01, dsnu=2.0, dead=0.002, hot=0.004, hot_current=500.0,
                fixed_seed=5)  # fmt: skip
EVEN = Spectrum.flat(0.5)
BAYER = Mosaic(("RG", "GB"), {"R": EVEN, "G": EVEN.with_scale(0.5), "B": EVEN})


def test_maps_have_the_spreads_and_shares_that_were_given():
    """Within five standard errors of 120,000 pixels."""
    maps = fixed_pattern(SENSOR)
    good = maps.response[maps.response > 0]
    error = 1 / math.sqrt(2 * 120_000)
    assert float(good.std()) == pytest.approx(0.01, rel=5 * error)
    assert float(good.mean()) == pytest.approx(1.0, abs=5 * 0.01 / math.sqrt(120_000))
    assert float(maps.offset.std()) == pytest.approx(2.0, rel=5 * error + 0.001)
    assert int((maps.response == 0).sum()) == pytest.approx(240, abs=5 * math.sqrt(240))
    assert int((maps.hot_current == 500).sum()) == pytest.approx(480, abs=5 * math.sqrt(480))
    assert not bool(((maps.response == 0) & (maps.hot_current > 0)).any())


def test_maps_belong_to_the_camera():
    again = fixed_pattern(replace(SENSOR, gain=3.0))
    assert torch.equal(again.response, fixed_pattern(SENSOR).response)
    assert not torch.equal(again.response, fixed_pattern(replace(SENSOR, fixed_seed=6)).response)


def test_maps_last_as_long_as_their_sensor():
    sensor = replace(SENSOR, fixed_seed=7)
    kept = weakref.ref(fixed_pattern(sensor))
    assert fixed_pattern(replace(sensor)) is kept()
    del sensor
    gc.collect()
    assert kept() is None


def test_hot_and_dead_pixels_stay_where_they_are_in_all_frames():
    quiet = {"read_noise": False, "shot": "none"}
    frames = [
        sample_frame(torch.full(SENSOR.shape, 300.0), 10.0, SENSOR,
                     torch.Generator().manual_seed(n), **quiet)
        for n in (1, 2)
    ]  # fmt: skip
    assert torch.equal(*frames)
    maps = fixed_pattern(SENSOR)
    electrons = (frames[0] - 64) * 2.6
    # 500 e-/s over 10 s and 10 of dark current; steps of 2.6 and offsets of 9 at most.
    assert float((electrons[maps.hot_current > 0] - 5310).abs().max()) < 5 * 0.01 * 300 + 11
    assert float((electrons[maps.response == 0] - 10).abs().max()) < 11


def test_an_even_sensor_draws_the_same_pixels_whatever_their_shape():
    frame = sample_frame(torch.full((10,), 50.0), 1.0, Sensor(), torch.Generator().manual_seed(0))
    assert frame.shape == (10,)
    assert frame.dtype == torch.int32


def test_numbers_are_whole_only_if_they_are_rounded():
    frame = sample_frame(torch.tensor([10.0]), 1.0, Sensor(dark_current=0.0), torch.Generator(),
                 shot="none", read_noise=False, quantisation=False)  # fmt: skip
    assert frame.dtype == torch.float64
    assert float(frame) == 64 + 10 / 2.6


def test_nothing_clips_where_clipping_is_off():
    frame = sample_frame(torch.tensor([1e6]), 1.0, Sensor(dark_current=0.0), torch.Generator(),
                         shot="none", read_noise=False, clipping=False)  # fmt: skip
    assert int(frame) == round(64 + 1e6 / 2.6)


def test_numbers_end_where_well_and_converter_do():
    """A well of 1000 electrons reads 64 + 500, and a deeper one 4095; below 0 there is nothing,
    however far noise and offsets reach: half of a dark frame is 0."""
    sensor = Sensor(shape=(100, 100), bits=12, gain=2.0, full_well=1000.0, dark_current=0.0,
                    read_noise=20.0, black_level=64.0)  # fmt: skip
    bright, dark = torch.full(sensor.shape, 1e6), torch.zeros(sensor.shape)

    def frame(light, sensor, read_noise=True):
        generator = torch.Generator().manual_seed(1)
        return sample_frame(light, 1.0, sensor, generator, read_noise=read_noise)

    assert (frame(bright, sensor, False) == 64 + 500).all()
    deep = replace(sensor, full_well=1e5)
    assert (frame(bright, deep) == 4095).all()
    nothing = frame(dark, replace(sensor, black_level=0.0, dsnu=10.0))
    assert nothing.min() == 0
    # What rounds to 0 as well: a step of 2 electrons under a normal curve of 22.
    assert float((nothing == 0).float().mean()) == pytest.approx(0.52, abs=0.02)


def test_a_frame_without_noise_is_the_rounded_mean():
    """round(electrons / gain + black level), written out; with what each pixel reads too much."""
    sensor = Sensor(shape=(1, 5), gain=2.5, black_level=100.0, dark_current=500.0)
    light = torch.tensor([[0.0, 1.0, 2.4, 3.8, 5000.0]])

    def quiet(sensor):
        return sample_frame(light, 1.0, sensor, torch.Generator(), shot="none", read_noise=False,
                    dark_current=False)  # fmt: skip

    assert quiet(sensor).tolist() == [[100, 100, 101, 102, 2100]]
    uneven = replace(sensor, dsnu=50.0, fixed_seed=2)
    pattern = fixed_pattern(uneven)
    too_much = torch.round(
        light / 2.5 + pattern.offset_steps * pattern.electrons_per_step / 2.5 + 100
    )
    assert torch.equal(quiet(uneven), too_much.to(torch.int32))
    assert bool((pattern.offset_steps < 0).any() and (pattern.offset_steps > 0).any())


@pytest.mark.parametrize("shot", ["Poisson", "skewed", "Gaussian"])
def test_dim_pixels_beside_bright_ones_are_drawn_as_poissons(shot):
    """exp(-0.3) of them hold nothing; of a normal distribution, 0.64 would."""
    sensor = Sensor(shape=(2, 20_000), gain=1.0, black_level=0.0, dark_current=0.0, full_well=1e4)
    light = torch.tensor([[0.3], [400.0]]).expand(sensor.shape)

    def drawn(seed):
        generator = torch.Generator().manual_seed(seed)
        return sample_frame(light, 1.0, sensor, generator, shot=shot, read_noise=False)

    dim, bright = drawn(1).double()
    assert float((dim == 0).double().mean()) == pytest.approx(math.exp(-0.3), abs=0.02)
    assert float(bright.var() / bright.mean()) == pytest.approx(1, abs=0.05)
    assert torch.equal(drawn(1), drawn(1))
    assert not torch.equal(drawn(1), drawn(2))


@pytest.mark.parametrize("shot", ["Poisson", "skewed", "Gaussian"])
@pytest.mark.parametrize("electrons", [3.0, 40.0])
def test_electrons_come_as_poissons_or_nearly_so(shot, electrons):
    """Kolmogorov's distance from scipy's distribution; 0.0665 / sqrt(electrons) of the normal."""
    sensor = Sensor(gain=1.0, black_level=0.0, dark_current=0.0)
    numbers = sample_frame(torch.full((200_000,), electrons), 1.0, sensor,
                           torch.Generator().manual_seed(3), shot=shot,
                           read_noise=False)  # fmt: skip
    counts = torch.bincount(numbers, minlength=100) / 200_000
    distance = abs(counts.cumsum(0).numpy() - st.poisson.cdf(range(len(counts)), electrons)).max()
    normal = 0.0665 / math.sqrt(electrons) if shot == "Gaussian" and electrons > 10 else 0.0
    assert distance < normal + 2 / math.sqrt(200_000)
    if normal:
        assert distance > normal / 2


@pytest.mark.parametrize(
    ("mean", "apart"), [(10.0, 3e-4), (20.0, 1e-4), (60.0, 2e-5), (300.0, 2e-6), (6000.0, 1e-7)]
)
def test_skewed_numbers_are_poissons_without_any_chance(mean, apart):
    """Of two million normal quantiles, one after the other: scipy's distribution, and its mean
    and variance."""
    steps = 2_000_000
    noise = torch.from_numpy(st.norm.ppf((np.arange(steps) + 0.5) / steps))
    counts = electrons_from_normal(torch.full((steps,), mean, dtype=torch.float64), noise, "skewed")
    shares = torch.bincount(counts.long()).double() / steps
    k = torch.arange(len(shares)).double()
    distance = abs(shares.cumsum(0).numpy() - st.poisson.cdf(k.numpy(), mean)).max()
    assert distance < apart + 1 / steps
    middle = float(shares @ k)
    assert middle == pytest.approx(mean, abs=1e-4)
    assert float(shares @ (k - middle) ** 2) == pytest.approx(mean, abs=2e-3 + 2e-5 * mean)


def test_a_mosaic_repeats_from_the_first_pixel():
    assert BAYER.channels == ("R", "G", "B")
    assert BAYER.channel_map((3, 5)).tolist() == [
        [0, 1, 0, 1, 0], [1, 2, 1, 2, 1], [0, 1, 0, 1, 0]
    ]  # fmt: skip


def test_a_mosaic_takes_each_pixel_from_its_channel():
    channels = torch.stack([torch.full((2, 2), value) for value in (1.0, 2.0, 3.0)])
    assert BAYER.sample_channels(channels).tolist() == [[1, 2], [2, 3]]
    with pytest.raises(ValueError, match=r"channels is \(2, 4, 4\); it must be 3 pictures, of R"):
        BAYER.sample_channels(torch.ones(2, 4, 4))


def test_mosaics_are_equal_by_what_they_hold():
    same = Mosaic(("RG", "GB"), {"B": EVEN, "G": EVEN.with_scale(0.5), "R": EVEN})
    assert same == BAYER
    assert hash(replace(SENSOR, colour=same)) == hash(replace(SENSOR, colour=BAYER))
    assert Mosaic(("RG", "GB"), {"R": EVEN, "G": EVEN, "B": EVEN}) != BAYER


@pytest.mark.parametrize(
    ("pattern", "message"),
    [
        ((), "pattern is ()"), (("RG", "G"), "as long"), (("RG", "GW"), "pattern has W, which"),
    ],
)  # fmt: skip
def test_patterns_without_sense_are_refused(pattern, message):
    with pytest.raises(ValueError, match=message):
        Mosaic(pattern, {"R": EVEN, "G": EVEN})


def test_rows_start_one_after_the_other():
    rolling = Sensor(shape=(4, 4), shutter="rolling", line_time=1e-5)
    assert row_starts(rolling, 2.0).tolist() == pytest.approx([2.0, 2.00001, 2.00002, 2.00003])
    assert row_starts(rolling, 2.0, rolling=False).tolist() == [2.0] * 4
    assert row_starts(Sensor(shape=(3, 4))).tolist() == [0.0] * 3
    assert frame_duration(rolling, 0.01) == pytest.approx(0.01003)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"prnu": -0.1}, "prnu is -0.1; it can't be negative"),
        ({"prnu": 0.3}, "prnu is 0.3; it is a share of the response, 0.2 at most"),
        ({"dsnu": math.nan}, "dsnu is nan; it can't be negative"),
        ({"dead": 1.5}, "dead is 1.5; it is a share and must lie between 0 and 1"),
        ({"dead": 0.6, "hot": 0.6}, "dead is 0.6 and hot 0.6; no more than all pixels"),
        ({"hot_current": -1.0}, "hot_current is -1; it can't be negative"),
        ({"shutter": "slow"}, "shutter is 'slow'; choose global or rolling"),
        ({"shutter": "rolling"}, "a rolling shutter needs its line_time, more than 0 s"),
    ],
)
def test_sensors_that_cant_be_are_refused(change, message):
    with pytest.raises(ValueError, match=message):
        Sensor(**change)
