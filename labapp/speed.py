"""How fast this machine is."""

from __future__ import annotations

from optics.accuracy import MachineSpeed


def machine_speed() -> MachineSpeed:
    return MachineSpeed()
