"""A row of `labapp accuracy hdr`: what a merge of an exposure bracket reached, and its time."""

from __future__ import annotations

from dataclasses import dataclass

from labapp.accuracy.work_precision import Row

ERROR_NAME = "error of the light, relative"


@dataclass(frozen=True)
class MergeRow(Row):
    """Measured error and time of a merge.

    error_achieved: root mean square of relative errors over all levels of light.
    error_predicted: the same as the merge states it.
    frames: number of exposures.
    exposure_s: sum of the exposure times, seconds.
    efficiency, least_efficiency: least variance of any unbiased estimate (Cramér and Rao) over the
    mean squared error: of the sums over all levels, and at the level where it's least.
    bias: largest mean relative error of a level that isn't chance; 0 if all may be.
    """

    frames: int = 0
    exposure_s: float = 0.0
    efficiency: float | None = None
    least_efficiency: float | None = None
    bias: float | None = None
