"""A VariSpec's state in words, and what should be done about it."""

from __future__ import annotations

from dataclasses import dataclass

from drivers.varispec.protocol import Status, Version
from drivers.varispec.settling import COLDEST, WARMEST

_MAX_TEMPERATURE_CHANGE = 3.0
"""Degrees Celsius by which the optics may change until they should be initialised again."""

_MAX_AGE = 8 * 3600.0
"""Seconds after which they should be."""

_INFRARED, _SLOW = 850.0, 0.15
"""Models that reach so far (nm) are specified with this response time (s)."""


@dataclass(frozen=True)
class VariSpecHealth:
    """What is known. temperatures: now and when it was initialised, in degrees Celsius.

    age: seconds since then; initialisation: whether that was seen. settling: seconds, as specified
    and as it is now. failures: answers that failed.
    """

    version: Version
    status: Status
    temperature: float
    initialised_temperature: float
    age: float
    initialisation: str
    specified: float
    settling: float
    failures: int

    @property
    def report(self) -> dict[str, str]:
        version = self.version
        return {
            "firmware": version.firmware,
            "serial number": version.serial,
            "range": f"{version.shortest:.2f} to {version.longest:.2f} nm",
            "status": self.status.description,
            "temperature": f"{self.temperature:.1f} °C",
            "settling": f"{self.settling * 1e3:.0f} ms",
            "initialised": f"{self.initialisation} {self.age / 3600:.1f} h ago, "
            f"at {self.initialised_temperature:.1f} °C",
            "failed answers": str(self.failures),
            "advice": "; ".join(self._advice()) or "none",
        }

    def _advice(self) -> list[str]:
        advice = []
        change = abs(self.temperature - self.initialised_temperature)
        if not self.status.initialised or self.age > _MAX_AGE or change > _MAX_TEMPERATURE_CHANGE:
            on = f"{change:.1f} °C and {self.age / 3600:.1f} h on"
            advice.append(f"initialise it: refresh(). It is {on}")
        if not COLDEST <= self.temperature <= WARMEST:
            advice.append(f"it works from {COLDEST:g} to {WARMEST:g} °C")
        if self.version.longest >= _INFRARED and self.specified < _SLOW:
            advice.append("infrared models settle in 150 ms: set settling_ms")
        return advice
