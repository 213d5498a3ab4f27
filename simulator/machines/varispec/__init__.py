"""A VariSpec tunable filter, from its serial port to the wavelength that it passes."""

from simulator.machines.varispec.machine import VariSpecMachine

__all__ = ["VariSpecMachine"]
