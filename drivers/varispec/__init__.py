"""Drive the VariSpec liquid-crystal tunable filter of CRi and PerkinElmer."""

from drivers.varispec.filter import VariSpec

__all__ = ["VariSpec"]
