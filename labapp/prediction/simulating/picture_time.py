"""The processor time of simulated pictures, from the operations that their plans predict."""

from __future__ import annotations

from optics.accuracy import MachineSpeed

_OPERATION_S = 4.3e-10
"""Seconds of one counted operation of the simulator, on a machine whose speed is the default one.
Measured: `labapp accuracy simulate` took 2.0 s for 4.7e9 operations."""


def seconds_per_operation(speed: MachineSpeed) -> float:
    """Return the processor seconds of each counted operation on a machine of a given speed."""
    return _OPERATION_S * speed.fft / MachineSpeed().fft
