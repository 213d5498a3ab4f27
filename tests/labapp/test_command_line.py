"""What is the same in all commands: each teaches itself, and does by default what is harmless."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

import labapp.cli


def walk(command: Any, words: str = "labapp") -> Iterator[tuple[str, Any]]:
    """Every command with its words, groups included."""
    yield words, command
    for name, one in getattr(command, "commands", {}).items():
        yield from walk(one, f"{words} {name}")


COMMANDS = dict(walk(labapp.cli.command()))


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
