"""The kept queue by itself: what a file brings back, and what it doesn't."""

import json
from pathlib import Path

import pytest

from labapp.runs.state import State
from labapp.window.commands import AcquireBracket, KeptRequest, ResumeRun, RunPlan
from labapp.window.exposure_bracket import ExposureBracket, SNRBracket
from labapp.window.kept_queue import KeptQueue
from labapp.window.messages import QueueState, RunInfo

RING = {"kind": "ring", "radius_um": 80.0, "width_um": 8.0, "wavelength_nm": 550.0}


def requests(folder):
    star, photograph = ExposureBracket(1, 8, 4), SNRBracket(30, 2)
    return (
        AcquireBracket(RING, 550e-9, star, photograph, folder / "runs", "2026-11-27_090000"),
        RunPlan(folder / "night.toml", folder / "runs", "2026-11-27_090001"),
        ResumeRun(folder / "old.h5", "2026-11-27_090001-2"),
    )


def info(request, state=State.WAITING, path=Path("record.h5")):
    return RunInfo(1, "run", path, state, "", 0, 5, 0.0, 1.0, 0.0, 0.0, None, False, request.ticket)


@pytest.fixture
def opened(tmp_path):
    """Open the file of this test; the one that was open before is closed, as by a killed window."""
    made = []

    def open_(bench="bench"):
        for one in made:
            one.close()
        made.append(KeptQueue(tmp_path / "queue.json", bench))
        return made[-1]

    yield open_
    for one in made:
        one.close()


def test_requests_come_back_in_their_order(opened, tmp_path):
    first = opened()
    for request in requests(tmp_path):
        first.add(request)
    assert [kept.request for kept in opened().requests] == list(requests(tmp_path))


def test_a_request_is_kept_until_its_run_has_ended_or_is_taken_out(opened, tmp_path):
    kept = opened()
    one, two, three = requests(tmp_path)
    for request in (one, two, three):
        kept.add(request)
    # The engine hasn't heard of the third one yet.
    kept.follow(QueueState((info(one, State.RUNNING, tmp_path / "a.h5"), info(two))))
    assert opened().requests == (
        KeptRequest(one, tmp_path / "a.h5"),
        KeptRequest(two, Path("record.h5")),
        KeptRequest(three),
    )
    kept = opened()
    kept.follow(QueueState((info(one, State.RUNNING), info(two), info(three))))
    # The first ends, the second is taken out of the line.
    kept.follow(QueueState((info(one, State.COMPLETE), info(three))))
    assert [k.request for k in opened().requests] == [three]
    opened().drop(three.ticket)
    assert opened().requests == ()


def test_an_engine_that_is_gone_takes_nothing_along(opened, tmp_path):
    kept = opened()
    one, *_ = requests(tmp_path)
    kept.add(one)
    kept.follow(QueueState((info(one, State.RUNNING),)))
    kept.forget_engine()
    kept.follow(QueueState(()))
    assert [k.request for k in kept.requests] == [one]


def test_runs_belong_to_their_bench(opened, tmp_path):
    one, two, _ = requests(tmp_path)
    opened("here").add(one)
    there = opened("there")
    assert there.requests == ()
    there.add(two)
    assert [k.request for k in opened("here").requests] == [one]
    assert [k.request for k in opened("there").requests] == [two]


def test_a_second_window_leaves_the_file_to_the_first(tmp_path):
    file = tmp_path / "queue.json"
    one, two, _ = requests(tmp_path)
    first, second = KeptQueue(file, "bench"), KeptQueue(file, "bench")
    first.add(one)
    second.add(two)
    assert [k.request for k in second.requests] == [two]
    first.close()
    again = KeptQueue(file, "bench")
    assert [k.request for k in again.requests] == [one]
    again.close()


def test_tickets_differ_within_a_second(opened):
    kept = opened()
    tickets = [kept.new_ticket() for _ in range(20)]
    assert len(set(tickets)) == 20


@pytest.mark.parametrize(
    "text",
    [
        "",
        "\x00\xff",
        "[1, 2]",
        '{"runs": 3}',
        json.dumps({"runs": [{"bench": "bench", "kind": "plan", "ticket": "t", "path": ""}]}),
        json.dumps({"runs": [{"bench": "bench", "kind": "feast", "ticket": "t", "path": ""}]}),
        json.dumps(
            {"runs": [{"bench": "bench", "kind": "plan", "ticket": "t", "path": 3, "plan": []}]}
        ),
    ],
)
def test_a_damaged_file_keeps_no_window_from_opening(opened, tmp_path, text):
    (tmp_path / "queue.json").write_text(text)
    kept = opened()
    assert kept.requests == ()
    kept.add(requests(tmp_path)[0])
    assert len(opened().requests) == 1


def test_a_place_that_cannot_be_written_is_no_obstacle(tmp_path):
    (tmp_path / "file").write_text("")
    kept = KeptQueue(tmp_path / "file" / "queue.json", "bench")
    kept.add(requests(tmp_path)[0])
    assert len(kept.requests) == 1
