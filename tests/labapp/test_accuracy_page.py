"""`labapp accuracy` without a name: one page that says of every operation what was measured."""

from __future__ import annotations

import json
import math
import os
import re
from dataclasses import replace
from html import escape
from html.parser import HTMLParser

import numpy as np
import pytest

from labapp.accuracy.diagram import draw
from labapp.accuracy.overview.cases import OverviewSettings, Scope, chain_case
from labapp.accuracy.overview.measured import MeasuredOperation, Outcome
from labapp.accuracy.overview.measuring import measure_all, write_outcome
from labapp.accuracy.overview.operations import OPERATIONS, Operation
from labapp.accuracy.overview.page import page_html
from labapp.accuracy.reading import (
    EACH_CALL,
    FIRST_ANSWER,
    cheapest_row,
    failure_sentences,
    format_error,
    format_seconds,
    next_decimal_sentences,
)
from labapp.accuracy.work_precision import (
    AUTOMATIC,
    CUT,
    Candidate,
    Deadline,
    PlannedCall,
    Row,
    mark_front,
    measure,
)
from labapp.common.errors import UserError
from optics.accuracy import Budget
from optics.camera import Camera, Lens, Panel, Sensor
from optics.progress import Cancelled, Progress

SMALL = OverviewSettings(
    least_tolerance=1e-3, window=12, chain_window=6, chain_panel="16x24x8", field_size=180,
    picture_size=32, retrieval_s=1e-3, edof_panel="54x96x16", edof_steps=2,
)  # fmt: skip


@pytest.fixture
def quick(monkeypatch, few_field_samples):
    monkeypatch.setattr("labapp.accuracy.work_precision._REPEATS", 1)
    monkeypatch.setattr("labapp.accuracy.work_precision._LEAST_S", 1e-4)
    monkeypatch.setattr("labapp.accuracy.deconvolve._SHORT_S", 0.0)
    monkeypatch.setattr("labapp.accuracy.retrieval._SHORT_S", 0.0)
    monkeypatch.setattr("labapp.accuracy.hdr._SHORT_S", 0.0)
    monkeypatch.setattr("labapp.accuracy.multispectral._SHORT_S", 0.0)
    monkeypatch.setattr("labapp.accuracy.edof_psf._SHORT_S", 0.0)
    monkeypatch.setattr("labapp.accuracy.edof_design.RATED_DEPTHS", 4)
    monkeypatch.setattr("optics.edof.pattern_search.RATED_DEPTHS", 4)
    monkeypatch.setattr("labapp.accuracy.multispectral._COUNTS", (2, 4))
    monkeypatch.setattr("labapp.accuracy.multispectral._PUBLISHED_COUNTS", (2,))
    # Where the parts of a diagram lie isn't seen here, and takes half of the time.
    monkeypatch.setattr("labapp.accuracy.diagram.ConstrainedLayoutEngine", lambda rect: None)


def small_camera(separation: float = 0.0) -> Camera:
    return Camera(
        Panel((24, 32), 8e-6, unmodulated=0.0),
        Lens(0.05, 32.0, 2.0),
        Sensor((20, 21), 3.45e-6),
        separation=separation,
    )


def wide_camera() -> Camera:
    """Of which a PSF with a ring can be asked."""
    return Camera(Panel((48, 64), 80e-6), Lens(0.125, 25.0, 2.0), Sensor((20, 21), 3.45e-6))


def operations(*names: str) -> list[Operation]:
    return [one for one in OPERATIONS if one.name in names]


def row(method: str, tol: float | None, error: float, call: float, first: float, **more) -> Row:
    return Row(
        "test", "case", method, "float64", tol, error_achieved=error, error_predicted=error,
        cpu_s=call, first_answer_s=first, engine=method, peak_bytes=1000, **more,
    )  # fmt: skip


ROWS = mark_front(
    [
        row("quick", 1e-1, 3e-2, 1e-3, 2e-3, chosen_for=(1, 100)),
        row("quick", 1e-2, 4e-3, 2e-3, 9e-3, chosen_for=(1,)),
        row("quick", 1e-3, 5e-4, 5e-3, 1.4e-2, chosen_for=(1,)),
        row("exact", 1e-2, 1e-9, 1.5e-3, 0.5, chosen_for=(100,)),
        row("exact", 1e-3, 1e-9, 4e-3, 0.5, chosen_for=(100,)),
        Row("test", "case", "shy", "float64", 1e-3, failure="tol 0.001 can't be kept"),
        Row("test", "case", "shy", "float64", 1e-4, failure="tol 0.0001 can't be kept"),
    ]
)


