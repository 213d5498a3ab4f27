"""The drivers that a bench file names: loaded, with their options checked, and guarded."""

from __future__ import annotations

import inspect
import math
import re
from collections.abc import Callable, Iterator, Mapping
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from drivers.hosted import HostedDevice
from drivers.hosted.guard import GuardedDevice
from drivers.interfaces import Surroundings
from drivers.roles import misfit
from labapp.common.errors import UserError, suggest_spelling
from labapp.common.number_ranges import require_range
from labapp.common.plain_text import quote
from labapp.files.bench_file import DeviceTable
from labapp.files.plain_data import number_remedy

DRIVER_GROUP = "labapp.devices"

_OF_THIS_PROCESS = ("sim://", "simulated-here@")
"""Beginnings of addresses of simulated wires that end with this process."""

_NUMBER = re.compile(r"\b(?:float|int)\b")
_TEXT = re.compile(r"\b(?:str|Literal|Any)\b")


@cache
def installed_drivers() -> dict[str, EntryPoint]:
    """Return the entry points of the installed drivers by name."""
    return {entry.name: entry for entry in entry_points(group=DRIVER_GROUP)}


def device_maker(
    name: str, table: DeviceTable, surroundings: Surroundings, source: str
) -> Callable[[], Any]:
    """Return a function that opens a described device with its driver.

    Raises UserError at once for an unknown driver, one that doesn't load, or wrong options.
    """
    installed = installed_drivers()
    entry = installed.get(table.driver)
    if entry is None:
        raise UserError(
            f"{source}: key 'devices.{name}.driver' is {table.driver!r}, which is unknown. "
            f"{suggest_spelling(table.driver, installed)}"
            f"Choose one of {', '.join(sorted(installed))}."
        )
    where = f"{source}: key 'devices.{name}"
    if table.own_process:
        return _hosted_device_maker(name, where, table, entry, surroundings)
    try:
        factory = entry.load()
    except Exception as error:
        raise UserError(
            f"{where}.driver' is {table.driver!r}, which doesn't load: {error}. "
            "Reinstall the package that provides it."
        ) from error
    if isinstance(factory, type):
        _require_fit(factory, name, where, table)
    signature = inspect.signature(factory)
    try:
        signature.bind(surroundings, **table.options)
    except TypeError as error:
        known = [p for p in signature.parameters if p != "surroundings"]
        unknown = [option for option in table.options if option not in known]
        said = f"has {unknown[0]!r}, which is unknown" if unknown else f"is wrong: {error}"
        raise UserError(
            f"{where}.options' {said}. {suggest_spelling(unknown[0], known) if unknown else ''}"
            f"{table.driver} takes {', '.join(known) or 'no options'}."
        ) from error
    try:
        require_option_types(signature, table.options)
    except ValueError as error:
        raise UserError(f"{where}.options': {error}.") from error
    return _with_user_errors(where, table, lambda: factory(surroundings, **table.options))


def _require_fit(device: Any, role: str, where: str, table: DeviceTable) -> Any:
    """Return a device, or its class; raise UserError if its driver is for another role."""
    if doubt := misfit(device, role):
        raise UserError(f"{where}.driver' is {table.driver!r}, which {doubt}. Name another driver.")
    return device


def _hosted_device_maker(
    name: str, where: str, table: DeviceTable, entry: EntryPoint, surroundings: Surroundings
) -> Callable[[], Any]:
    if table.is_simulated:
        raise UserError(
            f"{where}.own_process' is true, and simulated devices share one world. Remove it."
        )
    # A real device doesn't use the virtual world, which can't be passed to another process either.
    real = Surroundings(surroundings.clock)

    def make() -> Any:
        device = HostedDevice(real, table.driver, entry.value, table.options)
        return _require_fit(device, name, where, table)

    return _with_user_errors(where, table, make)


def _with_user_errors(where: str, table: DeviceTable, make: Callable[[], Any]) -> Callable[[], Any]:
    """Wrap a device's maker, so that its errors about options name the bench file's key."""

    def make_device() -> Any:
        try:
            return make()
        except (TypeError, ValueError, IndexError) as error:
            raise UserError(
                f"{where}.options' is {table.options}: {error}. Correct the value."
            ) from error

    return make_device


def require_option_types(signature: inspect.Signature, options: Mapping[str, Any]) -> None:
    """Refuse texts, true and false where a driver takes numbers alone.

    Numbers that nobody can mean by the option's unit are refused, too.
    Raises ValueError that names option, value and what to write.
    """
    for name, value in options.items():
        kind = _declared(signature, name)
        if kind == "bool" and not isinstance(value, bool):
            raise ValueError(f"{name} is {quote(value)}: write true or false, without quotes")
        if _NUMBER.search(kind) and not _TEXT.search(kind):
            for one in _leaves(value):
                if isinstance(one, str | bool):
                    raise ValueError(f"{name} has {quote(one)}: {number_remedy(one)}")
        for one in _leaves(value):
            if isinstance(one, int | float) and not isinstance(one, bool):
                _require_range(name, one)


def _require_range(name: str, value: float) -> None:
    """Refuse a number that isn't finite, or beyond the range of the option's unit."""
    try:
        if not math.isfinite(value):
            raise ValueError("give a finite number")
        require_range(name, value, positive=True)
    except ValueError as error:
        raise ValueError(f"{name} has {value:g}: {error}") from error


def _declared(signature: inspect.Signature, name: str) -> str:
    """Return the type that a driver declares for an option, as text."""
    found = signature.parameters.get(name)
    if found is None or found.annotation is inspect.Parameter.empty:
        return ""
    kind = found.annotation
    return kind.__name__ if isinstance(kind, type) else str(kind)


def _leaves(value: Any) -> Iterator[Any]:
    """Yield a value, or those of its list and of the lists in it."""
    if isinstance(value, list | tuple):
        for one in value:
            yield from _leaves(one)
    else:
        yield value


def guarded_devices(tables: Mapping[str, DeviceTable]) -> list[GuardedDevice]:
    """Return the devices that would stay as they are if this process were killed.

    Others are left safe by a process of their own, or by the system.
    """
    installed = installed_drivers()
    return [
        GuardedDevice(f"{role} ({table.driver})", installed[table.driver].value, table.options)
        for role, table in tables.items()
        if table.is_exclusive
        and table.driver in installed
        and not table.own_process
        # Wires and functions of this process end with it.
        and not any(
            callable(value) or (isinstance(value, str) and value.startswith(_OF_THIS_PROCESS))
            for value in table.options.values()
        )
        and not _is_left_safe(installed[table.driver])
    ]


def _is_left_safe(entry: EntryPoint) -> bool:
    """Return whether a driver leaves its device safe when its process is killed.

    One that doesn't load counts as such: it won't be opened.
    """
    try:
        return bool(getattr(entry.load(), "is_left_safe_when_killed", False))
    except Exception:
        return True
