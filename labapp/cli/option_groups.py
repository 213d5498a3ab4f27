"""Groups of options that several commands share, as dataclasses with one field for each option.

A command states its groups by `cls=command_with_options(...)`, with its own defaults, and reads
them by `get_option_group(context, ...)`.
"""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from functools import cache
from typing import Any, TypeVar

import typer
from typer.core import TyperCommand
from typer.main import get_command

G = TypeVar("G")


@cache
def _group_parser(group: Callable[..., Any]) -> Any:
    """Build a command whose options are the fields of a group; it returns the group."""
    app = typer.Typer(add_completion=False)
    app.command()(group)
    return get_command(app)


def command_with_options(*groups: Any, options_first: bool = False) -> type[TyperCommand]:
    """Return a command class that also takes the options of some option groups.

    If `options_first` is true, help lists them before the command's own options.
    """

    class Command(TyperCommand):
        def __init__(self, *positional: Any, params: list[Any], **named: Any) -> None:
            shared = [one for group in groups for one in _options(group)]
            both = [*shared, *params] if options_first else [*params, *shared]
            super().__init__(*positional, params=both, **named)

        def invoke(self, ctx: Any) -> Any:
            ctx.obj = {type(group): _build_group(type(group), ctx.params) for group in groups}
            return super().invoke(ctx)

    return Command


def get_option_group(context: typer.Context, group: type[G]) -> G:
    """Return a group with the values that the user gave."""
    found: G = context.obj[group]
    return found


def _options(group: Any) -> list[Any]:
    """Return the options of a group, with the values of the given instance as defaults."""
    kind: Callable[..., Any] = type(group)
    options = [copy(one) for one in _group_parser(kind).params]
    for option in options:
        option.default = getattr(group, option.name)
    return options


def _build_group(group: Callable[..., Any], values: dict[str, Any]) -> Any:
    """Build a group from parsed values, and remove the values that it takes."""
    reader = _group_parser(group)
    return reader.callback(**{one.name: values.pop(one.name) for one in reader.params})
