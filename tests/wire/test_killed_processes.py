"""A wired bench of which one process is killed in a run: safe at the wires, nothing lost or left.

The figure `killed processes` kills each at 20 states; these are a few of them.
"""

from __future__ import annotations

from pathlib import Path

import pytest
from figures.killed_processes import kill_at_states

pytestmark = [pytest.mark.aravis, pytest.mark.sweep]


def test_a_wired_bench_is_safe_whichever_process_of_it_is_killed(tmp_path: Path) -> None:
    found = kill_at_states(tmp_path, ("application", "camera", "engine"), 2)
    if found is None:
        pytest.skip("the bench can't be served here")
    assert [one.trouble for one in found if one.trouble] == []
    assert sum(one.was_there for one in found) >= 5
