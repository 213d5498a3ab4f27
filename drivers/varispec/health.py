"""A VariSpec's state in words, and what should be done about it."""

from __future__ import annotations

from dataclasses import dataclass

from drivers.varispec.protocol import Status, Version
from drivers.varispec.settling import COLDEST, WARMEST

_DRIFT = 3.0
"""Degrees Celsius by which the optics may change until they should be initialised again."""

_STALE = 8 * 3600.0
"""Seconds after which they should be."""

_INFRARED, _SLOW = 850.0, 0.15
"""Models that reach so far (nm) are specified with this response time (s)."""


@dataclass(frozen=True)
class Health:
    """What is known. temperatures: now and when it was initialised, in degrees Celsius.

    age: seconds since then; how: whether that was seen. settling: seconds, as specified and as
    it is now. failures: answers that failed.
    """

    version: Version
    status: Status
    temperature: float
    temperature_then: float
    age: float
    how: str
    specified: float
    settling: float
    failures: int

    @property
    def words(self) -> dict[str, str]:
        version = self.version
        return {
            "firmware": version.firmware,
            "serial number": version.serial,
            "range": f"{version.shortest:.2f} to {version.longest:.2f} nm",
            "status": self.status.words,
            "temperature": f"{self.temperature:.1f} °C",
            "settling": f"{self.settling * 1e3:.0f} ms",
            "initialised": f"{self.how} {self.age / 3600:.1f} h ago, "
            f"at {self.temperature_then:.1f} °C",
            "failed answers": str(self.failures),
            "advice": "; ".join(self._advice()) or "none",
        }

    def _advice(self) -> list[str]:
        advice = []
        change = abs(self.temperature - self.temperature_then)
        if not self.status.initialised or self.age > _STALE or change > _DRIFT:
            on = f"{change:.1f} °C and {self.age / 3600:.1f} h on"
            advice.append(f"initialise it: refresh(). It is {on}")
        if not COLDEST <= self.temperature <= WARMEST:
            advice.append(f"it works from {COLDEST:g} to {WARMEST:g} °C")
        if self.version.longest >= _INFRARED and self.specified < _SLOW:
            advice.append("infrared models settle in 150 ms: set settling_ms")
        return advice
