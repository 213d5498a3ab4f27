"""A run on a real driver whose device is unplugged and plugged in again."""

from labapp.acquisition.state import State
from labapp.figures.unplug import unplugged_run


def test_the_filter_is_named_and_the_run_goes_on(tmp_path):
    run = unplugged_run(tmp_path / "run", 3)
    assert (run.state, run.frames) == (State.COMPLETE, run.asked)
    assert 0 <= run.named <= 1.0
