"""`labapp virtual-bench serve`: simulated instruments at real ports, for real drivers."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from drivers.clock import RealClock
from labapp.bench.opening import BenchFiles, BenchSetup, build_world, read_scene
from labapp.bench.virtual_bench.cameras import serve_camera
from labapp.bench.virtual_bench.command_interpreter import (
    CommandInterpreter,
    catch_stop_requests,
    read_commands,
)
from labapp.bench.virtual_bench.filters import FILTERS, serve_filter
from labapp.bench.virtual_bench.instruments import (
    ServedInstrument,
    ServingContext,
    serve_spectroradiometer,
)
from labapp.bench.virtual_bench.panels import serve_panel
from labapp.bench.virtual_bench.shared_world import SharedWorld
from labapp.common.console import print_message
from labapp.common.errors import UserError
from labapp.common.plain_text import printable, shell_word
from labapp.files.bench_file import BenchFile, read_bench
from labapp.files.plan_folder import as_toml
from labapp.files.writing import make_folder, require_writable, write_atomically

_HEAD = """\
# A virtual bench behind its wires: real drivers, and instruments that are simulated.
# Its ports are there while `labapp virtual-bench serve` runs.
"""


def bench_text(
    bench: BenchFile, served: Mapping[str, ServedInstrument], targets: Sequence[str]
) -> str:
    """Return the bench file of served instruments as TOML.

    Devices that aren't served keep their tables from `bench`.
    """
    data = bench.model_dump(mode="json", exclude_none=True, exclude_defaults=True)
    devices = data.pop("devices")
    data["name"] = f"{bench.name}, behind its wires"
    text = _HEAD
    for role in {**devices, **served}:
        if role == "targets":
            table = _device_table("manual-targets", {"names": list(targets)})
        elif one := served.get(role):
            table = _device_table(one.driver, one.options)
        else:
            text += f"# The {role} isn't served: it is the one that the bench file had.\n"
            table = devices[role]
        data[f"devices.{role}"] = table
    return text + as_toml(data)


def _device_table(driver: str, options: dict[str, Any]) -> dict[str, Any]:
    return {"driver": driver, "options": options, "simulated": True}


_KINDS = {
    "filter": FILTERS,
    "camera": ("gige",),
    "slm": ("screen",),
    "spectroradiometer": ("cs2000",),
}
"""Kinds of each instrument that can be served, besides "none"."""


@dataclass(frozen=True)
class ServeOptions:
    """Options of `labapp virtual-bench serve`.

    filter, camera, slm, spectroradiometer: kind of each instrument, or "none".
    display, screen: X server and output that show the SLM's pattern; empty for an Xvfb.
    folder: of the ports; None for a temporary one.
    out: bench file to write.
    force: whether an existing file is replaced.
    until_eof: whether the end of standard input ends the instruments.
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

    def require_valid(self) -> None:
        """Raise UserError for the first wrong option."""
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


def serve(options: ServeOptions) -> None:
    """Serve all instruments until they are stopped, then remove ports and folders.

    Raises UserError for options or files that are wrong.
    """
    options.require_valid()
    setup = BenchSetup(
        read_bench(options.files.bench),
        read_scene(options.files),
        str(options.files.bench),
        str(options.files.scene),
    )
    with catch_stop_requests() as ended, ExitStack() as stack:
        shared, targets, served = _start(options, setup, stack)
        text = bench_text(setup.bench, served, targets)
        print(printable(text), flush=True)
        if options.out is not None:
            write_atomically(options.out, text.encode())
        _print_next_steps(options, list(served))
        read_commands(
            CommandInterpreter(shared, targets, served), ended, until_eof=options.until_eof
        )
    print_message("the virtual bench has ended")


def _start(
    options: ServeOptions, setup: BenchSetup, stack: ExitStack
) -> tuple[SharedWorld, list[str], dict[str, ServedInstrument]]:
    """Start the virtual world and its instruments.

    Returns the world, the names of its targets, and the instruments by their names on the bench.
    """
    clock = RealClock()
    camera = setup.bench.without_calibration().build_camera()
    world = build_world(camera, setup, clock)
    shared = SharedWorld(world, clock)
    if options.folder is not None:
        make_folder(options.folder)
        folder = options.folder.resolve()
    else:
        made = tempfile.TemporaryDirectory(prefix="labapp-bench-", ignore_cleanup_errors=True)
        folder = Path(stack.enter_context(made))
    site = ServingContext(shared, folder, stack)
    served: dict[str, ServedInstrument] = {}
    if options.slm != "none":
        served["slm"] = serve_panel(world.camera.panel, options.display, options.screen, site)
    if options.filter != "none":
        served["filter"] = serve_filter(options.filter, setup.bench.devices.filter, site)
    if options.camera != "none":
        served["camera"] = serve_camera(world.camera.sensor, site)
    if options.spectroradiometer != "none":
        served["spectroradiometer"] = serve_spectroradiometer(site)
    return shared, list(world.scene.targets), served


def _print_next_steps(options: ServeOptions, names: list[str]) -> None:
    bench = "bench.toml" if options.out is None else options.out
    where = "Save what was printed as bench.toml, then" if options.out is None else "Then"
    print_message(f"{', '.join(names)} served. {where}, in another terminal:")
    print_message(f"  labapp gui --bench {shell_word(bench)}")
    print_message(f"  labapp run plan.toml --bench {shell_word(bench)} --out run.h5")
    print_message(
        "Type `target NAME` when it asks for a target, `help` for more, `quit` or Ctrl-C to end."
    )
