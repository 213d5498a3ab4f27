"""All methods by name; importing the list doesn't load torch.

To add a method, write a module with a METHOD (see optics.inverse.method) and add its name here.
"""

from __future__ import annotations

from typing import NamedTuple


class RestorationEntry(NamedTuple):
    """A method's title, its module with METHOD, and whether reports compare it."""

    title: str
    module: str
    reported: bool = False


RESTORATIONS: dict[str, RestorationEntry] = {
    "wiener": RestorationEntry("Wiener", "optics.inverse.wiener", True),
    "richardson-lucy": RestorationEntry("Richardson-Lucy", "optics.inverse.richardson_lucy", True),
    "total-variation": RestorationEntry("total variation", "optics.inverse.total_variation", True),
    "poisson-tv": RestorationEntry("Poisson total variation", "optics.inverse.poisson", True),
    "hyper-laplacian": RestorationEntry("hyper-Laplacian", "optics.inverse.hyper_laplacian"),
    "l-bfgs-b": RestorationEntry("L-BFGS-B", "optics.inverse.bounded"),
    "plug-and-play": RestorationEntry("learned denoiser", "optics.inverse.plug_and_play"),
}
"""Methods by the names that commands, files and tables use."""

AUTO = "auto"
"""Name that stands for the method with the largest gain in the given time."""

ALIASES = {"tv": "total-variation"}

METHOD_CHOICES = (AUTO, *RESTORATIONS, *ALIASES)
"""All names that a user may give."""
