"""Choose how frames are weighted by the time that merging them may take."""

from __future__ import annotations

import math
from types import MappingProxyType

from optics.accuracy import MachineSpeed
from optics.hdr.bracket import Bracket
from optics.hdr.weighted_mean import METHODS, Method

_PIXEL_TOUCHES = 32.0
"""Passes over a pixel that any merge takes, in units of `MachineSpeed.touch`. Measured on brackets
of two to eight frames."""

_FRAME_TOUCHES = MappingProxyType({"plain": 3.0, "Poisson": 3.0, "Granados": 4.5, "full": 12.0})
"""Passes for each frame, by method. Measured likewise."""

_CLIPPING_CALLS = 100.0
"""Time to find an exposure's estimate near its clip level, in units of `MachineSpeed.call`; for all
but the shortest, in the method "full". Measured."""


def merge_seconds(bracket: Bracket, method: Method, speed: MachineSpeed) -> float:
    """Predict the processor time that merging takes, seconds.

    Parameters
    ----------
    bracket : Bracket
        Its size and exposures count.
    method : str
        How exposures are weighted.
    speed : MachineSpeed
        Of the machine at hand.
    """
    pixels = math.prod(bracket.shape)
    touches = pixels * (_PIXEL_TOUCHES + _FRAME_TOUCHES[method] * len(bracket.times))
    calls = _CLIPPING_CALLS * (len(bracket.exposures) - 1) if method == "full" else 1.0
    return touches * speed.touch + calls * speed.call


def choose_method(
    bracket: Bracket, budget: float, speed: MachineSpeed | None = None, bands: int = 1
) -> Method:
    """Choose the best way to merge that fits a time.

    Parameters
    ----------
    bracket : Bracket
        To be merged.
    budget : float
        Processor seconds, positive.
    speed : MachineSpeed, optional
        Of the machine at hand; by default that of a server.
    bands : int, default 1
        Number of such brackets that the budget is for.

    Returns
    -------
    str
        The last of `METHODS` that fits.

    Raises
    ------
    ValueError
        For a budget that isn't positive, or in which no method fits; the message names the least
        one that would do.
    """
    if not 0 < budget < math.inf:
        raise ValueError(f"budget is {budget:g} s; give a positive number of seconds")
    speed = speed or MachineSpeed()
    seconds = {one: bands * merge_seconds(bracket, one, speed) for one in METHODS}
    fitting = [one for one in METHODS if seconds[one] <= budget]
    if not fitting:
        least = min(seconds, key=seconds.__getitem__)
        raise ValueError(
            f"budget is {budget:g} s; merging takes {seconds[least]:.2g} s at least, by the method "
            f"{least}"
        )
    return fitting[-1]
