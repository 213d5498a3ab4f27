"""Dim, defocused copies of the picture, by reflection between two surfaces of a lens."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from optics.validation import require_share

# Range of a ghost's size over the picture's. Chosen: beyond it, it's a dot or an even veil.
_SMALLEST, _LARGEST = 1e-3, 1e3


@dataclass(frozen=True)
class Ghost:
    """One ghost of a lens, to paraxial order.

    Light that two surfaces reflect once each goes through the lens a second time with another ray
    matrix. A point at image height r then makes a disc around the height `magnification` times r:
    the stop's image, out of focus.

    Parameters
    ----------
    share : float
        Share of the light, 0 to 1, that falls on the sensor as this ghost instead of the picture.
    magnification : float
        Size of the ghost over that of the picture, negative if the ghost is turned by 180°.
    blur_diameter : float, optional
        Diameter in metres of the evenly lit disc that a point becomes on the sensor; 0 is sharp.

    Raises
    ------
    ValueError
        If the share is outside 0 to 1, the magnification outside 0.001 to 1000 of either sign, or
        the diameter negative or infinite.

    References
    ----------
    Hullin, Eisemann, Seidel and Lee 2011, doi 10.1145/2010324.1965003; Lee and Eisemann 2013,
    Practical real-time lens-flare rendering (the paraxial ray matrix of each ghost).

    Examples
    --------
    >>> round(Ghost(0.002, -0.8, 1e-3).brightness, 6)
    0.003125
    """

    share: float
    magnification: float
    blur_diameter: float = 0.0

    def __post_init__(self) -> None:
        require_share("share", self.share)
        if not _SMALLEST <= abs(self.magnification) <= _LARGEST:
            raise ValueError(
                f"magnification is {self.magnification:g}; give the ghost's size over that of the "
                f"picture, {_SMALLEST:g} to {_LARGEST:g}, negative if it is turned"
            )
        if not 0 <= self.blur_diameter < math.inf:
            raise ValueError(
                f"blur_diameter is {self.blur_diameter:g} m; give the disc of a point in metres, "
                "0 or more"
            )

    @property
    def brightness(self) -> float:
        """Light on a pixel over the picture's, where the object is even and wide."""
        return self.share / self.magnification**2


def total_share(ghosts: Sequence[Ghost]) -> float:
    """Return the share of the light that all ghosts take from the picture."""
    return sum(one.share for one in ghosts)


def require_ghosts(ghosts: Sequence[Ghost]) -> None:
    """Raise ValueError if ghosts have more than all of the light."""
    total = total_share(ghosts)
    if total > 1:
        raise ValueError(
            f"ghosts have {total:g} of the light together; the picture and they share all of it: "
            "give shares that add up to 1 at most"
        )


def ghost_field(ghosts: Sequence[Ghost], half: Sequence[float]) -> tuple[float, float]:
    """Return from how far beside the frame ghosts bring light into it, (y, x) metres.

    half: half the sides of the frame, (y, x) metres.
    """
    beside = [0.0, 0.0]
    for one in ghosts:
        field = [(side + one.blur_diameter / 2) / abs(one.magnification) for side in half]
        beside = [max(a, b - c) for a, b, c in zip(beside, field, half, strict=True)]
    return beside[0], beside[1]
