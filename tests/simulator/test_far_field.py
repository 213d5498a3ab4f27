"""What is known of a field's far light, against direct sums and closed forms."""

import numpy as np
import pytest
import torch

from simulator.probing.far_field import FarField


def direct(field, y, x):
    """|sum of field exp(-2πi (u y / 2R + v x / 2C))|² over all light, by definition."""
    rows, columns = field.shape
    down = np.exp(-2j * np.pi * np.outer(y, np.arange(rows)) / (2 * rows))
    along = np.exp(-2j * np.pi * np.outer(x, np.arange(columns)) / (2 * columns))
    return np.abs(down @ field.numpy() @ along.T) ** 2


def random_field(seed, rows=24, columns=36):
    rng = np.random.default_rng(seed)
    phase = rng.uniform(0, 2 * np.pi, (rows, columns))
    return torch.from_numpy(np.exp(1j * phase).astype(np.complex64))


def tilted(dy, dx, rows=24, columns=36):
    v, u = np.mgrid[:rows, :columns]
    turn = np.pi * (dy * v / rows + dx * u / columns)
    return torch.from_numpy(np.exp(1j * turn).astype(np.complex64))


@pytest.mark.parametrize("aside", [(0.0, 0.0), (0.5, 0.5), (0.3, -0.4), (7.5, -3.2)])
def test_the_brightest_place_of_a_spot_may_lie_between_samples(aside):
    """Of even light that is tilted all adds up in phase there: (number of pixels)² of it."""
    field = tilted(*aside)
    count = field.numel()
    peak = FarField(field, 1.0).peak
    # Parseval: all samples of the far field add up to 4 count times the field's own light.
    assert peak == pytest.approx(4 * count * count**2 / (4 * count * count), rel=0.02)


@pytest.mark.parametrize("seed", range(4))
def test_no_speckle_is_brighter_than_is_told(seed):
    field = random_field(seed)
    far = FarField(field, 1.0)
    y, x = (np.arange(0, 2 * n, 0.25) for n in field.shape)
    light = direct(field, y, x)
    whole = direct(field, np.arange(48), np.arange(72)).sum()
    assert far.peak >= 0.98 * light.max() / whole * far.light.size
    assert far.peak <= 1.3 * light.max() / whole * far.light.size


def test_shares_of_squares_and_their_energy_are_sums_of_samples():
    field = random_field(7)
    far = FarField(field, 0.9)
    place = [np.abs(np.fft.fftfreq(n)) for n in far.light.shape]
    envelope = [0.9 * np.sinc(0.9 * one) ** 2 for one in place]
    light = far.light * envelope[0][:, None] * envelope[1]
    away = np.maximum(place[0][:, None], place[1]) * 48
    steps = np.ceil(away - 1e-9)
    for k in (0, 3, 11, 20):
        assert far.ensquared_share[k] == pytest.approx(
            light[steps <= k].sum() / light.sum(), rel=1e-4
        )
        energy = (light[steps > k].astype(float) ** 2).sum() * light.size
        assert far.beyond_energy[k] == pytest.approx(energy, rel=1e-4)
    assert far.energy == pytest.approx((light.astype(float) ** 2).sum() * light.size, rel=1e-5)
    assert far.order_share(0) == pytest.approx(light.sum(), rel=1e-5)


@pytest.mark.parametrize("samples_per_spot", [1.5, 2])
def test_the_light_around_the_axis_is_that_of_the_pixels_by_a_plain_sum(samples_per_spot):
    """Two and a half periods, at every sample, of square pixels that are open over 0.9."""
    rng = np.random.default_rng(5)
    field = rng.normal(size=(5, 6)) + 1j * rng.normal(size=(5, 6))
    far = FarField(torch.from_numpy(field).to(torch.complex64), 0.9, samples_per_spot)
    reach = tuple(5 * n // 4 for n in far.light.shape)
    found = far.light_around_axis(reach)
    y, x = (np.arange(-most, most) / n for most, n in zip(reach, far.light.shape, strict=True))
    waves = [np.exp(-2j * np.pi * np.outer(u, np.arange(n))) for u, n in ((y, 5), (x, 6))]
    envelope = np.outer(0.9 * np.sinc(0.9 * y) ** 2, 0.9 * np.sinc(0.9 * x) ** 2)
    wanted = abs(waves[0] @ field @ waves[1].T) ** 2 * envelope
    # All light of one period, without the envelope, adds up to 1.
    wanted /= (abs(field) ** 2).sum() * far.light.size
    np.testing.assert_allclose(found, wanted, atol=1e-6 * wanted.max())


def test_most_orders_hold_nearly_all_light():
    """A pixel's own pattern sums up to all light over all orders."""
    far = FarField(random_field(3), 0.9)
    shares = [far.order_share(k) for k in (0, 1, 2, 40)]
    assert shares == sorted(shares)
    assert shares[-1] == pytest.approx(1.0, abs=0.01)


def test_a_transfer_function_is_the_fields_autocorrelation():
    field = tilted(0.0, 0.0)
    far = FarField(field, 1e-3)
    triangle = np.clip(1 - np.arange(24) / 24, 0, 1)
    along = np.clip(1 - np.arange(24) / 36, 0, 1)
    found = np.abs(far.transfer[:24]) / abs(far.transfer[0, 0])
    assert found == pytest.approx(triangle[:, None] * along, abs=1e-4)


def test_a_dark_field_has_no_far_light():
    with pytest.raises(ValueError, match="no light passes the stop"):
        FarField(torch.zeros(8, 8, dtype=torch.complex64), 1.0)
