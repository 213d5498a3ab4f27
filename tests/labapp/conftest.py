"""The small bench for a test, and one run of the demo that several tests look at."""

from __future__ import annotations

import math
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import forked
import pytest
from figures import fork_server
from small_bench.files import SmallFiles, write_small, write_tiny

from drivers.hosted import child_process
from labapp.common.speed import save_speed
from labapp.pictures.report.record_analysis import RecordAnalysis
from labapp.studies.demo import run_first_light
from optics.accuracy import MachineSpeed
from simulator.imaging import Cache, Imaging, picture_key
from simulator.planning import EffectPlan
from simulator.situation import Situation


@pytest.fixture(scope="session", autouse=True)
def kept_speed(tmp_path_factory):
    """A machine of the usual speed: nothing is measured, and nobody's cache is written."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))
        save_speed(MachineSpeed())
        yield


@pytest.fixture(scope="module", autouse=True)
def children_with_their_libraries_loaded():
    """Processes that check records, hold devices and fork others are forked themselves.

    That spares each its imports. `subprocess` would start them the same way: tests/forked sees
    that nothing else differs.
    """

    def start(command: list[str], **options: Any) -> subprocess.Popen[Any]:
        """Another Python is started as ever."""
        is_ours = command[0] == sys.executable and command[1] in ("-c", "-m")
        return (forked if is_ours else subprocess).Popen(command, **options)

    processes = SimpleNamespace(**{**vars(subprocess), "Popen": start})
    with pytest.MonkeyPatch.context() as patch:
        for module in (child_process, fork_server):
            patch.setattr(module, "subprocess", processes)
        yield


@pytest.fixture(scope="module", autouse=True)
def figures_laid_out_once():
    """Figures of a module that are alike are laid out once, which takes half of a drawing.

    The others are drawn with their axes where Matplotlib puts them.
    """
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    known: set[tuple[int, float]] = set()

    def execute(self: ConstrainedLayoutEngine, figure: Any) -> Any:
        kind = len(figure.axes), figure.get_figwidth()
        if kind not in known:
            known.add(kind)
            return lay_out(self, figure)
        return None

    lay_out = ConstrainedLayoutEngine.execute
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(ConstrainedLayoutEngine, "execute", execute)
        yield


@pytest.fixture
def few_field_samples(monkeypatch: pytest.MonkeyPatch) -> None:
    """Free space is compared at few samples of the exact field: each is a sum over all nodes."""
    monkeypatch.setattr("labapp.accuracy.propagate._MAX_SAMPLES", 16)
    monkeypatch.setattr("labapp.accuracy.propagate._MAX_PRODUCTS", 4e6)


@pytest.fixture
def drawn() -> None:
    """Asked for by tests that need the drawings, where others do without."""


@pytest.fixture
def white_sheets(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Figures are made, and written as white sheets of their size: most of a command's time."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    def leave_white(self: FigureCanvasAgg, *args: Any, **options: Any) -> None:
        self.figure.set_visible(False)
        write(self, *args, **options)

    write = FigureCanvasAgg.print_png
    if "drawn" not in request.fixturenames:
        monkeypatch.setattr(FigureCanvasAgg, "print_png", leave_white)


_plans = Cache(256)


@pytest.fixture(scope="module", autouse=True)
def kept_plans():
    """What effects a picture of a small bench calls for is decided once, not for every test.

    The decision follows from its causes alone, and takes ten times as long as the frames do.
    Other rooms' tests, which may follow in the same process, are left without.
    """

    def plan(self: Imaging, s: Situation) -> EffectPlan:
        if math.prod(s.camera.sensor.shape) > 1e4:
            return decided(self, s)
        forced = tuple(sorted(self.forced.items()))
        return _plans.get(
            (self.tol, forced, self.decide_by, picture_key(s)), lambda: decided(self, s)
        )

    decided = Imaging.plan
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Imaging, "plan", plan)
        yield


@pytest.fixture
def small(tmp_path: Path) -> SmallFiles:
    return write_small(tmp_path / "files")


@pytest.fixture
def tiny(tmp_path: Path) -> SmallFiles:
    return write_tiny(tmp_path / "files")


@dataclass(frozen=True)
class Demo:
    folder: Path
    analysis: RecordAnalysis

    @property
    def record(self) -> Path:
        return self.folder / "run.h5"


@pytest.fixture(scope="session")
def demo(tmp_path_factory: pytest.TempPathFactory) -> Demo:
    """The demo as a user gets it, run once for all tests that look at it."""
    folder = tmp_path_factory.mktemp("demo")
    return Demo(folder, run_first_light(folder))


@pytest.fixture
def labapp(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Callable[..., tuple[int, str, str]]:
    """Run the command line in this process: its exit code, standard output and error."""

    def run(*arguments: str | Path) -> tuple[int, str, str]:
        from labapp.cli import main

        monkeypatch.setattr("sys.argv", ["labapp", *map(str, arguments)])
        code = 0
        try:
            main()
        except SystemExit as stop:
            code = stop.code if isinstance(stop.code, int) else int(stop.code is not None)
        printed = capsys.readouterr()
        return code, printed.out, printed.err

    return run
