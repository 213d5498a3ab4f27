"""The spectroradiometer at its port, which looks at the target through the filter."""

from __future__ import annotations

from labapp.bench.virtual_bench.instruments import (
    ServedInstrument,
    ServingContext,
    serve_on_serial_line,
)
from simulator.machines.cs2000 import CS2000Machine


def serve_spectroradiometer(site: ServingContext) -> ServedInstrument:
    """Start it until the site's stack is left."""
    machine = CS2000Machine(site.shared.radiance)
    # A pseudo-terminal has no wires that hold the other side up.
    return serve_on_serial_line(site, "cs2000", machine, 115200, rtscts=False)
