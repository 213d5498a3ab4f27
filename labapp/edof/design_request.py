"""What a pattern that extends the depth of field is requested to be, from the command line."""

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

PIXEL_PARAMETRISATIONS = ("quarter", "free")
"""Those by pixels, which can show a phase that is wrapped: others can't know of fringing."""

_LARGEST_RESPONSE_ERROR = 0.5
"""Chosen: a panel whose response is off by more is to be measured, not to be designed for."""


@dataclass(frozen=True)
class EdofRequest:
    """The options of `labapp design edof` that decide the pattern; UserError for wrong ones.

    bench: the bench file; None for the bundled one.
    wavelengths: metres; of several, the pattern suits all, and is shown for the first one.
    near, far: nearest and farthest depth, dioptres from the panel; 0 is infinity.
    noise: standard deviation of a pixel's noise, where white is 1.
    decoder: whether one filter restores all depths ("blind"), or the depth is known ("known").
    pictures: folder of photographs whose power spectrum is designed for; None for natural ones.
    start: one of STARTS, or a design file.
    parametrisation: one of PARAMETRISATION_NAMES.
    size: pixels along a side of the periodic pictures.
    orders: whole waves of the panel's range that the pattern uses.
    seed: of all random numbers.
    binning: sensor pixels along a side of the squares that are averaged into a pixel of the
        pictures.
    fringing: standard deviation in metres by which fringing fields blur the panel's phase, which
        the pattern shall stand; None for the bench's own where the pattern is described by pixels.
    response_error: relative error of the panel's response, to both sides, which the pattern shall
        stand; 0 to .5.
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
    fringing: float | None = None
    response_error: float = 0.0

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
        if self.fringing is not None and not 0 <= self.fringing < math.inf:
            raise UserError(
                f"--fringing-um {1e6 * self.fringing:g}: give micrometres, 0 or more, such as 4.8."
            )
        if not 0 <= self.response_error <= _LARGEST_RESPONSE_ERROR:
            raise UserError(
                f"--response-error {self.response_error:g}: give a share of the response, 0 to "
                f"{_LARGEST_RESPONSE_ERROR:g}, such as 0.05."
            )
        if (self.fringing or self.response_error) and (
            self.parametrisation not in PIXEL_PARAMETRISATIONS
        ):
            raise UserError(
                f"--parameters {self.parametrisation}: can't stand fringing or an error of the "
                f"response; choose {' or '.join(PIXEL_PARAMETRISATIONS)}, or leave out "
                "--fringing-um and --response-error."
            )
        if self.size % 2:
            raise UserError(f"--size {self.size}: give an even number of pixels.")
        if not self.wavelengths or any(not 0 < one < math.inf for one in self.wavelengths):
            raise UserError("--wavelength-nm: give one wavelength or more, in nanometres.")

    def as_data(self) -> dict[str, Any]:
        """Return the options as plain data, for the design file and to compare with a state's."""
        paths = {"bench": self.bench, "pictures": self.pictures}
        told = {name: None if path is None else str(path) for name, path in paths.items()}
        return {**asdict(self), **told, "wavelengths": list(self.wavelengths)}
