"""Numbers typed into the window, under desktops of several languages."""

from __future__ import annotations

import random

import pytest
from figures.typed_fields import enable_all, type_into_all
from PySide6.QtCore import SIGNAL, QLocale, Qt
from PySide6.QtWidgets import QToolButton
from waits import wait_until

from labapp.window.number_fields import number_fields


@pytest.fixture(params=["de_DE", "en_US", "ar_EG"])
def language(request):
    before = QLocale()
    QLocale.setDefault(QLocale(request.param))
    yield request.param
    QLocale.setDefault(before)


def test_the_number_that_is_set_is_the_one_that_is_typed(language, bench, person):
    settings = bench.window.settings
    for text, shown in (
        ("0.5", "0.500 ms"),
        ("0,75", "0.750 ms"),
        ("1.234", "1.234 ms"),
        ("1e2", "100.000 ms"),
    ):
        person.types(settings.exposure, text)
        person.waits(lambda shown=shown: settings.exposure_read.text() == shown)
        assert settings.exposure.text() == shown


def test_a_text_that_cannot_be_read_is_told_and_sets_nothing(language, bench, person):
    window, exposure = bench.window, bench.window.settings.exposure
    person.types(exposure, "40")
    person.waits(lambda: window.settings.exposure_read.text() == "40.000 ms")
    for text, words in (
        ("1,234.5", "both a point and a comma"),
        ("1.234.567", "several signs"),
        ("5 s", "type the number of ms alone"),
        ("0.12345", "more than 3 decimals"),
        ("9e9", "out of range"),
    ):
        person.types(exposure, text)
        assert window.message.is_error
        assert words in window.message.text
        assert "It stays 40.000 ms" in window.message.text
        window.message.acknowledge()
        assert exposure.set_value == 40
        assert exposure.text() == "40.000 ms"


def test_nothing_begins_beside_a_text_that_is_refused(bench, person, qtbot):
    window = bench.window
    row = window.run.star
    before = row.shortest.value()
    row.shortest.setFocus()
    row.shortest.selectAll()
    qtbot.keyClicks(row.shortest, "0,5,5")
    person.clicks(window.run.findChildren(type(window.help_button))[0])
    assert window.session.queue.current_run is None
    assert "several signs" in window.message.text
    assert row.shortest.value() == before


def test_every_number_field_takes_texts_as_typed_or_says_why_not(new_bench):
    """Of the real window; its engine is still starting, so that nothing is sent."""
    window = new_bench().window
    found = type_into_all(window, random.Random(5), 5)
    assert found["fields"] == len(number_fields(window)) > 30
    assert set(found["fates"]) <= {"set", "kept"}, found["wrong"]


def test_a_click_on_a_button_sets_what_is_typed_before(bench, person, qtbot):
    row = bench.window.run.photograph
    row.shortest.setFocus()
    row.shortest.selectAll()
    qtbot.keyClicks(row.shortest, "0,25")
    person.clicks(bench.window.help_button)
    assert row.shortest.value() == 0.25
    bench.window.help.close()


def test_a_function_key_begins_nothing_beside_a_text_that_is_refused(bench, person, qtbot):
    window, row = bench.window, bench.window.run.star
    window.activateWindow()
    person.waits(window.isActiveWindow)
    before = row.shortest.value()
    row.shortest.setFocus()
    row.shortest.selectAll()
    qtbot.keyClicks(row.shortest, "1.2.3")
    qtbot.keyClick(row.shortest, Qt.Key.Key_F6)
    assert "several signs" in window.message.text
    assert window.session.queue.current_run is None
    assert row.shortest.value() == before


BEGINNING = {"live", "acquire", "reconstruct", "plan", "resume", "open"}
"""The actions that use what the fields hold, or would hide that a field kept its old value."""

OF_THE_FIELD = ("A", "C", "W", "Esc", "Ctrl+Z", "Ctrl+Y", "Ctrl+E", "Ctrl+D")
"""Keys that a field takes for its text, as long as it has the keyboard."""


@pytest.fixture
def performed(new_bench):
    """A window whose engine is still starting, and what its actions would do.

    Nobody listens to an action but the test.
    """
    window, done = new_bench().window, []
    for name, action in window.actions_.items():
        if action.receivers(SIGNAL("performed(bool)")):
            action.performed.disconnect()
        action.performed.connect(lambda on, name=name: done.append(name))
    return window, done


@pytest.fixture
def activate():
    """Give a window the keyboard."""

    def activate(window):
        window.activateWindow()
        wait_until(window.isActiveWindow, lambda: "the window isn't active")

    return activate


def ways(window, qtbot, action):
    """All ways in which a person starts an action: key, menu, and each button."""
    key = action.shortcut()
    if not key.isEmpty() and key.toString() not in OF_THE_FIELD:
        yield lambda: qtbot.keyClick(
            window.focusWidget(), key[0].key(), modifier=key[0].keyboardModifiers()
        )
    menu = next(one for one in window.bar.menus.menus.values() if action in one.actions())
    yield lambda: choose_in_menu(window, qtbot, menu, action)
    for button in window.findChildren(QToolButton):
        if button.defaultAction() is action and button.isVisible():
            yield lambda button=button: qtbot.mouseClick(button, Qt.MouseButton.LeftButton)


def choose_in_menu(window, qtbot, menu, action):
    title = window.bar.menus.actionGeometry(menu.menuAction()).center()
    qtbot.mouseClick(window.bar.menus, Qt.MouseButton.LeftButton, pos=title)
    place = menu.actionGeometry(action).center()
    qtbot.mouseClick(menu, Qt.MouseButton.LeftButton, pos=place)


def type_only(qtbot, window, action, field, text):
    """Type a text into a field, and nothing more; the bench that isn't open would disable both."""
    action.setEnabled(True)
    enable_all(field)
    field.setFocus()
    field.selectAll()
    qtbot.keyClicks(field, text)


@pytest.mark.parametrize("fieldname", ["shortest", "exposure"])
def test_no_way_of_starting_an_action_goes_on_with_an_old_number(
    performed, activate, qtbot, fieldname
):
    window, done = performed
    activate(window)
    field = window.run.star.shortest if fieldname == "shortest" else window.settings.exposure
    held = (lambda: field.set_value) if fieldname == "exposure" else field.value
    for name, action in window.actions_.items():
        if name not in BEGINNING and fieldname == "exposure":
            continue
        for number, start in enumerate(ways(window, qtbot, action)):
            case = name, number, field.text()
            done.clear()
            before, on = held(), action.isChecked()
            type_only(qtbot, window, action, field, "1.2.3")
            start()
            assert held() == before, case
            if name in BEGINNING:
                assert (done, action.isChecked()) == ([], on), case
                assert "several signs" in window.message.text, case
                window.message.acknowledge()
            else:
                assert done == [name], case
            done.clear()
            typed = 0.25 if before != 0.25 else 0.75
            type_only(qtbot, window, action, field, f"{typed}")
            start()
            assert done == [name], case
            assert held() == typed, case
            qtbot.keyClick(field, Qt.Key.Key_Escape)
            window.message.acknowledge()
