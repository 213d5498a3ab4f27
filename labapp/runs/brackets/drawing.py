"""Draw the signal-to-noise ratio of exposure brackets over the range of a scene's rates."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from optics.hdr import ChosenBracket

_LOOK = {"chosen": ("#c0392b", 2.2), "x2": ("#2c7fb8", 1.2), "x4": ("#41ab5d", 1.2)}
"""Colour and width of a bracket's line; the ladder that isn't named is grey."""


def draw_brackets(
    brackets: Mapping[str, ChosenBracket], rates: NDArray[np.float64], wanted_db: float
) -> Figure:
    """Draw the chosen bracket with ladders that reach the same.

    rates: electrons/s.
    """
    figure = Figure(figsize=(8, 4.5), dpi=120, layout="constrained")
    axes = figure.subplots()
    for name, bracket in brackets.items():
        colour, width = _LOOK.get(name, ("#888888", 1.2))
        label = f"{name}: {bracket.frames} frames"
        axes.plot(rates, bracket.snr_db(rates), color=colour, lw=width, label=label)
    axes.axhline(wanted_db, color="black", lw=1, ls="--", label=f"wanted: {wanted_db:g} dB")
    axes.set_xscale("log")
    axes.set_xlabel("rate in electrons/s")
    axes.set_ylabel("signal-to-noise ratio in dB")
    axes.grid(alpha=0.3)
    axes.legend(loc="upper left", fontsize=9)
    return figure
