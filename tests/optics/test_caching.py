"""What a function keeps for the whole process."""

import torch

from optics.caching import byte_limited_cache
from optics.camera import Camera, Lens, Panel
from optics.camera.pupil import pupil_amplitude


def test_a_result_is_kept_until_the_bytes_run_out():
    calls = []

    @byte_limited_cache(1000)
    def ones(count, *, twice=False):
        calls.append((count, twice))
        return torch.ones(count) * (1 + twice)

    assert ones(100) is ones(100)
    assert not torch.equal(ones(100, twice=True), ones(100))
    assert calls == [(100, False), (100, True)]
    ones(101)
    assert ones(100) is not None
    assert calls == [(100, False), (100, True), (101, False)]
    ones(100, twice=True)
    assert calls[3:] == [(100, True)]


def test_functions_do_not_take_each_others_results():
    one, two = (byte_limited_cache(100)(lambda x, by=by: x * by) for by in (2, 3))
    assert (one(5), two(5), one(5)) == (10, 15, 10)


def test_a_pupil_is_kept_for_all_cameras_with_this_stop_before_this_panel():
    panel, lens = Panel(shape=(24, 32), pitch=40e-6), Lens(f_number=100.0)
    once = pupil_amplitude(Camera(panel, lens))
    assert pupil_amplitude(Camera(Panel((24, 32), 40e-6, unmodulated=0.1), lens)) is once
    assert pupil_amplitude(Camera(panel, Lens(f_number=200.0))).sum() < 0.5 * once.sum()
