"""The list of all restoration methods by name; importing it doesn't load torch.

To add a method, write a module with a METHOD (see optics.inverse.method) and add its name
here.
"""

from __future__ import annotations

from typing import NamedTuple


class RestorationEntry(NamedTuple):
    """The entry of a restoration method: its title, its module, and whether reports compare it.

    The module has the method's description in METHOD.
    """

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
"""Restoration methods by the names that commands, files and tables use."""

AUTO = "auto"
"""Name that stands for the method with the largest gain in the given time."""

ALIASES = {"tv": "total-variation"}

METHOD_CHOICES = (AUTO, *RESTORATIONS, *ALIASES)
"""All names that a user may give."""
