"""A device in a process of its own, so that a hung native library can be killed and named.

`Hosted` stands for the device here; `serving` is the life of the device's process. What goes
between the two goes by a `Channel`. Importing this loads nothing heavy: the device's process
begins with it, too.
"""

from __future__ import annotations

from drivers.hosted.device import Hosted

__all__ = ["Hosted"]
