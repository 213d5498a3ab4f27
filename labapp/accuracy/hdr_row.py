"""A row of `labapp accuracy hdr`: what a merge of an exposure bracket reached, and its time."""

from __future__ import annotations

from dataclasses import dataclass

from labapp.accuracy.work_precision import Row

ERROR_NAME = "error of the light, relative"


@dataclass(frozen=True)
class MergeRow(Row):
    """Measured error and time of a merge.

    Attributes
    ----------
    error_achieved, error_predicted : float or None
        Root mean square of relative errors over all levels of light, and what the merge states.
    frames : int
        Number of exposures.
    exposure_s : float
        Sum of the exposure times, seconds.
    efficiency, least_efficiency : float or None
        Least variance of any unbiased estimate (Cramér and Rao) over the mean squared error: of
        the sums over all levels, and at the level where it's least.
    bias : float or None
        Largest mean relative error of a level that isn't chance; 0 if all may be.
    """

    frames: int = 0
    exposure_s: float = 0.0
    efficiency: float | None = None
    least_efficiency: float | None = None
    bias: float | None = None
