"""Tell whether the screens are switched off to save power, and switch them on.

The requests are those of the X.Org document "DPMS Extension". A screen that is switched off looks
the same in the server's memory.
"""

from __future__ import annotations

import struct
from enum import IntEnum

from drivers.x11.connection import XConnection


class _PowerRequest(IntEnum):
    """Minor opcodes of the DPMS extension's requests."""

    FORCE_LEVEL = 6
    INFO = 7


def is_switched_off(x: XConnection) -> bool:
    """Return whether the screens are dark to save power; False if the server never does that."""
    if not x.has("DPMS"):
        return False
    told = x.query_extension("DPMS", _PowerRequest.INFO)
    level, is_enabled = struct.unpack_from("<HB", told, 8)
    return bool(level and is_enabled)


def switch_on(x: XConnection) -> None:
    """Switch the screens on, if they are off to save power."""
    if is_switched_off(x):
        x.send_extension_request("DPMS", _PowerRequest.FORCE_LEVEL, "H2x", 0)
