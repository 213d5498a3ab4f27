"""Who runs what, with workers that are simulated: each test takes the time that it is given."""

from __future__ import annotations

from dataclasses import replace
from itertools import count
from types import SimpleNamespace

import pytest

from runner.schedule import Schedule
from runner.units import Unit


class Node:
    """A worker as the scheduler sees it: it begins with a test when it knows the next one."""

    def __init__(self, number):
        self.gateway = SimpleNamespace(id=f"gw{number}")
        self.queue, self.ran, self.shutting_down = [], [], False
        self.began = None
        self.ended = 0.0

    def send_runtest_some(self, tests):
        assert not self.shutting_down
        self.queue += tests

    def shutdown(self):
        self.shutting_down = True

    @property
    def can_begin(self):
        return len(self.queue) >= 2 or bool(self.queue and self.shutting_down)


class Run:
    """A run by two workers, from beginning to end.

    seconds: that each test takes. known: what the scheduler takes them for. deadly: the tests
    that end their worker, who is replaced.
    """

    def __init__(self, units, seconds, known=None, deadly=()):
        known = known or seconds
        self._names = [f"test_{number}" for number in range(len(seconds))]
        self.schedule = Schedule(
            SimpleNamespace(getvalue=lambda name: ["2*popen"]),
            lambda: [replace(unit, tests=list(unit.tests)) for unit in units],
            lambda name: known[self._names.index(name)],
        )
        self.nodes, self.crashed = [], []
        self._add(), self._add()
        self.schedule.schedule()
        now = 0.0
        while ready := [node for node in self.nodes if node.can_begin]:
            for node in ready:
                node.began = now if node.began is None else node.began
            node = min(ready, key=lambda node: node.began + seconds[node.queue[0]])
            test = node.queue.pop(0)
            now = node.ended = node.began + seconds[test]
            node.began = None
            node.ran.append(test)
            if test in deadly:
                self.crashed.append(self.schedule.remove_node(node))
                node.queue.clear()
                self._add()
                self.schedule.schedule()
            else:
                self.schedule.mark_test_complete(node, test)

    def _add(self):
        node = Node(len(self.nodes))
        self.nodes.append(node)
        self.schedule.add_node(node)
        self.schedule.add_node_collection(node, self._names)

    @property
    def ran(self):
        return sorted(test for node in self.nodes for test in node.ran)

    @property
    def difference(self):
        """Seconds between the ends of the two workers."""
        first, second = (node.ended for node in self.nodes)
        return abs(first - second)


def units(*sizes, whole=()):
    """Units of so many tests each."""
    tests = count()
    return [Unit([next(tests) for _ in range(size)], n in whole) for n, size in enumerate(sizes)]


def test_every_test_is_run_once_and_both_workers_end_together():
    run = Run(units(30, 5, 1, 12), [1.0] * 48)
    assert run.ran == list(range(48))
    assert run.schedule.tests_finished
    assert not run.schedule.has_pending
    assert run.difference <= 2


def test_the_longest_are_begun_with():
    run = Run(units(1, 2, 1), [1.0, 5.0, 5.0, 7.0])
    assert {node.ran[0] for node in run.nodes} == {1, 3}


def test_what_belongs_together_is_begun_with_and_stays_together():
    run = Run(units(3, 20, 4, whole={0}), [1.0] * 27)
    (one,) = [node for node in run.nodes if {0, 1, 2} & set(node.ran)]
    assert one.ran[:3] == [0, 1, 2]


def test_nobody_takes_a_part_of_what_belongs_together():
    run = Run(units(20, 2, whole={0}), [1.0] * 22)
    assert sorted(sorted(node.ran) for node in run.nodes) == [list(range(20)), [20, 21]]


def test_what_takes_long_without_anybody_knowing_is_shared():
    """As in a fresh clone: one file is a hundred times slower than any other."""
    seconds = [1.0] * 20 + [100.0] * 20
    run = Run(units(20, 20), seconds, known=[1.0] * 40)
    assert run.difference <= 300


@pytest.mark.parametrize("deadly", [{0}, {5}, {19}, {21}, {0, 1, 2}, {3, 21}, set(range(22))])
@pytest.mark.parametrize("whole", [{0, 1}, set()])
def test_a_test_that_ends_its_worker_is_named_and_run_once_like_all_others(deadly, whole):
    run = Run(units(20, 2, whole=whole), [1.0] * 22, deadly=deadly)
    assert run.ran == list(range(22))
    assert sorted(run.crashed) == sorted(f"test_{test}" for test in deadly)
    assert run.schedule.tests_finished


def test_workers_that_collect_other_tests_are_refused():
    run = Run(units(2), [1.0, 1.0])
    node = Node(7)
    run.schedule.add_node(node)
    with pytest.raises(pytest.UsageError, match="Different tests were collected"):
        run.schedule.add_node_collection(node, ["test_0", "another"])