class Tables(HTMLParser):
    """The cells of all tables of a page, and the text that is outside them."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.rows: list[list[str]] = []
        self.ids: list[str] = []
        self._in_cell = False
        self.feed(page)

    def handle_starttag(self, tag, attrs):
        self.ids += [value for name, value in attrs if name == "id"]
        if tag == "tr":
            self.rows.append([])
        if tag == "td":
            self.rows[-1].append("")
            self._in_cell = True

    def handle_endtag(self, tag):
        self._in_cell = self._in_cell and tag != "td"

    def handle_data(self, data):
        if self._in_cell:
            self.rows[-1][-1] += data


def outcome_of(rows) -> Outcome:
    one = MeasuredOperation("lens", "A lens", "What it is.", "case", "error", rows, 1.0)
    return Outcome("a machine", "bundled cases", [one], [], 2.0, cancelled=False)


@pytest.mark.usefixtures("quick")
def test_the_page_has_every_operation_and_the_numbers_of_its_data(tmp_path, monkeypatch):
    monkeypatch.setattr("labapp.accuracy.overview.cases.read_camera", lambda _: wide_camera())
    monkeypatch.setattr("labapp.accuracy.simulate.TOLERANCES", (1e-1, 1e-2))
    apart = small_camera(0.05)
    monkeypatch.setattr(
        "labapp.accuracy.overview.operations.chain_case",
        lambda scope: chain_case(replace(scope, camera=apart)),
    )
    said: list[str] = []
    progress = Progress(lambda part, words: said.append(words))
    quickly = replace(SMALL, operation_s=20.0, least_tolerance=1e-2)
    outcome = measure_all(None, "bundled cases", progress, quickly)
    write_outcome(outcome, tmp_path / "made" / "here")
    page = (tmp_path / "made/here/accuracy.html").read_text()
    data = json.loads((tmp_path / "made/here/accuracy.json").read_text())
    names = [one.name for one in OPERATIONS]
    assert names == [
        "chain", "panel", "lens", "edof-psf", "propagate", "simulate", "retrieval", "edof-design",
        "hdr", "deconvolve", "multispectral",
    ]  # fmt: skip
    assert [one["name"] for one in data["operations"]] == names
    assert data["left_out"] == []
    cells = Tables(page)
    assert set(names) <= set(cells.ids)
    assert len(cells.ids) == len(set(cells.ids))
    for one in data["operations"]:
        assert any(one["title"] in words for words in said)
        assert escape(one["what"]) in page
        assert all(
            kind["words"] in page.replace("&#x27;", "'") for kind in one["cheapest"].values()
        )
        for number in one["table"]:
            shown = one["rows"][number]
            wanted = {format_error(shown["error_achieved"]), format_seconds(shown["cpu_s"])}
            assert any(wanted <= set(line) for line in cells.rows)
    # Nothing is loaded from elsewhere.
    assert not re.findall(r'(?:src|href)="(?!#)[^"]*"', page.replace('xlink:href="#', 'href="#'))
    assert page.count("<svg") == len(names)


def pareto(points: list[tuple[float, float]]) -> set[tuple[float, float]]:
    """Points that no other one beats in both: after sorting by time, each new least error."""
    return {
        point
        for point in points
        if not (np.array([(t < point[0]) and (e < point[1]) for t, e in points])).any()
    }


@pytest.mark.usefixtures("quick")
def test_front_cheapest_and_choice_are_what_they_say():
    outcome = measure_all(
        small_camera(), "a camera", Progress(), SMALL, operations("panel", "propagate")
    )
    for one in outcome.as_data()["operations"]:
        rows = [r for r in one["rows"] if not r["failure"]]
        for time, mark in (("cpu_s", "on_front"), ("first_answer_s", "on_first_front")):
            best = pareto([(r[time], r["error_achieved"]) for r in rows])
            for r in rows:
                assert r[mark] == ((r[time], r["error_achieved"]) in best)
        for kind, time in ((FIRST_ANSWER.name, "first_answer_s"), (EACH_CALL.name, "cpu_s")):
            named = one["rows"][one["cheapest"][kind]["row"]]
            least = min(r[time] for r in rows if r["error_achieved"] <= 1e-3)
            assert named["error_achieved"] <= 1e-3
            assert named[time] <= 1.1 * least
            assert named["method"] in one["cheapest"][kind]["words"] or named["engine"]
        for tol in {r["tol"] for r in rows}:
            for calls in (1, 100):
                assert sum(calls in r["chosen_for"] for r in rows if r["tol"] == tol) == 1


def test_the_cheapest_setting_and_the_next_decimal_are_read_from_the_right_time():
    assert cheapest_row(ROWS, FIRST_ANSWER) is ROWS[2]
    assert cheapest_row(ROWS, EACH_CALL) is ROWS[3]
    assert cheapest_row(ROWS, EACH_CALL, 1e-12) is None
    assert next_decimal_sentences(ROWS, FIRST_ANSWER) == [
        "from 1e-1 to 1e-2: 4.5 times the time",
        "from 1e-2 to 1e-3: 1.6 times the time",
    ]
    assert next_decimal_sentences(ROWS, EACH_CALL) == [
        "from 1e-1 to 1e-2: 1.5 times the time",
        "from 1e-2 to 1e-3: 2.7 times the time",
    ]


def test_decimals_that_cost_nothing_are_joined():
    times = (1.0, 1.0, 1.05, 1.0, 3.0)
    rows = [
        row("any", 10.0**-k, 1e-9, time, time, chosen_for=(100,))
        for k, time in enumerate(times, start=1)
    ]
    assert next_decimal_sentences(rows, EACH_CALL) == [
        "from 1e-1 to 1e-4: about the same time",
        "from 1e-4 to 1e-5: 3 times the time",
    ]


def test_times_that_differ_by_scatter_only_are_the_automatic_choices():
    rows = mark_front(
        [row("a", 1e-2, 1e-5, 1.00, 1), row("b", 1e-3, 1e-5, 1.02, 1, chosen_for=(100,))]
    )
    assert cheapest_row(rows, EACH_CALL) is rows[1]
    slower = [rows[0], replace(rows[1], cpu_s=1.15)]
    assert cheapest_row(slower, EACH_CALL) is slower[0]


def test_of_settings_as_quick_the_largest_tolerance_is_the_cheapest():
    rows = mark_front([row("a", 1e-4, 1e-5, 1.00, 1), row("a", 1e-2, 1e-5, 1.05, 1)])
    assert cheapest_row(rows, EACH_CALL) is rows[1]


def test_failures_of_one_reason_are_one_sentence():
    assert failure_sentences(ROWS) == [
        "shy gives no answer (tol 1e-3 to 1e-4): tol 0.001 can't be kept."
    ]
    cut = [replace(ROWS[0], failure=CUT), replace(ROWS[3], failure=CUT)]
    assert failure_sentences(cut)[0].startswith("quick and exact are not measured: the time")


def test_a_page_says_what_is_cut_cancelled_or_left_out():
    outcome = outcome_of([*ROWS, replace(ROWS[6], failure=CUT)])
    assert f"Shy is {CUT} (tol 1e-4)." in page_html(outcome)
    data = outcome.as_data()["operations"][0]
    assert data["cut"] == ["shy, 1e-4"]
    assert json.dumps(data, allow_nan=False)
    assert "cancelled" in page_html(replace(outcome, cancelled=True))


def test_a_method_without_a_setting_is_drawn_as_well():
    other = replace(ROWS[0], method="another library", tol=None, engine="", chosen_for=())
    assert draw("a case", [*ROWS, other]).axes[-1].get_title(loc="left").startswith("another")


def test_numbers_that_are_not_finite_are_null():
    data = outcome_of([*ROWS, replace(ROWS[5], error_predicted=math.inf)]).as_data()
    assert data["operations"][0]["rows"][-1]["error_predicted"] is None


@pytest.mark.usefixtures("quick")
@pytest.mark.parametrize("how", [Cancelled, KeyboardInterrupt])
def test_cancelling_keeps_what_was_measured(how):
    progress = Progress()

    def cancel(*_):
        progress.cancel()
        raise how

    second = replace(operations("panel")[0], measure=cancel)
    outcome = measure_all(
        None, "bundled cases", progress, SMALL, [*operations("propagate"), second]
    )
    assert [one.name for one in outcome.operations] == ["propagate"]
    assert [(one.name, one.why) for one in outcome.left_out] == [("panel", "cancelled")]
    assert outcome.cancelled
    with pytest.raises(Cancelled):
        measure_all(None, "bundled cases", progress, SMALL, operations("propagate"))


def test_a_camera_whose_exact_light_takes_too_long_is_named():
    settings = replace(SMALL, most_products=1e3)
    asked = measure_all(small_camera(), "a camera", Progress(), settings, operations("panel"))
    assert not asked.operations
    assert "exact integral of this camera" in asked.left_out[0].why


@pytest.mark.usefixtures("quick")
def test_a_cameras_own_operations_are_measured_and_the_others_named():
    both, rough = operations("panel", "chain"), replace(SMALL, least_tolerance=1e-2)
    flat = measure_all(small_camera(), "a camera", Progress(), rough, both)
    assert [one.name for one in flat.operations] == ["panel"]
    assert "plane of its lens" in flat.left_out[0].why
    apart = measure_all(small_camera(0.05), "a camera", Progress(), rough, both)
    assert [one.name for one in apart.operations] == ["chain"]
    assert "50 mm before 50 mm f/32" in apart.operations[0].case
    assert "stands apart" in apart.left_out[0].why


def test_the_first_case_is_the_thesis_camera_smaller_with_its_angles():
    found = chain_case(Scope(Budget(), settings=SMALL)).problem
    camera = found.camera
    assert found.integrate
    assert camera.panel.shape == (16, 24)
    assert camera.lens.f_number == 5.6
    smaller = 24 / 1920
    assert camera.lens.focal_length == pytest.approx(0.1 * smaller)
    assert camera.separation == pytest.approx(0.05 * smaller)


def test_an_operation_that_fails_is_left_out_with_its_reason():
    def refuse(*_):
        raise UserError("the exact integral takes too long.")

    failing = replace(OPERATIONS[0], measure=refuse)
    outcome = measure_all(None, "bundled cases", Progress(), SMALL, [failing])
    assert outcome.left_out[0].why == "the exact integral takes too long"
    assert "the exact integral takes too long" in page_html(outcome)


def test_what_is_left_at_the_deadline_is_cut_and_named():
    one = Candidate(ROWS[0], lambda: PlannedCall(lambda: np.ones(2), 16))
    found = measure([one], np.ones(2), Progress(), deadline=Deadline(0.0)).rows
    assert [r.failure for r in found] == [CUT]


def test_a_choice_that_no_named_method_makes_is_a_row_of_its_own():
    automatic = Candidate(
        replace(ROWS[0], method=AUTOMATIC, engine="", chosen_for=()),
        lambda: PlannedCall(lambda: np.ones(2), 16),
        calls=1,
    )
    (found,) = measure([automatic], np.ones(2), Progress()).rows
    assert (found.method, found.chosen_for) == (AUTOMATIC, (1,))


def test_the_command_writes_both_files(labapp, tmp_path, monkeypatch, quick):
    monkeypatch.setattr(
        "labapp.accuracy.overview.measuring.OverviewSettings", lambda: SMALL, raising=True
    )
    monkeypatch.setattr(
        "labapp.accuracy.overview.measuring.OPERATIONS", operations("propagate"), raising=True
    )
    folder = tmp_path / "accuracy"
    code, printed, said = labapp("accuracy", "--out", folder)
    assert code == 0
    assert "Cheapest" in printed
    assert (folder / "accuracy.html").exists()
    assert f"wrote {folder / 'accuracy.json'}" in said


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--out", "FILE"], "is a file"),
        (["--out", "FULL"], "--force"),
        (["--camera", "none.toml"], "none.toml"),
        (["everything"], "everything"),
        (["--force", "list"], "--force: before a name"),
    ],
)
def test_bad_input_is_refused_by_name(labapp, tmp_path, words, said):
    (tmp_path / "file").write_text("")
    (tmp_path / "accuracy.html").write_text("precious")
    places = {"FILE": tmp_path / "file", "FULL": tmp_path}
    code, _, complaint = labapp("accuracy", *(places.get(word, word) for word in words))
    assert code
    assert said in complaint


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_a_folder_that_may_not_be_written_to_is_refused(labapp, tmp_path):
    tmp_path.chmod(0o500)
    code, _, complaint = labapp("accuracy", "--out", tmp_path / "new")
    assert code == 1
    assert "may not be written to" in complaint
