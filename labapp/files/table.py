"""Tables of a plan file as plain dataclasses, whose keys say what they are.

pydantic reads and checks them like its own models, but nothing needs it to list them: so a window
and a command line offer them at once.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields
from typing import Annotated, Any, ClassVar, dataclass_transform, get_args, get_type_hints

from annotated_types import Ge, Gt, Le

_UNITS = {
    "um_per_nm": "µm a nm",
    "_nm": "nm",
    "_um": "µm",
    "_mm": "mm",
    "_ms": "ms",
    "_m": "m",
    "_rad": "rad",
    "_deg": "°",
    "_px": "pixels",
    "_s": "s",
}

Positive = Annotated[float, Gt(0)]
Count = Annotated[int, Ge(1), Le(100_000)]


@dataclass(frozen=True)
class Key:
    """What a person is told of a key, and its field on a form.

    description: what it is; its unit is what its name ends in. label: on the form, where a key
    without one isn't; a file's is the hint. initial: what stands there in the beginning. low, high:
    limits of a number.
    """

    description: str = ""
    label: str = ""
    initial: Any = ""
    low: float = -10_000
    high: float = 10_000


@dataclass_transform(kw_only_default=True, frozen_default=True)
class Table:
    """A dataclass whose entries are given by name and never change.

    Unknown keys are errors, as are numbers that aren't finite; what else can't be, its
    `__post_init__` says by a ValueError. title: what a form calls it; without one it isn't on
    forms. summary_template: what it is and how large, with keys in braces, where that is always
    said alike.
    """

    __dataclass_fields__: ClassVar[dict[str, Any]]
    __pydantic_config__: ClassVar[Any] = {"extra": "forbid", "allow_inf_nan": False}
    title: ClassVar[str] = ""
    summary_template: ClassVar[str] = ""

    def __init_subclass__(cls) -> None:
        dataclass(frozen=True, kw_only=True)(cls)

    @property
    def summary(self) -> str:
        """What it is and how large, in a few words."""
        return self.summary_template.format(**vars(self))


def tag_value(table: type[Table], key: str) -> str:
    """The value that a key of a table always has: what it is known by."""
    name: str = get_args(get_type_hints(table)[key])[0]
    return name


def keys_of(table: type[Any]) -> Iterator[tuple[str, type[Any], Key]]:
    """Name, type and Key of what a table has a Key for, in their order."""
    hints = get_type_hints(table, include_extras=True)
    for one in fields(table):
        kind, *rest = get_args(hints[one.name]) or (hints[one.name],)
        for key in reversed(rest):
            if isinstance(key, Key):
                yield one.name, kind, key
                break


def unit_of(key: str) -> str:
    """The unit that a key's name ends in; empty where it has none."""
    return next((unit for end, unit in _UNITS.items() if key.endswith(end)), "")
