"""Describe a filter's state, and say what should be done about it."""

from __future__ import annotations

from dataclasses import dataclass

from drivers.varispec.protocol import Status, Version
from drivers.varispec.settling import COLDEST, WARMEST


@dataclass(frozen=True)
class VariSpecHealth:
    """What is known of a filter's state.

    temperature, initialised_temperature: degrees Celsius, now and at the initialisation. age:
    seconds since the initialisation. initialisation: how it was initialised. specified, settling:
    settling in seconds, as specified and at the present temperature. failures: failed answers.
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
        # It should be initialised again after eight hours, or a change of 3 degrees.
        if not self.status.initialised or self.age > 8 * 3600.0 or change > 3.0:
            on = f"{change:.1f} °C and {self.age / 3600:.1f} h on"
            advice.append(f"initialise it: refresh(). It is {on}")
        if not COLDEST <= self.temperature <= WARMEST:
            advice.append(f"it works from {COLDEST:g} to {WARMEST:g} °C")
        # Models that reach 850 nm are specified with a response time of 0.15 s.
        if self.version.longest >= 850.0 and self.specified < 0.15:
            advice.append("infrared models settle in 150 ms: set settling_ms")
        return advice
