"""`labapp accuracy simulate`: five tolerances and everything on, in a table and as JSON."""

import json
from itertools import pairwise

from labapp.accuracy.simulate import TOLERANCES


def test_each_tolerance_is_kept_and_the_last_row_is_everything(tiny, labapp):
    code, printed, complaint = labapp(
        "accuracy", "simulate", tiny.scene, "--bench", tiny.bench, "--target", "star",
        "--exposure-ms", "20", "--json",
    )  # fmt: skip
    assert code == 0, complaint
    rows = json.loads(printed)["rows"]
    assert [row["tol"] for row in rows] == [*TOLERANCES, None]
    for row in rows[:-1]:
        assert max(row["mean"], row["variance"], row["sigma"]) <= row["tol"]
        assert row["told"] <= row["tol"]
    work = [row["work"] for row in rows]
    assert all(first <= second * 1.001 for first, second in pairwise(work))
    assert rows[-1]["left_out"] == rows[-1]["mean"] == 0
    less = [row["left_out"] for row in rows]
    assert less == sorted(less, reverse=True)


def test_without_a_bench_a_small_one_is_taken(labapp):
    code, printed, complaint = labapp("accuracy", "simulate", "--target", "dark")
    assert code == 0, complaint
    flat = " ".join(printed.split())
    for words in ("dark at 550 nm", "64 x 43 pixels", "told", "all on", "counted"):
        assert words in flat


def test_what_cannot_be_asked_is_said_in_words(tiny, labapp):
    ask = ("accuracy", "simulate", tiny.scene, "--bench", tiny.bench)
    code, _, complaint = labapp(*ask, "--target", "moon")
    assert code == 1
    assert "moon" in complaint
    code, _, complaint = labapp("accuracy", "simulate", tiny.folder / "none.toml")
    assert code == 1
    assert "none.toml" in complaint
