"""Hardware moves only on purpose, and what was moved can be taken back."""

import random

import numpy as np
import pytest
from figures.window_gestures import Hand, Settings, Watch, arrow_place
from plan_files import ASKS, LONG, write_plan
from PySide6.QtCore import QPoint, Qt
from PySide6.QtWidgets import QAbstractButton, QAbstractSpinBox, QCheckBox, QComboBox
from waits import wait_until
from window_scene import write_bench

from labapp.window.messages import CancelAcknowledged, PatternPreview

NAMES = ["dark", "flat", "star", "photograph"]
MANUAL = f'driver = "manual-targets"\noptions = {{ names = {NAMES}, settling_ms = 0.0 }}'


@pytest.fixture
def hand(bench, person):
    """The person's hand at the shared window, which is active."""
    bench.window.activateWindow()
    person.waits(bench.window.isActiveWindow)
    return Hand(bench.window)


@pytest.fixture
def watch(bench, hand):
    seen = Watch(bench.window, bench.connection)
    yield seen
    seen.close()


def middle(widget):
    return widget.mapTo(widget.window(), widget.rect().center())


def test_stray_gestures_move_nothing(bench, hand, watch, person):
    before, rng = watch.seen, random.Random(11)
    for _ in range(50):
        hand.stray(rng)
    hand.closes_lists()
    person.waits(lambda: watch.seen == before)
    assert watch.moves == []
    bench.window.actions_["reset"].trigger()


def test_settings_that_are_meant_are_obeyed_and_undone(bench, hand, watch, person):
    settings = Settings(hand, random.Random(4))
    for way in settings.ways:
        before = watch.seen
        person.waits(way())
        if watch.seen != before:
            hand.presses(Qt.Key.Key_Z, ctrl=True)
            person.waits(lambda old=before: watch.seen == old)


def test_the_wheel_over_a_field_changes_nothing(bench, hand, watch):
    window = bench.window
    fields = [*window.findChildren(QAbstractSpinBox), *window.findChildren(QComboBox)]
    seen = [field for field in fields if field.isVisible() and field.isEnabled()]
    assert len(seen) > 8
    before = [shown(field) for field in seen]
    for field in seen:
        hand.turns(middle(field), 1)
        hand.turns(middle(field), -2)
    assert [shown(field) for field in seen] == before
    assert watch.moves == []


def shown(field):
    return field.currentText() if isinstance(field, QComboBox) else field.text()


def test_no_field_or_button_is_left_without_the_guard(bench):
    window = bench.window
    for field in [*window.findChildren(QAbstractSpinBox), *window.findChildren(QComboBox)]:
        assert field.focusPolicy() == Qt.FocusPolicy.StrongFocus, field
    for button in window.findChildren(QAbstractButton):
        if not isinstance(button, QCheckBox):
            assert button.focusPolicy() == Qt.FocusPolicy.TabFocus, button.text()


def test_a_number_is_set_by_enter_alone(bench, hand, watch, person):
    field, read = bench.window.settings.exposure, bench.window.settings.exposure_read
    amber = np.array([0xD0, 0xA0, 0x2C])
    hand.clicks(field)
    hand.presses(Qt.Key.Key_A, ctrl=True)
    for letter in "125":
        hand.presses(getattr(Qt.Key, f"Key_{letter}"))
    person.waits(lambda: (np.abs(person.looks_at(field) - amber).max(axis=2) < 30).any())
    assert watch.moves == []
    hand.presses(Qt.Key.Key_Escape)
    assert (field.text(), watch.moves) == ("400.000 ms", [])
    hand.presses(Qt.Key.Key_Up)
    assert field.text() != "400.000 ms"
    # A click elsewhere leaves the field.
    hand.clicks(bench.window.live_view)
    assert (field.text(), watch.moves) == ("400.000 ms", [])
    hand.types(field, "125")
    person.waits(lambda: read.text() == "125.000 ms")
    assert watch.moves == ["SetExposure"]
    # The field is left, so that the next key is for nothing.
    hand.presses(Qt.Key.Key_Up)
    hand.presses(Qt.Key.Key_Return)
    assert watch.moves == ["SetExposure"]


def test_a_drag_over_an_arrow_a_list_or_a_button_does_nothing(bench, hand, watch):
    window = bench.window
    for field in (window.settings.wavelength, window.settings.exposure):
        start = field.mapTo(window, arrow_place(field, up=True))
        hand.drags(start, start + QPoint(-60, 20))
    for widget in (window.settings.target, window.pattern.show_button):
        hand.drags(middle(widget) - QPoint(30, 0), middle(widget) + QPoint(30, 0))
    assert watch.moves == []
    assert not window.settings.target.view().isVisible()


