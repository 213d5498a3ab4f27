"""The history of settings against a list of states that is kept beside it."""

import random

from labapp.window.settings_history import DEPTH, SettingsHistory


def test_what_is_noted_first_is_no_change():
    history = SettingsHistory()
    history.note("exposure", 0.4)
    assert history.undo() is None
    assert history.values == {"exposure": 0.4}


def test_the_same_value_again_is_no_change():
    history = SettingsHistory()
    history.note("exposure", 0.4)
    history.note("exposure", 0.4)
    assert history.next_undo is None


def test_undo_and_redo_walk_through_all_states():
    history, rng = SettingsHistory(), random.Random(3)
    for name in ("exposure", "wavelength", "target", "pattern"):
        history.note(name, 0)
    states = [dict(history.values)]
    while len(states) < 60:
        history.note(rng.choice(list(states[0])), rng.randrange(5))
        if history.values != states[-1]:
            states.append(dict(history.values))
    for state in reversed(states[:-1]):
        history.undo()
        assert history.values == state
    assert history.undo() is None
    for state in states[1:]:
        history.redo()
        assert history.values == state
    assert history.redo() is None


def test_a_new_setting_ends_what_could_be_made_again():
    history = SettingsHistory()
    for value in (1, 2, 3):
        history.note("exposure", value)
    history.undo()
    history.note("exposure", 7)
    assert history.next_redo is None
    change = history.undo()
    assert (change.before, change.after) == (2, 7)


def test_the_oldest_changes_are_forgotten():
    history = SettingsHistory()
    for value in range(DEPTH + 20):
        history.note("exposure", value)
    while history.undo():
        pass
    assert history.values == {"exposure": 19}


def test_a_closed_bench_has_no_history():
    history = SettingsHistory()
    history.note("exposure", 1)
    history.note("exposure", 2)
    history.clear()
    assert history.undo() is None
    assert history.values == {}
