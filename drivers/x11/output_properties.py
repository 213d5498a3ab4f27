"""Read and change the properties of outputs, such as "Broadcast RGB", by RandR.

A graphics card's driver exposes as properties what it does to a picture on the way to the
connector. The requests are those of the X.Org document "RandR", version 1.3.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from enum import IntEnum

from drivers.x11.connection import XConnection, XError

Value = str | tuple[int, ...]
"""Value of a property: a word of an enumeration, or integers; no integers if there is no value."""

_MAX_WORDS = 1 << 16
"""Largest property that is read, in units of 4 bytes: tables of 4096 colours take 8192. Chosen."""

_INTEGER_CODES = {8: "B", 16: "H", 32: "i"}


class _PropertyRequest(IntEnum):
    """Minor opcodes of RandR's requests for properties of outputs."""

    LIST = 10
    QUERY = 11
    CHANGE = 13
    GET = 15


class _AtomType(IntEnum):
    """Types of properties that X11 defines itself."""

    ATOM = 4
    INTEGER = 19
    STRING = 31


@dataclass(frozen=True)
class OutputProperty:
    """A property of an output, its value, and the values that the server takes.

    valid: the words or integers that are allowed; least and greatest integer if is_range; empty if
    any. is_immutable: whether the server refuses changes. type_atom, width: the server's type of
    the value, and the bits of one of its integers. atom: the server's number of the name.
    """

    name: str
    value: Value
    valid: tuple[str | int, ...] = ()
    is_range: bool = False
    is_immutable: bool = False
    atom: int = 0
    type_atom: int = 0
    width: int = 32

    def allows(self, number: int) -> bool:
        """Return whether the server takes this integer as the value."""
        numbers = [one for one in self.valid if isinstance(one, int)]
        if self.is_range and len(numbers) == 2:
            return numbers[0] <= number <= numbers[1]
        return not self.valid or number in numbers


class OutputProperties:
    """Read and change the properties of one output.

    The names of atoms are asked only once, because they don't change; the allowed values seldom do.
    """

    def __init__(self, x: XConnection, output: int) -> None:
        self._x, self._output = x, output
        self._names: dict[int, str] = {}
        self._kinds: dict[int, tuple[tuple[int, ...], bool, bool]] = {}

    def read(self, *, anew: bool = False) -> dict[str, OutputProperty]:
        """Read all properties by their names; XError if the output has gone.

        anew: whether the allowed values are read again, too.
        """
        if anew:
            self._kinds.clear()
        told = self._x.query_extension("RANDR", _PropertyRequest.LIST, "I", self._output)
        (count,) = struct.unpack_from("<H", told, 8)
        atoms = struct.unpack_from(f"<{count}I", told, 32)
        found = (self._read_one(atom) for atom in atoms)
        return {one.name: one for one in found if one is not None}

    def change(self, given: OutputProperty, value: Value) -> bool:
        """Give a property another value; return whether the server has taken it."""
        is_word = isinstance(value, str)
        numbers = (self._x.atom(value),) if isinstance(value, str) else value
        kind = given.type_atom or (_AtomType.ATOM if is_word else _AtomType.INTEGER)
        code = _INTEGER_CODES[given.width]
        layout = f"IIIBB2xI{len(numbers)}{code}"
        replace = 0
        head = (self._output, given.atom, kind, given.width, replace, len(numbers))
        try:
            # The request has no reply, so that its error would come among the events.
            self._x.send_extension_request(
                "RANDR", _PropertyRequest.CHANGE, layout, *head, *numbers
            )
            seen = self._read_one(given.atom)
        except XError:
            return False
        return seen is not None and seen.value == value

    def name(self, atom: int) -> str:
        """Return the name of an atom."""
        if atom not in self._names:
            told = self._x.query(17, struct.pack("<BBHI", 17, 0, 0, atom))
            (length,) = struct.unpack_from("<H", told, 8)
            self._names[atom] = told[32 : 32 + length].decode("latin-1")
        return self._names[atom]

    def _read_one(self, atom: int) -> OutputProperty | None:
        """Read a property; None if it has just been deleted."""
        try:
            kind, width, data = read_property(self._x, self._output, atom)
            allowed, is_range, is_immutable = self._kind(atom)
        except XError:
            return None
        numbers = parse_integers(data, width)
        is_word = kind == _AtomType.ATOM and len(numbers) == 1 and numbers[0] != 0
        value: Value = self.name(numbers[0]) if is_word else numbers
        if kind == _AtomType.STRING:
            value = data.rstrip(b"\0").decode("latin-1")
        words = kind == _AtomType.ATOM and not is_range
        valid = tuple(self.name(one) if words else one for one in allowed)
        name = self.name(atom)
        return OutputProperty(name, value, valid, is_range, is_immutable, atom, kind, width or 32)

    def _kind(self, atom: int) -> tuple[tuple[int, ...], bool, bool]:
        """Return a property's allowed values, whether they are a range, and whether it is fixed."""
        if atom not in self._kinds:
            told = self._x.query_extension(
                "RANDR", _PropertyRequest.QUERY, "II", self._output, atom
            )
            (count,) = struct.unpack_from("<I", told, 4)
            allowed = struct.unpack_from(f"<{count}i", told, 32)
            self._kinds[atom] = (allowed, bool(told[9]), bool(told[10]))
        return self._kinds[atom]


def read_property(x: XConnection, output: int, name: int) -> tuple[int, int, bytes]:
    """Read a property of an output: its type, the bits of an integer, and the bytes."""
    any_type, delete, pending = 0, 0, 0
    layout, given = "IIIIIBB2x", (output, name, any_type, 0, _MAX_WORDS, delete, pending)
    told = x.query_extension("RANDR", _PropertyRequest.GET, layout, *given)
    kind, _, count = struct.unpack_from("<III", told, 8)
    width = told[1]
    return kind, width, told[32 : 32 + count * (width // 8)]


def parse_integers(data: bytes, width: int) -> tuple[int, ...]:
    """Decode the integers of a property; width: bits of each, or 0."""
    if not width:
        return ()
    return struct.unpack(f"<{8 * len(data) // width}{_INTEGER_CODES[width]}", data)


def changed_properties(x: XConnection, output: int, event: bytes) -> Iterator[int]:
    """Yield the atom of the output's property that an event reports as changed."""
    _, first = x.extension("RANDR")
    output_property = 2
    if event[0] & 0x7F == first + 1 and event[1] == output_property:
        number, atom = struct.unpack_from("<II", event, 8)
        if number == output:
            yield atom