def test_letters_in_a_list_are_for_the_list(bench, hand, person):
    window, kind = bench.window, bench.window.pattern.form.kind
    kind.setFocus()
    before = {name: window.actions_[name].isChecked() for name in ("why", "marks", "contrast")}
    for key in (Qt.Key.Key_C, Qt.Key.Key_A, Qt.Key.Key_W):
        hand.presses(key)
    assert {name: window.actions_[name].isChecked() for name in before} == before
    # Where nothing takes them, they are the window's.
    window.setFocus()
    hand.presses(Qt.Key.Key_C)
    assert window.actions_["marks"].isChecked() is not before["marks"]
    hand.presses(Qt.Key.Key_C)


def test_cancel_asks_once_and_keeps_what_was_taken(bench, person, chosen_file, tmp_path):
    chosen_file(write_plan(tmp_path, "Asked", top=ASKS, targets='["dark", "near"]', repeats=3))
    window, question = bench.window, bench.window.question
    window.actions_["plan"].trigger()
    person.waits(lambda: window.prompt_bar.is_asking)
    person.presses(Qt.Key.Key_Escape)
    assert question.text.startswith("Cancel Asked? 6 of 12 frames are stored and kept")
    person.waits(lambda: question.yes_button.isVisible())
    # Another Esc, Enter in a hurry, and Space don't cancel.
    person.presses(Qt.Key.Key_Escape)
    assert question.text == ""
    person.presses(Qt.Key.Key_Escape)
    person.presses(Qt.Key.Key_Space)
    assert (bench.last(CancelAcknowledged), bench.states[-1]) == (None, "PAUSED")
    person.clicks(question.no_button)
    assert question.text == ""
    person.presses(Qt.Key.Key_Escape)
    Hand(window).presses(Qt.Key.Key_Return, ctrl=True)
    person.waits(lambda: bench.states[-1] == "CANCELLED")
    assert (question.text, bench.runs[-1].stored_frames) == ("", 6)


