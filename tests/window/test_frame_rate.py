"""The frame rate is that of the last second, and ages."""

from labapp.window.frame_rate import FrameRate


def counted(moments):
    rate = FrameRate()
    for moment in moments:
        rate.count(moment)
    return rate


def test_a_steady_rate_is_read():
    assert counted([0.02 * n for n in range(200)]).describe(3.98) == "50.0 frames/s"


def test_before_any_frame_nothing_is_said():
    assert FrameRate().describe(5.0) == ""


def test_the_rate_falls_when_no_frame_comes_and_then_says_for_how_long():
    rate = counted([0.1 * n for n in range(21)])
    said = [float(rate.describe(2.0 + late).split()[0]) for late in (0.0, 0.3, 0.6)]
    assert said[0] == 10.0
    assert said[0] > said[1] > said[2]
    assert rate.describe(9.0) == "no frame for 7 s"


def test_a_burst_does_not_count_for_long():
    rate = counted([*[0.001 * n for n in range(100)], 2.0, 2.5])
    assert rate.describe(2.5) == " 2.0 frames/s"
