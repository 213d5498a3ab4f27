"""Child processes, and devices that run in one, so that a device that hangs can be killed.

`ChildProcess` starts, awaits, kills and reaps a child process for any purpose: a device, Aravis,
the engine of the window. `bootstrap` is the code with which it begins; a watchdog ensures that it
doesn't outlive its parent. A `MessageSocket` carries requests, results and notifications between
the two processes. `HostedDevice` is the proxy of a device in a child process, where `serving`
answers its calls; `guard_devices` has a process that makes devices of this one safe if it is
killed. Arrays go through a `SharedMemoryChannel`, in memory that both map.
Importing this package loads only the standard library, because every child process begins with it.
"""

from __future__ import annotations

from drivers.hosted.device import HostedDevice

__all__ = ["HostedDevice"]
