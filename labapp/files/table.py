"""Tables as plain dataclasses, whose keys carry descriptions, for the patterns of a plan.

pydantic reads and validates them like its own models. The tables can be listed without importing
pydantic, so that the window and the command line offer them without delay.
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
    "_dioptre": "D",
    "_px": "pixels",
    "_s": "s",
}


@dataclass(frozen=True)
class LightUnit:
    """Mark of a number, or of a key of a table, that is a wavelength in nanometres.

    pydantic refuses one that can't be; the window, which doesn't load it, passes the mark over.
    """

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> Any:
        from pydantic_core import core_schema

        return core_schema.no_info_after_validator_function(_in_its_unit, handler(source))


def _in_its_unit(nanometres: Any) -> Any:
    """Return nanometres as they are; ValueError if the number seems to be in another unit."""
    from labapp.files.wavelengths import doubt_nanometres

    if doubt := doubt_nanometres(float(nanometres)):
        raise ValueError(doubt)
    return nanometres


Positive = Annotated[float, Gt(0)]
Nanometres = Annotated[Positive, LightUnit()]
Count = Annotated[int, Ge(1), Le(100_000)]


@dataclass(frozen=True)
class Key:
    """Description of a table's key, and its field on a form of the window.

    description: meaning of the key. Its unit follows from the ending of its name.
    label: on the form. Keys without a label aren't on the form. For a file, it is the hint.
    initial: value on the form.
    low, high: limits of a number on the form.
    """

    description: str = ""
    label: str = ""
    initial: Any = ""
    low: float = -10_000
    high: float = 10_000


@dataclass_transform(kw_only_default=True, frozen_default=True)
class Table:
    """Base of the tables of a plan file: a frozen dataclass with keyword arguments.

    Unknown keys, texts for numbers and numbers that aren't finite are errors. `__post_init__`
    raises ValueError for other impossible values. title is the table's name on forms; a table
    without it isn't on forms. summary_template is a short text with keys in braces, for tables
    whose summary always has the same form.
    """

    __dataclass_fields__: ClassVar[dict[str, Any]]
    __pydantic_config__: ClassVar[Any] = {"extra": "forbid", "allow_inf_nan": False}
    title: ClassVar[str] = ""
    summary_template: ClassVar[str] = ""

    def __init_subclass__(cls) -> None:
        dataclass(frozen=True, kw_only=True)(cls)

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: Any) -> Any:
        from labapp.files.plain_data import only_numbers

        return only_numbers(source, handler)

    @property
    def summary(self) -> str:
        """Kind and sizes in a few words."""
        return self.summary_template.format(**vars(self))


def tag_value(table: type[Table], key: str) -> str:
    """Return the only value that a key can have, which identifies the table's kind."""
    name: str = get_args(get_type_hints(table)[key])[0]
    return name


def keys_of(table: type[Any]) -> Iterator[tuple[str, type[Any], Key]]:
    """Yield the name, the type and the Key of each key of a table, in their order.

    Fields without a Key are left out.
    """
    hints = get_type_hints(table, include_extras=True)
    for one in fields(table):
        kind, *rest = get_args(hints[one.name]) or (hints[one.name],)
        for key in reversed(rest):
            if isinstance(key, Key):
                yield one.name, kind, key
                break


def unit_of(key: str) -> str:
    """Return the unit at the end of a key's name; empty if it has none."""
    return next((unit for end, unit in _UNITS.items() if key.endswith(end)), "")
