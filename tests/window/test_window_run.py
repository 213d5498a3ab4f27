"""Acquire, cancel, reconstruct: by clicks, down to the file."""

from pathlib import Path

import pytest
from plan_files import LONG, write_plan
from PySide6.QtCore import Qt

from labapp.runs.record.reader import Record
from labapp.runs.state import State
from labapp.window.messages import CancelAcknowledged, ReconstructionResult, RunEnded


def set_bracket(person, row, shortest, ratio, count):
    person.types(row.shortest, shortest)
    person.types(row.ratio, ratio)
    person.types(row.count, count)


def acquire_small(bench, person):
    """A bracket of 14 frames with an axicon; how it ended."""
    bench.reports.clear()
    set_bracket(person, bench.window.run.star, "8", "8", "2")
    set_bracket(person, bench.window.run.photograph, "400", "2", "1")
    person.chooses(bench.window.pattern.form.kind, "Axicon")
    person.types(bench.window.pattern.form.numbers["axicon", "radius_um"], "30")
    person.presses(Qt.Key.Key_F6)
    person.waits(lambda: bench.last(RunEnded) is not None)
    return bench.last(RunEnded)


def test_exposures_are_listed_before_they_are_taken(bench, person):
    run = bench.window.run
    set_bracket(person, run.star, "1", "8", "4")
    set_bracket(person, run.photograph, "100", "4", "3")
    assert run.star.exposures_label.text() == "1  8  64  512 ms"
    assert run.photograph.exposures_label.text() == "100  400  1600 ms"
    assert run.summary.text().startswith("50 frames, 1 MB: 28 dark, 16 star and 6 photograph")
    # Of 64 x 96 pixels and 2 bytes; each of the exposures is taken of the dark, too.
    set_bracket(person, run.star, "1", "1.1", "12")
    set_bracket(person, run.photograph, "100", "1.1", "12")
    assert run.summary.text().startswith("168 frames, 2 MB: 96 dark, 48 star and 24 photograph")


def test_exposures_are_chosen_for_a_ratio(bench, person):
    """The star's by its ratio, the photograph's as listed; what was chosen is in the record."""
    run = bench.window.run
    person.clicks(run.star.chosen)
    assert not run.star.shortest.isVisible()
    person.types(run.star.snr, "24")
    person.types(run.star.decades, "2")
    set_bracket(person, run.photograph, "400", "2", "1")
    assert run.star.exposures_label.text() == "chosen by metering, in the run"
    assert run.summary.text().startswith("As many exposures as the metered light needs")
    person.chooses(bench.window.pattern.form.kind, "Axicon")
    person.types(bench.window.pattern.form.numbers["axicon", "radius_um"], "30")
    bench.reports.clear()
    person.presses(Qt.Key.Key_F6)
    person.waits(lambda: bench.last(RunEnded) is not None)
    ended = bench.last(RunEnded)
    assert (ended.state, ended.message) == ("COMPLETE", "")
    person.waits(lambda: bench.states[-1] == "COMPLETE")
    person.clicks(run.star.chosen)
    assert run.star.shortest.isVisible()
    with Record(ended.path) as record:
        _, star, photograph = record.plan.acquire
        assert star.chosen.wanted.snr_db == 24
        assert star.chosen.wanted.decades == 2
        assert photograph.exposures_ms == (400,)
        shown = bench.runs[-1]
        assert (shown.stored_frames, shown.planned_frames) == (record.frame_count,) * 2
        assert (
            record.frame_count == 4 + 4 * len(set(star.exposures_ms)) + 2 * star.chosen.frames + 2
        )


