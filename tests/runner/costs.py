"""What tests cost, in processor time and in waiting."""

from __future__ import annotations

import resource
from collections import defaultdict
from collections.abc import Generator
from dataclasses import dataclass

import pytest

_CPU = "cpu_seconds"


class Meter:
    """A plugin for where tests run: it adds to a test's report what processor time it took."""

    @pytest.hookimpl(wrapper=True, tryfirst=True)
    def pytest_runtest_protocol(self) -> Generator[None, object, object]:
        self._before = cpu_seconds()
        return (yield)

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtest_makereport(self, item: pytest.Item, call: pytest.CallInfo[None]) -> None:
        if call.when == "teardown":
            item.user_properties.append((_CPU, cpu_seconds() - self._before))


def cpu_seconds() -> float:
    """Of this process and of its children that have ended."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(one.ru_utime + one.ru_stime for one in used)


@dataclass
class Cost:
    """Seconds: of the processor, and by the clock."""

    cpu: float = 0.0
    wall: float = 0.0


class Costs:
    """Of every test that has run, by its name."""

    def __init__(self) -> None:
        self._costs: dict[str, Cost] = defaultdict(Cost)

    def __len__(self) -> int:
        return len(self._costs)

    def add(self, report: pytest.TestReport) -> None:
        cost = self._costs[report.nodeid]
        cost.wall += report.duration
        cost.cpu += dict(report.user_properties).get(_CPU, 0.0)

    def table(self, rows: int) -> list[str]:
        """Lines for a person: the sum, and the functions whose cases take most of the processor."""
        functions: dict[str, Cost] = defaultdict(Cost)
        for name, cost in self._costs.items():
            one = functions[function(name)]
            one.cpu, one.wall = one.cpu + cost.cpu, one.wall + cost.wall
        dearest = sorted(functions.items(), key=lambda one: -one[1].cpu)[:rows]
        cpu = sum(cost.cpu for cost in functions.values())
        wall = sum(cost.wall for cost in functions.values())
        return [
            f"{cpu:.0f} s of processor time, {wall:.0f} s by the clocks of the workers",
            f"The {len(dearest)} dearest of {len(functions)} functions, of the processor and by "
            "the clock:",
            *(f"{one.cpu:6.1f} {one.wall:6.1f}  {name}" for name, one in dearest),
        ]

    def seconds(self) -> dict[str, float]:
        """By the clock, of each test function: the mean of its cases."""
        walls = defaultdict(list)
        for name, cost in self._costs.items():
            walls[function(name)].append(cost.wall)
        return {name: round(sum(of) / len(of), 4) for name, of in walls.items()}


def function(test: str) -> str:
    """The name of a test without its parameters."""
    return test.partition("[")[0]
