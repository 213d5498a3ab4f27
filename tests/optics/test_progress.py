import pytest

from optics.progress import Cancelled, Progress


def test_a_report_reaches_the_listener_within_zero_and_one():
    heard = []
    progress = Progress(lambda f, m: heard.append((f, m)))
    progress.report(0.25, "half of half")
    progress.report(7.0)
    progress.report(-1.0)
    assert heard == [(0.25, "half of half"), (1.0, ""), (0.0, "")]


def test_a_part_reports_its_share_of_the_whole():
    """0.5 of the way from 0.2 to 0.6 is 0.4; a part of a part likewise."""
    heard = []
    part = Progress(lambda f, _: heard.append(f)).part(0.2, 0.6)
    part.report(0.5)
    part.part(0.5, 1.0).report(1.0)
    assert heard == pytest.approx([0.4, 0.6])


def test_cancelling_the_whole_stops_its_parts_and_the_other_way_round():
    whole = Progress()
    part = whole.part(0, 1)
    part.cancel()
    assert whole.is_cancelled
    with pytest.raises(Cancelled):
        whole.report(0.5)
    with pytest.raises(Cancelled):
        part.raise_if_cancelled()