def test_a_bracket_is_acquired_and_reconstructed(bench, person):
    ended = acquire_small(bench, person)
    assert ended.state == "COMPLETE"
    person.waits(lambda: bench.window.run.bar.value() == bench.window.run.bar.maximum())
    assert Path(ended.path).parent == Path(bench.window.run.folder.text())
    person.waits(lambda: bench.states[-1] == "COMPLETE")
    run = bench.runs[-1]
    assert (run.stored_frames, run.planned_frames, run.path) == (22, 22, ended.path)
    # The virtual bench takes exactly what was planned.
    assert ended.bench_seconds == pytest.approx(run.expected_bench_seconds)
    # One clock, that on the wall; the bench's own is in the tip.
    times = bench.window.run.times
    assert times.text().startswith("took ")
    assert times.toolTip() == "By the virtual bench's clock: expected 3 s, took 3 s"
    assert bench.window.run.bar.text() == "22 of 22 frames"
    with Record(ended.path) as record:
        assert record.state is State.COMPLETE
        assert record.missing_frames() == []
        assert record.frame_count == 3 * 4 + 2 * 2 * 2 + 2
        assert record.plan.reconstruct.coded == "axicon 30 µm for 550 nm"
        assert set(record.simulated_devices) == {"slm", "filter", "camera", "targets"}
    # The person's own settings are back, and the picture is live.
    person.waits(lambda: bench.frame.target == "photograph" and bench.frame.exposure == 0.4)

    view, beside = bench.window.reconstruction, bench.window.side_by_side
    gained = reconstruct(bench, person, "Total variation")
    person.waits(lambda: bench.window.tabs.currentWidget() is view)
    assert f"PSNR {gained[0]:.1f} to {gained[1]:.1f} dB" in view.note.text()
    bench.window.tabs.setCurrentWidget(beside)
    assert "by another method" in beside.titles["earlier"].text()
    lucy = reconstruct(bench, person, "Richardson-Lucy")
    assert bench.window.tabs.currentWidget() is beside
    shown = {"coded": lucy[0], "earlier": gained[1], "after": lucy[1]}
    for name, psnr in shown.items():
        assert f"{psnr:.1f} dB" in beside.titles[name].text()
        person.waits(lambda one=beside.pictures[name]: person.looks_at(one).std() > 10)
    assert "Total variation" in beside.titles["earlier"].text()
    assert "Richardson-Lucy" in beside.titles["after"].text()
    assert lucy[1] > lucy[0]


def reconstruct(bench, person, method):
    """PSNR before and after, as the engine told."""
    bench.reports.clear()
    person.chooses(bench.window.reconstruction.method, method)
    person.presses(Qt.Key.Key_F7)
    person.waits(lambda: bench.last(ReconstructionResult) is not None)
    person.waits(bench.window.actions_["reconstruct"].isEnabled)
    return [psnr for psnr, _ in bench.last(ReconstructionResult).scores]


def test_zoom_is_linked(bench, person):
    pictures = bench.window.side_by_side.pictures
    pictures["after"].box.setRange(xRange=(20, 40), yRange=(20, 36), padding=0)
    zoomed = pictures["after"].box.viewRange()
    for picture in pictures.values():
        for range_, wanted in zip(picture.box.viewRange(), zoomed, strict=True):
            assert range_ == pytest.approx(wanted, abs=2.4)


def test_a_cancelled_run_says_so_in_its_file_and_leaves_the_bench_safe(
    bench, person, chosen_file, tmp_path
):
    chosen_file(write_plan(tmp_path, "Too long", repeats=LONG))
    bench.window.actions_["plan"].trigger()
    person.waits(lambda: bench.frame.target == "dark")
    assert not bench.window.settings.target.isEnabled()
    assert not bench.window.pattern.show_button.isEnabled()
    # What the devices are set to is read back during the run, too.
    person.waits(lambda: bench.window.settings.target_read.text() == "≠ dark")
    person.clicks(bench.window.bar.buttons["cancel"])
    person.clicks(bench.window.question.yes_button)
    person.waits(lambda: bench.last(RunEnded) is not None)
    assert bench.last(CancelAcknowledged) is not None
    ended = bench.last(RunEnded)
    assert ended.state == "CANCELLED"
    with Record(ended.path) as record:
        assert record.state is State.CANCELLED
        assert 0 < len(record.missing_frames()) == ended.missing_frames < record.frame_count
    devices = bench.window.devices
    person.waits(lambda: "stopped" in devices.text("camera"))
    assert "neutral" in devices.text("slm")
    assert "420.00 nm" in devices.text("filter")
    assert "cancelled" in bench.window.message.text
    assert not bench.window.actions_["live"].isChecked()


def test_a_folder_that_cannot_be_made_is_an_error_in_words(bench, person, tmp_path):
    (tmp_path / "file").write_text("not a folder")
    run, kept = bench.window.run, bench.window.run.folder.text()
    person.types(run.folder, str(tmp_path / "file" / "runs"))
    person.chooses(bench.window.pattern.form.kind, "Axicon")
    person.presses(Qt.Key.Key_F6)
    person.waits(lambda: bench.window.message.is_error)
    assert "Not a directory. Choose another place" in bench.window.message.text
    person.waits(bench.window.actions_["acquire"].isEnabled)
    person.types(run.folder, kept)


def test_a_neutral_pattern_is_no_coding(bench, person):
    person.presses(Qt.Key.Key_F6)
    person.waits(lambda: bench.window.message.is_error)
    assert "Choose another pattern" in bench.window.message.text
    person.waits(bench.window.actions_["acquire"].isEnabled)
