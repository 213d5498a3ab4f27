"""Drive Konica Minolta's spectroradiometers CS-2000 and CS-2000A."""

from drivers.cs2000.instrument import CS2000

__all__ = ["CS2000"]
