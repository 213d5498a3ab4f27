"""Sensors that are read in another way, against frames that are drawn and averaged one by one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from optics.camera import Sensor
from optics.sensor import Mosaic, moments, sample_frame, sensor_as_read

SENSOR = Sensor(shape=(64, 96), dark_current=40.0, full_well=9000.0)


def drawn(electrons: float, sensor: Sensor, count: int, binning: int) -> np.ndarray:
    """Frames of even light, each the mean of `count`, with binned pixels averaged."""
    generator = torch.Generator().manual_seed(3)
    light = torch.full(sensor.shape, electrons, dtype=torch.float64)
    frames = []
    for _ in range(20):
        several = [sample_frame(light, 0.1, sensor, generator).numpy() for _ in range(count)]
        rows, columns = (n // binning for n in sensor.shape)
        mean = np.mean(several, axis=0)[: rows * binning, : columns * binning]
        frames.append(mean.reshape(rows, binning, columns, binning).mean(axis=(1, 3)))
    return np.stack(frames)


@pytest.mark.parametrize(("count", "binning"), [(4, 1), (1, 2), (2, 2)])
@pytest.mark.parametrize("electrons", [5.0, 3000.0])
def test_means_have_the_light_and_noise_that_their_sensor_says(
    count: int, binning: int, electrons: float
) -> None:
    seen = drawn(electrons, SENSOR, count, binning)
    as_read = sensor_as_read(SENSOR, averaged=count, binning=binning)
    assert as_read.shape == seen.shape[1:]
    light = torch.full(as_read.shape, electrons * count * binning**2, dtype=torch.float64)
    electrons_read, variance = (one.mean().item() for one in moments(light, 0.1, as_read))
    mean = as_read.black_level + electrons_read / as_read.gain
    error = seen.std() / np.sqrt(seen.size)
    assert abs(seen.mean() - mean) < 5 * error
    # Of single numbers' rounding, a twelfth, the mean has less than the description says.
    rounding = (1 - 1 / (count * binning**2)) / 12
    assert seen.var() == pytest.approx(
        variance / as_read.gain**2 - rounding, rel=5 * np.sqrt(2 / seen.size)
    )


def test_amplification_raises_the_signal_and_leaves_the_black_level() -> None:
    louder = sensor_as_read(SENSOR, amplification_db=20.0)
    assert louder.gain == pytest.approx(SENSOR.gain / 10)
    assert louder.black_level == SENSOR.black_level
    dark, lit = torch.zeros(64, 96), torch.full((64, 96), 100.0)
    steps = [
        (moments(lit, 1e-3, one)[0] - moments(dark, 1e-3, one)[0]).mean().item() / one.gain
        for one in (SENSOR, louder)
    ]
    assert steps[1] == pytest.approx(10 * steps[0], rel=1e-3)


def test_a_mean_clips_where_a_single_number_does() -> None:
    for sensor in (SENSOR, replace(SENSOR, gain=0.5)):
        assert sensor_as_read(sensor, averaged=16, binning=2).full_scale == sensor.full_scale


def test_a_region_keeps_the_pixels_and_nothing_else_changes() -> None:
    part = sensor_as_read(SENSOR, region=(10, 4, 20, 30))
    assert part == replace(SENSOR, shape=(30, 20))


@pytest.mark.parametrize(
    ("asked", "word"),
    [
        ({"region": (90, 0, 7, 4)}, "region"),
        ({"region": (0, -1, 7, 4)}, "region"),
        ({"region": (0, 0, 3, 3), "binning": 4}, "region"),
        ({"binning": 0}, "binning"),
        ({"averaged": 0}, "averaged"),
        ({"amplification_db": "loud"}, "amplification_db"),
    ],
)
def test_what_the_sensor_does_not_have_is_refused_by_name(asked: dict, word: str) -> None:
    with pytest.raises((ValueError, TypeError), match=word):
        sensor_as_read(SENSOR, **asked)


def test_a_mosaic_is_never_binned_or_shifted() -> None:
    curves = dict.fromkeys("RGB", 0.5)
    mosaic = replace(SENSOR, colour=Mosaic(("RG", "GB"), curves))
    for asked in ({"binning": 2}, {"region": (1, 0, 8, 8)}, {"region": (0, 3, 8, 8)}):
        with pytest.raises(ValueError, match="mosaic"):
            sensor_as_read(mosaic, **asked)
    assert sensor_as_read(mosaic, region=(2, 4, 8, 8)).shape == (8, 8)
