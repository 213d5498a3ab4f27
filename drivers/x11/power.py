"""Tell whether an X server has switched its screens off to save power, and switch them on.

The requests are those of the X.Org document "DPMS Extension". A screen that is switched off looks
the same in the server's memory.
"""

from __future__ import annotations

import struct
from enum import IntEnum

from drivers.x11.connection import XConnection


class _PowerRequest(IntEnum):
    """Name the requests of the DPMS extension by their minor opcodes."""

    FORCE_LEVEL = 6
    INFO = 7


def is_switched_off(x: XConnection) -> bool:
    """Return whether the X server's screens are dark to save power; False if it never does that."""
    if not x.has("DPMS"):
        return False
    told = x.query_extension("DPMS", _PowerRequest.INFO)
    level, is_enabled = struct.unpack_from("<HB", told, 8)
    return bool(level and is_enabled)


def switch_on(x: XConnection) -> None:
    """Have the X server switch its screens on, if it has switched them off to save power."""
    if is_switched_off(x):
        x.send_extension_request("DPMS", _PowerRequest.FORCE_LEVEL, "H2x", 0)
