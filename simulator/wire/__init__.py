"""The cable between a driver and an instrument of the virtual bench: bytes, timing and faults."""

from simulator.wire.faults import WIRE_FAULT_KINDS, WireFault
from simulator.wire.line import SimulatedLine
from simulator.wire.protocol_sim import plug_in, unplug

__all__ = ["WIRE_FAULT_KINDS", "SimulatedLine", "WireFault", "plug_in", "unplug"]
