import numpy as np
import pytest
from scipy.integrate import solve_ivp

from optics.light import Waveform

SHAPES = [
    Waveform(),
    Waveform("sine", 100.0, 0.3, 0.7),
    Waveform("square", 120.0, 0.8, -2.0),
    Waveform("square", 1000.0, 1.0, 0.1, duty=0.2),
    Waveform("filament", 100.0, 0.04, 1.0),
]


@pytest.mark.parametrize("wave", SHAPES)
def test_the_mean_is_that_of_very_many_instants(wave):
    rng = np.random.default_rng(4)
    start = rng.uniform(-0.1, 0.1, 20)
    length = 10 ** rng.uniform(-5, -1, 20)
    instants = (np.arange(200_000) + 0.5) / 200_000
    expected = [wave.at(s + n * instants).mean() for s, n in zip(start, length, strict=True)]
    assert wave.mean(start, start + length) == pytest.approx(expected, abs=1e-3)


@pytest.mark.parametrize("wave", SHAPES)
def test_a_period_has_a_mean_of_one_wherever_it_begins(wave):
    start = np.linspace(-1, 1, 57)
    assert wave.mean(start, start + wave.period) == pytest.approx(1, abs=1e-9)


@pytest.mark.parametrize("wave", SHAPES)
def test_the_ripple_is_the_largest_deviation(wave):
    times = np.linspace(0, wave.period, 100_001)
    assert np.abs(wave.at(times) - 1).max() == pytest.approx(wave.ripple, abs=1e-6)


def test_no_time_at_all_has_the_value_at_that_time():
    for wave in SHAPES:
        assert wave.mean(0.0123, 0.0123) == pytest.approx(wave.at(0.0123))


def test_windows_of_rows_broadcast():
    wave = SHAPES[1]
    rows = np.arange(5) * 1e-3
    cells = np.array([[0.0], [1e-2]])
    assert wave.mean(cells + rows, cells + rows + 5e-3).shape == (2, 5)


def test_a_filament_follows_from_heat_balance():
    """A heat store fed by sin² of a 50 Hz mains and cooling in 0.25 s, by integration: its ripple
    is sinusoidal, lags a quarter period behind the heating, and is 1/(2π f τ) of its ripple."""
    tau, f = 0.25, 100.0
    times = 30 * tau + np.linspace(0, 2 / f, 101)
    solution = solve_ivp(
        lambda t, heat: (1 - np.cos(2 * np.pi * f * t) - heat) / tau, (0, times[-1]), [1.0],
        t_eval=times, rtol=1e-9, atol=1e-12, max_step=1e-3,
    )  # fmt: skip
    wave = Waveform("filament", f, 1 / (2 * np.pi * f * tau))
    assert solution.y[0] == pytest.approx(wave.at(times), abs=0.01 * wave.depth)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Waveform("round"), "shape is 'round'; choose"),
        (lambda: Waveform("sine", 0.0), "frequency is 0 Hz"),
        (lambda: Waveform("sine", 100.0, 1.5), "depth is 1.5"),
        (lambda: Waveform("sine", 100.0, float("nan")), "depth is nan"),
        (lambda: Waveform("sine", 100.0, 0.5, float("inf")), "phase is inf"),
        (lambda: Waveform("square", 100.0, 0.5, duty=1.0), "duty is 1"),
        (lambda: SHAPES[1].mean(1.0, 0.9), "ends before it starts"),
        (lambda: SHAPES[1].mean(0.0, float("inf")), "finite times"),
    ],
)
def test_a_waveform_that_cannot_be_is_refused(make, words):
    with pytest.raises(ValueError, match=words):
        make()
