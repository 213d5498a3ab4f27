"""The spectroradiometer at its port, which looks at the target through the filter."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path

from drivers.interfaces import Clock
from labapp.bench.virtual_bench.instruments import Instrument, on_a_wire
from labapp.bench.virtual_bench.shared import SharedWorld
from simulator.machines.cs2000 import CS2000Machine
from simulator.wire.line import Line
from simulator.wire.pty import ServedLine

SPECTRORADIOMETERS = ("cs2000", "none")


def serve_spectroradiometer(
    shared: SharedWorld, clock: Clock, folder: Path, stack: ExitStack
) -> Instrument:
    """Start it until the stack is left."""
    machine = CS2000Machine(shared.radiance)
    line, port = Line(machine, baudrate=115200), folder / "cs2000"
    stack.enter_context(ServedLine(line, port, clock))
    # A pseudo-terminal has no wires that hold the other side up.
    options = {"port": str(port), "rtscts": False}
    return on_a_wire("cs2000", options, line, machine.own_faults, clock)
