"""The restorations that there are: the one list of them all. Importing it loads nothing.

To add one, write a module with a METHOD (see optics.deconvolution.method), and name it here.
"""

from __future__ import annotations

from typing import NamedTuple


class Named(NamedTuple):
    """What a person reads, the module whose METHOD it is, and whether reports compare it."""

    title: str
    module: str
    reported: bool = False


RESTORATIONS: dict[str, Named] = {
    "wiener": Named("Wiener", "optics.deconvolution.wiener", True),
    "richardson-lucy": Named("Richardson-Lucy", "optics.deconvolution.richardson_lucy", True),
    "total-variation": Named("total variation", "optics.deconvolution.total_variation", True),
    "poisson-tv": Named("Poisson total variation", "optics.deconvolution.poisson", True),
    "hyper-laplacian": Named("hyper-Laplacian", "optics.deconvolution.hyper_laplacian"),
    "l-bfgs-b": Named("L-BFGS-B", "optics.deconvolution.bounded"),
    "plug-and-play": Named("learned denoiser", "optics.deconvolution.plug_and_play"),
}
"""As commands, files and rows of tables call them."""

AUTO = "auto"
"""What serves best in the time."""

SHORT = {"tv": "total-variation"}

ASKABLE = (AUTO, *RESTORATIONS, *SHORT)
"""What a person may ask for."""
