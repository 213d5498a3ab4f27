"""What is the same in all commands: each teaches itself, and does by default what is harmless."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

import pytest

import labapp.cli


def walk(command: Any, words: str = "labapp") -> Iterator[tuple[str, Any]]:
    """Every command with its words, groups included."""
    yield words, command
    for name, one in getattr(command, "commands", {}).items():
        yield from walk(one, f"{words} {name}")


COMMANDS = dict(walk(labapp.cli.build_command_line()))


@pytest.mark.parametrize("words", COMMANDS)
def test_a_command_says_what_it_does_and_what_each_option_means(words):
    command = COMMANDS[words]
    assert command.help, words
    for one in command.params:
        if one.param_type_name == "option":
            assert one.help, f"{words} {one.opts}"


@pytest.mark.parametrize("words", COMMANDS)
def test_a_switch_is_off_until_somebody_gives_it(words):
    switches = [one for one in COMMANDS[words].params if getattr(one, "is_flag", False)]
    on = {one.name for one in switches if one.default}
    assert on == ({"opening"} if words == "labapp bench check" else set())


@pytest.mark.parametrize("words", ["pattern", "retrieve", "plan", "study", "accuracy"])
def test_every_list_is_printed_alike(labapp, words):
    """A name and what it is, for programs with what can be set; the same names for a person."""
    code, printed, _ = labapp(words, "list", "--json")
    listed = json.loads(printed)
    assert code == 0
    _, said, _ = labapp(words, "list")
    for one in listed:
        assert f"{one['name']}: {one['what']}" in said
        assert all(set(key) == {"key", "default", "what"} for key in one["keys"])
    assert len({one["name"] for one in listed}) == len(listed) > 3
    assert "For instance: labapp " in said


def test_devices_and_devices_list_are_the_same():
    groups = COMMANDS["labapp devices"]
    own = {one.name for one in groups.params} - {"help"}
    assert own == {one.name for one in groups.commands["list"].params} - {"help"}
