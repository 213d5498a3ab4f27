"""Restorations by heavy tails and within bounds, beside total variation, of one photograph."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

from figures import Figure
from figures.photographs import camera
from labapp.accuracy.blurs import SimulatedPhotograph, disk, simulate_photograph
from optics.inverse.bounded import restore_within_bounds
from optics.inverse.hyper_laplacian import hyper_laplacian
from optics.inverse.observation import Observation
from optics.inverse.restored_image import RestoredImage
from optics.inverse.total_variation import total_variation
from optics.threads import single_threaded

_WAYS: dict[str, tuple[float, Callable[[Observation], RestoredImage]]] = {
    "hyper-Laplacian restoration, disk of 7, noise .01, period known and not": (
        27.3,
        hyper_laplacian,
    ),
    "total variation within 0 to 1 by L-BFGS-B, disk of 7, noise .01, period known and not": (
        27.0,
        lambda seen: restore_within_bounds(seen, upper=1.0, iterations=100),
    ),
}
"""With the PSNR that is asked of each, in dB."""


@single_threaded
def restoration_figures(folder: Path) -> list[Figure]:
    """A disk of 7 on a known period, and on the part of a scene that a camera sees; noise and
    weights found by the methods."""
    scene, figures = camera(), []
    for name, (goal, way) in _WAYS.items():
        asked = f"≥ {goal} dB"
        if scene is None:
            figures.append(Figure(name, asked, "not measured: no scikit-image", None))
            continue
        cases = [
            simulate_photograph("period", scene, disk(7), 0.01, 0, "periodic"),
            simulate_photograph("frame", scene, disk(7), 0.01, 0),
        ]
        found = [(case, *_judged(case, way), *_judged(case, total_variation)) for case in cases]
        told = "; ".join(
            f"{case.name} {own:.2f} dB in {ms:.0f} ms (total variation {other:.2f} dB in "
            f"{other_ms:.0f} ms)"
            for case, own, ms, other, other_ms in found
        )
        figures.append(Figure(name, asked, told, all(own >= goal for _, own, *_ in found)))
    return figures


def _judged(
    case: SimulatedPhotograph, way: Callable[[Observation], RestoredImage]
) -> tuple[float, float]:
    """PSNR of the whole frame, and milliseconds of the processor."""
    begun = time.process_time()
    image = way(case.problem).image
    return case.quality(image)[0], 1e3 * (time.process_time() - begun)


MEASUREMENTS = {"restoration-priors": restoration_figures}
