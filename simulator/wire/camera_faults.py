"""What goes wrong with a camera behind the wire."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, get_args

CameraFaultKind = Literal[
    "lost packets",
    "missing frame",
    "late frame",
    "corrupt frame",
    "stale frame",
    "wrong exposure",
    "stopped stream",
    "heartbeat loss",
    "silence",
    "disconnect",
]
"""By name: half of a frame's packets, or all of them, never arrive; a frame comes 1.5 s too
late; its leader tells another size; a new exposure is obeyed three frames late; the camera
changes its exposure by itself, and says so when asked; it hears no trigger; it forgets who
controls it; it neither hears nor says anything; it is gone, and comes back as switched on."""

CAMERA_FAULT_KINDS: tuple[CameraFaultKind, ...] = get_args(CameraFaultKind)


@dataclass(frozen=True)
class CameraFault:
    """One thing that goes wrong. at: bench time at which it begins. seconds: it lasts."""

    kind: CameraFaultKind
    at: float = 0.0
    seconds: float = math.inf

    def __post_init__(self) -> None:
        if self.kind not in CAMERA_FAULT_KINDS:
            raise ValueError(f"kind is {self.kind!r}; choose {', '.join(CAMERA_FAULT_KINDS)}")
        if not self.seconds > 0:
            raise ValueError(f"seconds is {self.seconds:g}; it must be positive")
