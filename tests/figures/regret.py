"""What a choice cost: the time of the chosen method over that of the fastest which would do."""

from __future__ import annotations

import statistics
from collections.abc import Mapping, Sequence

import numpy as np


def regret(times: Mapping[str, float]) -> float:
    """times: seconds by method, the chosen one first."""
    return next(iter(times.values())) / min(times.values())


def median_and_high(regrets: Sequence[float]) -> tuple[float, float]:
    """The median, and the 95th percentile."""
    return statistics.median(regrets), float(np.quantile(regrets, 0.95))
