"""What plans save against everything on: operations that are counted, and processor time."""

from __future__ import annotations

import statistics
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from figures import Figure
from labapp.common.console import print_message
from labapp.files.file_lookup import bundled_scenes
from labapp.files.reading import bundled_path
from labapp.prediction.simulating.all_effects import (
    finest_levels,
    render_all_effects,
    render_by_plan,
)
from labapp.prediction.simulating.picture_request import (
    PictureRequest,
    modified_bench_setup,
    prepare_bench_scene,
)
from optics.light import Band
from optics.progress import Progress
from optics.threads import single_threaded
from simulator.effects.registry import EFFECTS
from simulator.effects.rendering_work import FILTER_BANDWIDTH, LIGHT_SAMPLING
from simulator.imaging import Imaging
from simulator.scene import PhotographPrint
from simulator.situation import Situation

_TOL = 1e-2
_PART = {"sensor": {"width": 256, "height": 256}}
"""What is rendered of the bundled bench: a part of its sensor."""

_SIMPLE_GOAL, _BUNDLED_GOAL = 10.0, 5.0

_CHOSEN = (FILTER_BANDWIDTH, LIGHT_SAMPLING)
"""Effects whose fineness somebody has to choose once for all scenes who doesn't decide for each:
all others are on, or off, by what there is."""

_MOST_WORK = 1e11
"""Operations of a picture with everything on that are measured too; of what takes more, they are
told by the rules that the measured ones are counted by."""


@dataclass(frozen=True)
class Saved:
    """How many times less: in operations that were counted, and in processor time.

    deciding: share of the processor time that went into the plan.
    """

    counted: float
    cpu: float
    deciding: float


@single_threaded
def work_figures(folder: Path) -> list[Figure]:
    """A monochromatic print in focus, and every target of every bundled scene, on the bundled
    bench with 256 x 256 pixels of its sensor, against everything on, as fine as the most
    demanding of them asks for."""
    finer = {name: max(levels) for name, levels in _demanded().items()}
    with _staged(None, "photograph") as s:
        simple = saved(simple_picture(s), finer)
    print_message(f"simple: {simple}")
    told, measured = [], []
    for path, name in _targets():
        with _staged(path, name) as s:
            everything = _work(s, finest_levels(s, finer))
            told.append(_times(everything, Imaging(_TOL).plan(s).work))
            print_message(f"{path.stem} {name}: {told[-1]:.1f} times told")
            if everything < _MOST_WORK:
                measured.append(saved(s, finer))
                print_message(f"{path.stem} {name}: {measured[-1]}")
    counted, cpu = (
        statistics.median(getattr(one, what) for one in measured) for what in ("counted", "cpu")
    )
    return [
        Figure(
            "work with everything on over that of a bright, monochromatic print, tol 1e-2",
            f"≥ {_SIMPLE_GOAL:g} times less",
            f"{simple.counted:.0f} times counted, {simple.cpu:.0f} times in CPU time with deciding",
            min(simple.counted, simple.cpu) >= _SIMPLE_GOAL,
        ),
        Figure(
            "the same for the targets of the bundled scenes, median",
            f"≥ {_BUNDLED_GOAL:g} times less",
            f"{len(told)} targets: {statistics.median(told):.0f} times told; of the "
            f"{len(measured)} quickest {counted:.0f} times counted, {cpu:.0f} times in CPU time "
            "with deciding",
            min(statistics.median(told), counted, cpu) >= _BUNDLED_GOAL,
        ),
    ]


def _targets() -> Iterator[tuple[Path, str]]:
    for path in (bundled_path("scene.toml"), *bundled_scenes().values()):
        scene = modified_bench_setup(path, _PART).scene
        assert scene is not None
        yield from ((path, name) for name in scene.targets)


def _demanded() -> dict[str, list[int]]:
    """Of each target, the level from which on nothing changes any more."""
    found: dict[str, list[int]] = {name: [0] for name in _CHOSEN}
    for path, name in _targets():
        with _staged(path, name) as s:
            levels = finest_levels(s)
        for one in _CHOSEN:
            found[one].append(levels.get(one, 0))
    return found


def _work(s: Situation, levels: Mapping[str, int]) -> float:
    whole = dict.fromkeys((one.name for one in EFFECTS), 0) | dict(levels)
    return sum(one.added_operations(s, whole) for one in EFFECTS if one.name in levels)


@contextmanager
def _staged(scene: Path | None, target: str) -> Iterator[Situation]:
    with prepare_bench_scene(
        modified_bench_setup(scene, _PART), PictureRequest(target=target), Progress()
    ) as staged:
        yield staged.situation


def simple_picture(s: Situation) -> Situation:
    """Of a photograph in focus and in light of one wavelength, four fifths of the well full."""
    target = s.target
    assert isinstance(target, PhotographPrint)
    grey = target.image.mean(-1, keepdim=True).expand(-1, -1, 3).contiguous()
    bright = replace(target, image=grey.clamp(0.2, 1), distance=s.camera.lens.focus_distance)
    lit = replace(s, target=bright, band=Band(s.wavelength, 0.1e-9))
    fill = 0.8 * s.camera.sensor.full_well / (lit.picture_probe.brightest * s.exposure)
    return replace(lit, exposure=s.exposure * fill)


def saved(s: Situation, finer: Mapping[str, int] | None = None, tol: float = _TOL) -> Saved:
    """By the plan for a tolerance, from nothing that is kept, deciding included. finer: levels of
    everything that are finer than this picture asks for."""
    # The first of all also loads what is only loaded once. What a situation knows of itself is
    # found out again each time.
    first = render_by_plan(replace(s), tol)
    whole = render_all_effects(s, finer=finer)
    again = render_by_plan(replace(s), tol)
    planned = min(first, again, key=lambda one: one.cpu)
    return Saved(
        _times(whole.operations, planned.operations),
        _times(whole.cpu, planned.cpu),
        planned.planning_cpu / planned.cpu,
    )


def _times(more: float, less: float) -> float:
    return more / less if less else 1.0


MEASUREMENTS = {"work": work_figures}
