"""The restorations that there are: the one list of them all. Importing it loads nothing.

To add one, write a module with a METHOD (see optics.deconvolution.method), and name it here.
"""

from __future__ import annotations

from typing import NamedTuple


class RestorationEntry(NamedTuple):
    """What a person reads, the module whose METHOD it is, and whether reports compare it."""

    title: str
    module: str
    reported: bool = False


RESTORATIONS: dict[str, RestorationEntry] = {
    "wiener": RestorationEntry("Wiener", "optics.deconvolution.wiener", True),
    "richardson-lucy": RestorationEntry(
        "Richardson-Lucy", "optics.deconvolution.richardson_lucy", True
    ),
    "total-variation": RestorationEntry(
        "total variation", "optics.deconvolution.total_variation", True
    ),
    "poisson-tv": RestorationEntry("Poisson total variation", "optics.deconvolution.poisson", True),
    "hyper-laplacian": RestorationEntry("hyper-Laplacian", "optics.deconvolution.hyper_laplacian"),
    "l-bfgs-b": RestorationEntry("L-BFGS-B", "optics.deconvolution.bounded"),
    "plug-and-play": RestorationEntry("learned denoiser", "optics.deconvolution.plug_and_play"),
}
"""As commands, files and rows of tables call them."""

AUTO = "auto"
"""What serves best in the time."""

ALIASES = {"tv": "total-variation"}

METHOD_CHOICES = (AUTO, *RESTORATIONS, *ALIASES)
"""What a person may ask for."""
