"""Patterns that were shown come back bit for bit, as long as they are kept."""

import numpy as np
import pytest

from labapp.common.errors import UserError
from labapp.window.engine.shown_patterns import ShownPatterns
from labapp.window.settings_history import DEPTH


@pytest.fixture
def shown():
    return ShownPatterns("neutral", np.zeros((6, 8), np.uint8))


def test_patterns_come_back_as_they_were(shown):
    rng = np.random.default_rng(1)
    greys = [rng.integers(0, 256, (6, 8), dtype=np.uint8) for _ in range(5)]
    numbers = [shown.keep(f"number {k}", grey) for k, grey in enumerate(greys)]
    for k in reversed(range(5)):
        name, grey = shown.pattern(numbers[k])
        assert name == f"number {k}"
        np.testing.assert_array_equal(grey, greys[k])
    name, grey = shown.pattern(0)
    assert name == "neutral"
    assert not grey.any()


def test_the_same_pattern_again_is_no_other(shown):
    grey = np.full((6, 8), 9, np.uint8)
    first = shown.keep("nine", grey)
    assert shown.keep("nine", grey.copy()) == first
    assert shown.keep("nine of another name", grey) == first + 1


def test_a_pattern_that_is_not_kept_any_more_says_so(shown):
    for level in range(DEPTH + 5):
        number = shown.keep("even", np.full((6, 8), level % 256, np.uint8))
    assert shown.pattern(number)[1][0, 0] == (DEPTH + 4) % 256
    assert shown.pattern(number - DEPTH)[0] == "even"
    with pytest.raises(UserError, match=r"isn't kept any more\. Choose it again"):
        shown.pattern(0)
