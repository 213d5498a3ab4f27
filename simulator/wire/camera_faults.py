"""Faults of a GigE camera."""

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
"""Kinds of faults, by name.

lost packets: half of a frame's packets don't arrive. missing frame: no packet of a frame arrives.
late frame: a frame comes 1.5 s too late. corrupt frame: a frame's leader reports another size.
stale frame: a new exposure takes effect three frames late. wrong exposure: the camera doubles its
exposure by itself, and reports it when asked. stopped stream: triggers have no effect. heartbeat
loss: the camera forgets which program controls it. silence: it neither receives nor sends.
disconnect: it is gone, and returns in the state after power-up."""

CAMERA_FAULT_KINDS: tuple[CameraFaultKind, ...] = get_args(CameraFaultKind)


@dataclass(frozen=True)
class CameraFault:
    """One fault of a GigE camera.

    kind: one of CAMERA_FAULT_KINDS. at: time at which it begins, in seconds of the bench's clock.
    seconds: its duration.
    """

    kind: CameraFaultKind
    at: float = 0.0
    seconds: float = math.inf

    def __post_init__(self) -> None:
        if self.kind not in CAMERA_FAULT_KINDS:
            raise ValueError(f"kind is {self.kind!r}; choose {', '.join(CAMERA_FAULT_KINDS)}")
        if not self.seconds > 0:
            raise ValueError(f"seconds is {self.seconds:g}; it must be positive")