def test_a_question_about_a_run_goes_with_the_run(bench, person, chosen_file, tmp_path):
    chosen_file(write_plan(tmp_path, "Not cancelled", repeats=LONG // 4))
    bench.window.actions_["plan"].trigger()
    person.waits(lambda: bench.stored > 0)
    person.presses(Qt.Key.Key_Escape)
    assert bench.window.question.text.startswith("Cancel Not cancelled?")
    person.waits(lambda: bench.states[-1] == "COMPLETE")
    person.waits(lambda: bench.window.question.text == "")


def test_redo_makes_again_what_was_undone(bench, hand, person):
    window, settings = bench.window, bench.window.settings
    hand.types(settings.wavelength, "600")
    person.waits(lambda: settings.wavelength_read.text() == "600.00 nm")
    assert window.actions_["undo"].toolTip() == "Undo: wavelength 550 nm  (Ctrl+Z)"
    person.clicks(buttons(settings)["Undo"])
    person.waits(lambda: settings.wavelength_read.text() == "550.00 nm")
    assert settings.wavelength.text() == "550.00 nm"
    person.clicks(buttons(settings)["Redo"])
    person.waits(lambda: settings.wavelength_read.text() == "600.00 nm")


def buttons(panel):
    return {one.text(): one for one in panel.findChildren(QAbstractButton)}


def test_what_is_locked_does_not_move(bench, hand, watch, person):
    window, settings = bench.window, bench.window.settings
    hand.presses(Qt.Key.Key_L, ctrl=True)
    person.waits(lambda: not settings.exposure.isEnabled())
    for key in (Qt.Key.Key_F5, Qt.Key.Key_F6):
        hand.presses(key)
    hand.presses(Qt.Key.Key_Z, ctrl=True)
    hand.types(settings.exposure, "125")
    hand.clicks(settings.target)
    hand.clicks(window.pattern.show_button)
    assert watch.moves == []
    hand.presses(Qt.Key.Key_L, ctrl=True)
    person.waits(settings.exposure.isEnabled)


def test_a_picture_file_is_shown_once_it_was_read(bench, hand, person, tmp_path):
    window, pattern = bench.window, bench.window.pattern
    person.waits(lambda: pattern.grey._image is not None)
    person.chooses(pattern.form.kind, "Image file")
    assert pattern.note.text() == "choose a picture file"
    assert not pattern.show_button.isEnabled()
    person.waits(lambda: person.looks_at(pattern.grey)[5:-5, 5:-5].std((0, 1)).max() < 1)
    window.message.acknowledge()
    person.presses(Qt.Key.Key_F6)
    person.waits(lambda: window.message.is_error)
    assert window.message.text == "The pattern isn't complete: choose a picture file."
    window.message.acknowledge()
    bench.reports.clear()
    person.types(pattern.form.file, str(tmp_path / "missing.png"))
    person.waits(lambda: pattern.note.text() == "no preview")
    person.waits(lambda: window.message.is_error)
    assert not pattern.show_button.isEnabled()
    window.message.acknowledge()
    pattern.form.file.clear()
    # One of the neutral pattern may still have been on its way.
    previews = (one for one in bench.reports if isinstance(one, PatternPreview))
    assert "image" not in {one.pattern["kind"] for one in previews}
    assert pattern.grey._image is None


@pytest.fixture
def manual(own_bench, tmp_path, qtbot):
    files = write_bench(tmp_path)
    text = files.bench.read_text().replace('driver = "simulated-targets"', MANUAL)
    files.bench.write_text(text)
    return own_bench(files=files)


def test_targets_placed_by_hand_are_asked_and_confirmed(manual):
    window, settings = manual.window, manual.window.settings
    wait_until(lambda: manual.frame is not None, manual.describe)
    assert manual.frame.target == "target not confirmed"
    wait_until(lambda: settings.target_read.text().endswith("not confirmed"))
    hand, watch = Hand(window), Watch(window, manual.connection)
    choose(hand, settings.target, "star")
    assert settings.target_read.text().endswith("asked: star")
    assert window.question.text == "Place the target 'star' before the camera, then confirm it."
    wait_until(lambda: manual.frame.target == "target not confirmed, asked: star")
    assert watch.moves == []
    hand.presses(Qt.Key.Key_Return, ctrl=True)
    wait_until(lambda: settings.target_read.text() == "confirmed: star")
    wait_until(lambda: manual.frame.target == "star (confirmed)")
    assert "star, as confirmed" in window.devices.text("targets")
    # The virtual camera looks at the dark, whatever a person says.
    doubt = (
        "'star' is confirmed, but no pixel has light: the target is missing, or the light is off."
    )
    wait_until(lambda: window.question.text == doubt)
    hand.clicks(window.question.no_button)
    assert settings.target_read.text().endswith("asked: star")
    hand.presses(Qt.Key.Key_Return, ctrl=True)
    wait_until(lambda: window.question.text == doubt)
    hand.presses(Qt.Key.Key_Return, ctrl=True)
    assert window.question.text == ""
    choose(hand, settings.target, "dark")
    hand.presses(Qt.Key.Key_Escape)
    assert settings.target_read.text() == "confirmed: star"
    assert settings.target.currentText() == "star"
    choose(hand, settings.target, "dark")
    hand.clicks(window.question.yes_button)
    wait_until(lambda: settings.target_read.text() == "confirmed: dark")
    frames = manual.frames
    wait_until(lambda: manual.frames > frames + 2)
    assert window.question.text == ""
    # Undo can only ask.
    hand.presses(Qt.Key.Key_Z, ctrl=True)
    wait_until(lambda: settings.target_read.text().endswith("asked: star"))
    hand.presses(Qt.Key.Key_Return, ctrl=True)
    wait_until(lambda: settings.target_read.text() == "confirmed: star")
    assert not window.actions_["undo"].isEnabled()
    assert window.actions_["redo"].isEnabled()
    assert watch.moves == ["PlaceTarget"] * 4


def choose(hand, box, text):
    """Choose from a list by keys."""
    box.setFocus()
    while box.currentText() != text:
        down = box.currentIndex() < box.findText(text)
        hand.presses(Qt.Key.Key_Down if down else Qt.Key.Key_Up)
    hand.presses(Qt.Key.Key_Return)


def test_a_dark_frame_with_light_is_asked_about(bench, person, chosen_file, tmp_path):
    """Taken again as long as it is lit; kept if a person says so."""
    plan = write_plan(tmp_path, "Lit", targets='["flat"]', wavelengths="[550]")
    plan.write_text(plan.read_text().replace("[1, 8]", '[400]\nrole = "dark"'))
    chosen_file(plan)
    bar = bench.window.prompt_bar
    bench.window.actions_["plan"].trigger()
    person.waits(lambda: bar.is_asking)
    first = bar.text
    assert first.startswith("flat at 400 ms: ")
    assert "of this dark frame" in first or "this dark frame reads" in first
    # What is asked about is seen.
    person.waits(lambda: (bench.frame.target, bench.frame.exposure) == ("flat", 0.4))
    assert (bench.stored, bench.states[-1]) == (0, "PAUSED")
    asked = bench.window.session.queue.prompt.number
    person.presses(Qt.Key.Key_Return)
    person.waits(lambda: bar.is_asking and bench.window.session.queue.prompt.number > asked)
    assert bar.text == first
    person.clicks(bar.other_button)
    person.waits(lambda: bench.states[-1] == "COMPLETE")
    assert bench.runs[-1].stored_frames == 1
