"""Counting work, and keeping results within memory."""

import math
import threading

import numpy as np
import pytest
import torch

from optics.caching import ByteCache, result_bytes
from simulator.ledger import Ledger


def test_a_ledger_adds_up_by_effect():
    ledger = Ledger()
    ledger.add("diffraction", 10.0, 100)
    ledger.add("diffraction", 5.0)
    ledger.add("vignetting", 2.5, 7)
    assert ledger.effects_called == {"diffraction", "vignetting"}
    assert (ledger.operations, ledger.bytes) == (17.5, 107)
    assert (ledger.operations_of("diffraction"), ledger.operations_of("occlusion")) == (15.0, 0.0)


def test_threads_share_a_ledger():
    ledger = Ledger()

    def work():
        for _ in range(2000):
            ledger.add("picture", 1.0, 1)

    threads = [threading.Thread(target=work) for _ in range(4)]
    for one in threads:
        one.start()
    for one in threads:
        one.join()
    assert (ledger.operations, ledger.bytes) == (8000, 8000)


@pytest.mark.parametrize("operations", [-1.0, math.nan, math.inf])
def test_a_ledger_refuses_what_no_work_is(operations):
    with pytest.raises(ValueError, match="operations"):
        Ledger().add("picture", operations)


def test_a_ledger_refuses_fewer_bytes_than_none():
    with pytest.raises(ValueError, match="bytes"):
        Ledger().add("picture", 1.0, -1)


def test_what_is_known_is_not_computed_again():
    cache, calls = ByteCache(1 << 20), []

    def compute():
        calls.append(1)
        return torch.ones(10)

    assert cache.get(("a", 1), compute) is cache.get(("a", 1), compute)
    assert len(calls) == 1


def test_the_oldest_goes_first_when_bytes_run_out():
    cache = ByteCache(3 * 400)
    for name in "abc":
        cache.get(name, lambda: torch.zeros(100))
    cache.get("a", lambda: pytest.fail("a is kept"))
    cache.get("d", lambda: torch.zeros(100))
    assert cache.bytes == 1200
    again = []
    cache.get("b", lambda: again.append(1) or torch.zeros(100))
    cache.get("a", lambda: again.append(2) or torch.zeros(100))
    cache.get("d", lambda: pytest.fail("d is kept"))
    assert again[0] == 1


def test_what_is_larger_than_the_cache_is_not_kept_and_drives_nothing_out():
    cache = ByteCache(1000)
    cache.get("small", lambda: torch.zeros(100))
    cache.get("large", lambda: torch.zeros(1000))
    cache.get("small", lambda: pytest.fail("small is kept"))
    assert cache.bytes == 400


def test_a_result_that_two_computed_at_once_counts_once():
    cache = ByteCache(10_000)
    cache.get("a", lambda: cache.get("a", lambda: torch.zeros(100)))
    assert cache.bytes == 400


def test_bytes_of_results():
    assert result_bytes(torch.zeros(3, 5, dtype=torch.complex64)) == 120
    assert result_bytes(np.zeros((2, 2))) == 32
    many = [(0.5, torch.zeros(1000)), (0.5, torch.zeros(1000))]
    assert 8000 <= result_bytes(many) <= 8000 + 8192
    assert result_bytes({"a": torch.zeros(1000)}) >= 4000


def test_clearing_forgets_everything():
    cache, calls = ByteCache(), []
    cache.get("a", lambda: calls.append(1))
    cache.clear()
    cache.get("a", lambda: calls.append(1))
    assert (len(calls), cache.bytes > 0) == (2, True)


def test_a_cache_refuses_a_negative_limit():
    with pytest.raises(ValueError, match="limit"):
        ByteCache(-1)
