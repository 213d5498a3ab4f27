"""Processes that are started from here, and devices in them, which can be killed and named.

`Process` starts, awaits, kills and reaps one, whatever it is for: a device, Aravis, the engine
of the window. `child` is how it begins, guarded so that it doesn't outlive its parent; a `Line`
carries requests, answers and news between the two. `Hosted` stands here for a device over there,
and `serving` is that device's life; their arrays go by a `Channel`, in memory that both see.
Importing this loads nothing but the standard library: every such process begins with it.
"""

from __future__ import annotations

from drivers.hosted.device import Hosted

__all__ = ["Hosted"]
