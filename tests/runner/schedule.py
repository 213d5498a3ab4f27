"""Who runs what: units of tests go to the workers, the longest first.

A worker that finds nothing left takes half of what another one still has before it, so that all
end together even where nobody knows yet how long a test takes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import pytest
from xdist.report import report_collection_diff
from xdist.workermanage import WorkerController, parse_tx_spec_config

from runner.units import Unit

_AHEAD = 3
"""Tests that a worker has been sent: xdist's needs to know the next one to begin with one."""


class Schedule:
    """An xdist scheduler, with its methods. A test that ended its worker isn't run again.

    units: from the workers. seconds: how long a test takes, by its name; a guess is enough.
    """

    def __init__(
        self,
        config: pytest.Config,
        units: Callable[[], list[Unit]],
        seconds: Callable[[str], float],
    ) -> None:
        self._config, self._units, self._seconds = config, units, seconds
        self._wanted = len(parse_tx_spec_config(config))
        self._collections: dict[WorkerController, Sequence[str]] = {}
        self._sent: dict[WorkerController, list[int]] = {}
        self._unit: dict[WorkerController, Unit] = {}
        self._waiting: list[Unit] | None = None
        self._names: Sequence[str] = ()

    @property
    def nodes(self) -> list[WorkerController]:
        return list(self._sent)

    @property
    def collection_is_completed(self) -> bool:
        return self._waiting is not None or len(self._collections) >= self._wanted

    @property
    def tests_finished(self) -> bool:
        """Whether nothing is left but what workers do by themselves when they are told to end."""
        return self._waiting == [] and all(
            not self._unit[node].tests and len(sent) < 2 for node, sent in self._sent.items()
        )

    @property
    def has_pending(self) -> bool:
        return bool(self._waiting) or any(
            self._unit[node].tests or sent for node, sent in self._sent.items()
        )

    def add_node(self, node: WorkerController) -> None:
        self._sent[node], self._unit[node] = [], Unit()

    def add_node_collection(self, node: WorkerController, collection: Sequence[str]) -> None:
        first, names = next(iter(self._collections.items()), (node, self._names or collection))
        if message := report_collection_diff(names, collection, first.gateway.id, node.gateway.id):
            raise pytest.UsageError(message)
        self._names = names
        self._collections[node] = collection

    def remove_node(self, node: WorkerController) -> str | None:
        """Take back what a worker that is gone still had; the name of the test that it was at."""
        left = self._unit.pop(node)
        sent = self._sent.pop(node)
        self._collections.pop(node, None)
        left.tests[:0] = sent[1:]
        if left.tests and self._waiting is not None:
            self._waiting.insert(0, left)
        return self._names[sent[0]] if sent else None

    def has_collected(self, node: WorkerController) -> bool:
        return node in self._collections

    def mark_test_complete(
        self, node: WorkerController, item_index: int, duration: float = 0
    ) -> None:
        self._sent[node].remove(item_index)
        self._feed(node)

    def mark_test_pending(self, item: str) -> None:
        raise NotImplementedError

    def remove_pending_tests_from_node(
        self, node: WorkerController, indices: Sequence[int]
    ) -> None:
        raise NotImplementedError

    def schedule(self) -> None:
        if self._waiting is None:
            self._waiting = sorted(self._units(), key=lambda u: (not u.whole, -self._length(u)))
        for ahead in range(1, _AHEAD + 1):
            for node in self._collections:
                self._feed(node, ahead)

    def _length(self, unit: Unit) -> float:
        return sum(self._seconds(self._names[test]) for test in unit.tests)

    def _feed(self, node: WorkerController, ahead: int = _AHEAD) -> None:
        """Send a worker what it needs to go on; the word to end where there is nothing left."""
        if node.shutting_down:
            return
        tests: list[int] = []
        while len(self._sent[node]) + len(tests) < ahead and self._have_unit(node):
            tests.append(self._unit[node].tests.pop(0))
        self._sent[node] += tests
        node.send_runtest_some(tests)
        if len(self._sent[node]) < ahead:
            node.shutdown()

    def _have_unit(self, node: WorkerController) -> bool:
        if not self._unit[node].tests:
            self._unit[node] = self._waiting.pop(0) if self._waiting else self._half_of_anothers()
        return bool(self._unit[node].tests)

    def _half_of_anothers(self) -> Unit:
        """Take the second half of the longest unit that may be taken from."""
        others = [unit for unit in self._unit.values() if unit.tests and not unit.whole]
        if not others:
            return Unit()
        longest = max(others, key=self._length)
        half, taken = self._length(longest) / 2, Unit()
        while longest.tests and self._length(taken) < half:
            taken.tests.insert(0, longest.tests.pop())
        return taken
