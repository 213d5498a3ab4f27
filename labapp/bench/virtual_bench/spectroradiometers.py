"""A simulated spectroradiometer, which sees the target through the filter."""

from __future__ import annotations

from labapp.bench.virtual_bench.instruments import (
    ServedInstrument,
    ServingContext,
    serve_on_serial_line,
)
from simulator.machines.cs2000 import CS2000Machine


def serve_spectroradiometer(site: ServingContext) -> ServedInstrument:
    """Serve a simulated CS-2000 until the site's stack is left."""
    machine = CS2000Machine(site.shared.radiance)
    # A pseudo-terminal has no control lines, so that hardware flow control isn't possible.
    return serve_on_serial_line(site, "cs2000", machine, 115200, rtscts=False)
