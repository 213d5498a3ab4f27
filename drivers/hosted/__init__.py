"""Processes that are started from here, and devices in them, which can be killed and named.

`ChildProcess` starts, awaits, kills and reaps one, whatever it is for: a device, Aravis, the engine
of the window. `bootstrap` is how it begins, guarded so that it doesn't outlive its parent; a
`MessageSocket` carries requests, answers and news between the two. `HostedDevice` stands here for a
device over there, and `serving` is that device's life; their arrays go by a `SharedMemoryChannel`,
in memory that both see. Importing this loads nothing but the standard library: every such process
begins with it.
"""

from __future__ import annotations

from drivers.hosted.device import HostedDevice

__all__ = ["HostedDevice"]
