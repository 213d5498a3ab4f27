"""What plans save against everything on: operations that are counted, and processor time."""

from __future__ import annotations

import statistics
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from labapp.console import say
from labapp.figures import Figure
from labapp.simulating.asked import AskedPicture, stage_of
from labapp.simulating.everything import by_plan, with_everything
from labapp.simulating.quick import quick_setup, scene_files
from optics.light import Band
from optics.progress import Progress
from optics.threads import single_threaded
from simulator.scene import Photograph
from simulator.situation import Situation

_TOL = 1e-2
_SIMPLE_GOAL, _BUNDLED_GOAL = 10.0, 5.0


@dataclass(frozen=True)
class Saved:
    """How many times less, in operations that were counted, and in processor time.

    deciding: share of the processor time that went into the plan.
    """

    counted: float
    cpu: float
    deciding: float


@single_threaded
def work_figures(folder: Path) -> list[Figure]:
    """A monochromatic print in focus, and every target of every bundled scene, on the bundled
    bench with few pixels: there everything can be computed."""
    with _staged(None, "photograph") as s:
        simple = saved(simple_picture(s))
    found = {}
    for path in scene_files():
        scene = quick_setup(path).scene
        assert scene is not None
        for name in scene.targets:
            with _staged(path, name) as s:
                found[f"{path.stem} {name}"] = saved(s)
                say(f"{path.stem} {name}: {found[f'{path.stem} {name}']}")
    counted, cpu = (
        statistics.median(getattr(one, what) for one in found.values())
        for what in ("counted", "cpu")
    )
    return [
        Figure(
            "work with everything on over that of a bright, monochromatic print, tol 1e-2",
            f"≥ {_SIMPLE_GOAL:g} times less",
            f"{simple.counted:.1f} times counted, {simple.cpu:.1f} times in CPU time with deciding",
            min(simple.counted, simple.cpu) >= _SIMPLE_GOAL,
        ),
        Figure(
            "the same for the targets of the bundled scenes, median",
            f"≥ {_BUNDLED_GOAL:g} times less",
            f"{len(found)} targets: {counted:.1f} times counted, {cpu:.1f} times in CPU time with "
            "deciding",
            min(counted, cpu) >= _BUNDLED_GOAL,
        ),
    ]


@contextmanager
def _staged(scene: Path | None, target: str) -> Iterator[Situation]:
    with stage_of(quick_setup(scene), AskedPicture(target=target), Progress()) as staged:
        yield staged.situation


def simple_picture(s: Situation) -> Situation:
    """Of a photograph in focus and in light of one wavelength, four fifths of the well full."""
    target = s.target
    assert isinstance(target, Photograph)
    grey = target.image.mean(-1, keepdim=True).expand(-1, -1, 3).contiguous()
    bright = replace(target, image=grey.clamp(0.2, 1), distance=s.camera.lens.focus_distance)
    lit = replace(s, target=bright, band=Band(s.wavelength, 0.1e-9))
    fill = 0.8 * s.camera.sensor.full_well / (lit.picture.brightest * s.exposure)
    return replace(lit, exposure=s.exposure * fill)


def saved(s: Situation, tol: float = _TOL) -> Saved:
    """By the plan for a tolerance, from nothing that is kept, deciding included."""
    # The first of all also loads what is only loaded once. What a situation knows of itself is
    # found out again each time.
    first, whole, again = by_plan(replace(s), tol), with_everything(s), by_plan(replace(s), tol)
    planned = min(first, again, key=lambda one: one.cpu)
    return Saved(
        _times(whole.operations, planned.operations),
        _times(whole.cpu, planned.cpu),
        planned.deciding / planned.cpu,
    )


def _times(more: float, less: float) -> float:
    return more / less if less else 1.0
