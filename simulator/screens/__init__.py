"""X servers without a monitor, as screens for SLM panels, and screenshots of them by xwd."""

from simulator.screens.server import NoXServer, XServer, require_program, running_server, xvfb
from simulator.screens.two_screens import NEIGHBOUR, PANEL, lay_out, xorg

__all__ = [
    "NEIGHBOUR",
    "PANEL",
    "NoXServer",
    "XServer",
    "lay_out",
    "require_program",
    "running_server",
    "xorg",
    "xvfb",
]
