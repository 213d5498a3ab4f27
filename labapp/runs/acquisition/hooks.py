"""Hooks: a user's own code that a run calls, found by entry point and named in the plan."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.metadata import entry_points
from typing import Any

from labapp.common.errors import UserError
from labapp.files.plan_file import PlanFile
from labapp.runs.bench_interface import Bench

HOOK_GROUP = "labapp.hooks"
"""Entry-point group of hooks. Each is a callable `make(plan, bench)`, which returns an object with
any of the methods before_run(shots), before_frame(shot), after_frame(shot, frame) and
after_run(state); and before_metering(shots), before the targets of a block are metered for its
bracket. They run between frames, in the run's thread; an exception ends the run as
FAILED."""


class HookError(Exception):
    """A hook failed; the message names hook, method and reason."""


class Hooks:
    """Hooks that are called in the order in which the plan names them."""

    def __init__(self, hooks: Sequence[tuple[str, Any]] = ()) -> None:
        self._hooks = list(hooks)

    @staticmethod
    def of(plan: PlanFile, bench: Bench) -> Hooks:
        """Load the hooks that a plan names; raise UserError if one can't be loaded.

        Hooks are loaded before any device moves.
        """
        hooks = []
        known = (
            {entry.name: entry for entry in entry_points(group=HOOK_GROUP)} if plan.hooks else {}
        )
        for name in plan.hooks:
            try:
                hooks.append((name, known[name].load()(plan, bench)))
            except Exception as error:
                raise UserError(
                    f"hook {name!r} doesn't load: {error}. Mend or remove it."
                ) from error
        return Hooks(hooks)

    def call(self, method_name: str, *arguments: object) -> None:
        """Call a method of all hooks that have it; raise HookError if one fails."""
        for name, hook in self._hooks:
            method = getattr(hook, method_name, None)
            if method is None:
                continue
            try:
                method(*arguments)
            except Exception as error:
                raise HookError(
                    f"hook {name!r}, {method_name}: {type(error).__name__}: {error}"
                ) from error
