"""`labapp virtual-bench serve`: every simulated instrument behind its true wire."""

from __future__ import annotations

import tempfile
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from drivers.clock import RealClock
from labapp.bench.opening import BenchFiles, BenchSetup, build_world, read_scene
from labapp.bench.virtual_bench.bench_text import bench_text
from labapp.bench.virtual_bench.cameras import serve_camera
from labapp.bench.virtual_bench.filters import FILTERS, serve_filter
from labapp.bench.virtual_bench.instruments import Instrument, Site
from labapp.bench.virtual_bench.listening import asked_to_end, listen
from labapp.bench.virtual_bench.panels import serve_panel
from labapp.bench.virtual_bench.shared import SharedWorld
from labapp.bench.virtual_bench.spectroradiometers import serve_spectroradiometer
from labapp.bench.virtual_bench.talking import Talk
from labapp.common.console import say
from labapp.common.errors import UserError
from labapp.files.bench_file import read_bench
from labapp.files.writing import make_folder, require_writable, write_whole

_KINDS = {
    "filter": FILTERS,
    "camera": ("gige",),
    "slm": ("screen",),
    "spectroradiometer": ("cs2000",),
}
"""What an instrument may be, if it is served at all."""


@dataclass(frozen=True)
class Wished:
    """What shall be served. files: of the bench that is described, and of its scene.

    folder: for the ports; one of their own if None. out: the bench file that is written.
    """

    files: BenchFiles
    filter: str
    camera: str
    slm: str
    spectroradiometer: str
    display: str
    screen: str
    folder: Path | None
    out: Path | None
    force: bool
    until_eof: bool

    def require_sound(self) -> None:
        """UserError names the first option that is wrong."""
        for name, kinds in _KINDS.items():
            value, known = getattr(self, name), (*kinds, "none")
            if value not in known:
                raise UserError(f"--{name} is {value!r}. Choose one of {', '.join(known)}.")
        if self.screen and not self.display:
            raise UserError("--screen is given without --display. Give both: :0 and HDMI-1.")
        if self.display and ":" not in self.display:
            raise UserError(f"--display is {self.display!r}. Write it as in DISPLAY, such as :0.")
        if self.out is not None:
            require_writable(self.out, force=self.force)


def serve(wished: Wished) -> None:
    """Serve until the end is asked for; nothing is left behind. UserError says what is wrong."""
    wished.require_sound()
    setup = BenchSetup(
        read_bench(wished.files.bench),
        read_scene(wished.files),
        str(wished.files.bench),
        str(wished.files.scene),
    )
    with asked_to_end() as ended, ExitStack() as stack:
        shared, targets, served = _start(wished, setup, stack)
        text = bench_text(setup.bench, served, targets)
        print(text, flush=True)
        if wished.out is not None:
            write_whole(wished.out, text.encode())
        _say_what_next(wished, list(served))
        listen(Talk(shared, targets, served), ended, until_eof=wished.until_eof)
    say("the virtual bench has ended")


def _start(
    wished: Wished, setup: BenchSetup, stack: ExitStack
) -> tuple[SharedWorld, list[str], dict[str, Instrument]]:
    """The world, its targets, and the instruments before it by their names on the bench."""
    clock = RealClock()
    camera = setup.bench.uncalibrated().build_camera()
    world = build_world(camera, setup, clock)
    shared = SharedWorld(world, clock)
    site = Site(shared, _folder(wished.folder, stack), stack)
    served: dict[str, Instrument] = {}
    if wished.slm != "none":
        served["slm"] = serve_panel(world.camera.panel, wished.display, wished.screen, site)
    if wished.filter != "none":
        served["filter"] = serve_filter(wished.filter, setup.bench.devices.filter, site)
    if wished.camera != "none":
        served["camera"] = serve_camera(world.camera.sensor, site)
    if wished.spectroradiometer != "none":
        served["spectroradiometer"] = serve_spectroradiometer(site)
    return shared, list(world.scene.targets), served


def _folder(folder: Path | None, stack: ExitStack) -> Path:
    if folder is not None:
        make_folder(folder)
        return folder.resolve()
    made = tempfile.TemporaryDirectory(prefix="labapp-bench-", ignore_cleanup_errors=True)
    return Path(stack.enter_context(made))


def _say_what_next(wished: Wished, names: list[str]) -> None:
    bench = "bench.toml" if wished.out is None else wished.out
    where = "Save what was printed as bench.toml, then" if wished.out is None else "Then"
    say(f"{', '.join(names)} served. {where}, in another terminal:")
    say(f"  labapp gui --bench {bench}")
    say(f"  labapp run plan.toml --bench {bench} --out run.h5")
    say("Type `target NAME` when it asks for a target, `help` for more, `quit` or Ctrl-C to end.")
