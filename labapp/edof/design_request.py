"""The request for a pattern that extends the depth of field, from the command line."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

from labapp.common.errors import UserError

STARTS = ("rings", "sweep", "lattice", "cubic", "flat")
"""Patterns from which a design may start, by name."""

PARAMETRISATION_NAMES = ("quarter", "radial", "free", "separable", "separable-mirrored")
"""Ways to describe the pattern that is designed."""


@dataclass(frozen=True)
class EdofRequest:
    """The options of `labapp design edof` that decide the pattern.

    Attributes
    ----------
    bench : Path or None
        The bench file; None for the bundled one.
    wavelengths : tuple of float
        Metres; of several, the pattern suits all, and is shown for the first one.
    near, far : float
        Nearest and farthest depth, dioptres from the panel; 0 is infinity.
    noise : float
        Standard deviation of a pixel's noise, where white is 1.
    decoder : {"blind", "known"}
        Whether one filter restores all depths, or the depth is known.
    pictures : Path or None
        Folder of photographs whose power spectrum is designed for; None for natural photographs.
    start : str
        One of STARTS, or a design file.
    parametrisation : str
        One of PARAMETRISATION_NAMES.
    size : int
        Pixels along a side of the periodic pictures.
    orders : int
        Whole waves of the panel's range that the pattern uses.
    seed : int
        Of all random numbers.
    binning : int, optional
        Sensor pixels along a side of the squares that are averaged into a pixel of the pictures.

    Raises
    ------
    UserError
        For options that are wrong.
    """

    bench: Path | None
    wavelengths: tuple[float, ...]
    near: float
    far: float
    noise: float
    decoder: Literal["blind", "known"]
    pictures: Path | None
    start: str
    parametrisation: str
    size: int
    orders: int
    seed: int
    binning: int = 1

    def __post_init__(self) -> None:
        if not 0 <= self.far < self.near < math.inf:
            raise UserError(
                f"--near-dioptre {self.near:g} --far-dioptre {self.far:g}: near must be more than "
                "far, and far 0 (infinity) or more. Give dioptres, 1 over metres."
            )
        if not 0 < self.noise < 1:
            raise UserError(
                f"--noise {self.noise:g}: give the standard deviation of a pixel's noise, where "
                "white is 1: between 0 and 1, such as 0.008."
            )
        if self.decoder not in ("blind", "known"):
            raise UserError(f"--decoder {self.decoder}: choose blind or known.")
        if self.parametrisation not in PARAMETRISATION_NAMES:
            raise UserError(
                f"--parameters {self.parametrisation}: choose {', '.join(PARAMETRISATION_NAMES)}."
            )
        if self.start not in STARTS and not Path(self.start).is_file():
            raise UserError(
                f"--start {self.start}: there is no such file. Choose {', '.join(STARTS)}, or give "
                "a design file (.h5)."
            )
        if self.size % 2:
            raise UserError(f"--size {self.size}: give an even number of pixels.")
        if not self.wavelengths or any(not 0 < one < math.inf for one in self.wavelengths):
            raise UserError("--wavelength-nm: give one wavelength or more, in nanometres.")

    def as_data(self) -> dict[str, Any]:
        """Return the options as plain data, for the design file and to compare with a state's."""
        data = asdict(self)
        paths = {
            name: None if data[name] is None else str(data[name]) for name in ("bench", "pictures")
        }
        return {**data, **paths, "wavelengths": list(self.wavelengths)}
