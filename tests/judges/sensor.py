"""Sums over all numbers of electrons and all digital numbers, by scipy.stats."""

import numpy as np
import scipy.stats as st

FEW = 10.0


def judged(mean, sensor, shot, clipping, read, quantised, offset=0.0):
    """Mean and variance of (number - black level) gain, of one pixel."""
    counts, shares = _electrons(mean, shot)
    held = np.minimum(counts, sensor.full_well) if clipping else counts
    held = held + offset
    noise = sensor.read_noise if read else 0.0
    if quantised:
        numbers, weights = _numbers(held, shares, noise, sensor)
        values = np.clip(numbers, 0, 2**sensor.bits - 1) if clipping else numbers
        values = (values - sensor.black_level) * sensor.gain
    else:
        values, weights = _spread(held, shares, noise)
        if clipping:
            low = -sensor.black_level * sensor.gain
            values = np.clip(values, low, low + (2**sensor.bits - 1) * sensor.gain)
    middle = weights @ values
    return middle, weights @ (values - middle) ** 2


def _electrons(mean, shot):
    if shot == "none":
        return np.array([mean]), np.array([1.0])
    counts = np.arange(int(mean + 12 * np.sqrt(mean) + 40), dtype=float)
    if shot in ("Poisson", "skewed") or mean < FEW:
        return counts, st.poisson.pmf(counts, mean)
    spread = mean / np.sqrt(mean + 1 / 12)
    shares = st.norm.cdf(counts + 0.5, mean, spread) - st.norm.cdf(counts - 0.5, mean, spread)
    shares[0] = st.norm.cdf(0.5, mean, spread)
    return counts, shares


def _numbers(held, shares, noise, sensor):
    scaled = held / sensor.gain + sensor.black_level
    if not noise:
        return np.round(scaled), shares
    numbers = np.arange(int(scaled.min()) - 40, int(scaled.max()) + 40, dtype=float)
    upper = st.norm.cdf(numbers + 0.5, scaled[:, None], noise / sensor.gain)
    lower = st.norm.cdf(numbers - 0.5, scaled[:, None], noise / sensor.gain)
    return numbers, shares @ (upper - lower)


def _spread(held, shares, noise):
    if not noise:
        return held, shares
    normal = np.linspace(-9, 9, 3001)
    weights = st.norm.pdf(normal) / st.norm.pdf(normal).sum()
    return (held[:, None] + noise * normal).ravel(), (shares[:, None] * weights).ravel()
