"""A wall's clock for tests, which nobody waits for."""

from __future__ import annotations


class Wall:
    """It stands still but for those who sleep, each a little too long."""

    def __init__(self) -> None:
        self.now = 1000.0

    def monotonic(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        self.now += seconds + 1e-6
