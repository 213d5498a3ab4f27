"""Memory that a test has freed is the system's again before the next test."""

from __future__ import annotations

from runner import heap
from runner.heap import Heap, resident


def test_what_was_freed_below_something_that_stays_is_given_back(monkeypatch):
    """Pieces that are too small for maps of their own, of which the last one stays."""
    pieces = [bytes(1 + number % 2) * 50_000 for number in range(4000)]
    held = resident()
    stays = pieces.pop()
    pieces.clear()
    monkeypatch.setattr(heap, "_MUCH", 0)
    Heap().pytest_runtest_logfinish()
    assert resident() < held - 100_000_000
    assert stays


def test_little_is_left_alone(monkeypatch):
    def refuse() -> None:
        raise AssertionError("memory was given back")

    monkeypatch.setattr(heap, "give_back_freed_memory", refuse)
    monkeypatch.setattr(heap, "_MUCH", 1 << 50)
    Heap().pytest_runtest_logfinish()


def test_what_stays_is_not_looked_at_after_every_test(monkeypatch):
    looked = []
    monkeypatch.setattr(heap, "give_back_freed_memory", lambda: looked.append(resident()))
    monkeypatch.setattr(heap, "_MUCH", 10_000_000)
    plugin = Heap()
    for _ in range(3):
        plugin.pytest_runtest_logfinish()
    assert len(looked) == 1
