"""Wavelengths whose drive levels a VariSpec calculates in advance."""

from __future__ import annotations

from drivers.varispec.echo_client import VariSpecClient
from drivers.varispec.protocol import ELEMENT_REPLY, PALETTE_SIZE


class Palette:
    """Define and read the filter's palette. Wavelengths are in nanometres."""

    def __init__(self, talk: VariSpecClient) -> None:
        self._talk = talk
        self._defined: dict[float, int] = {}

    def forget(self) -> None:
        self._defined.clear()

    def find(self, nm: float) -> int | None:
        """Return a wavelength's element; None if it wasn't defined here."""
        return self._defined.get(nm)

    def clear(self) -> None:
        self.forget()
        self._talk.send_and_check("C 1", "clear the palette")

    def define(self, element: int, nm: float) -> None:
        self._talk.send_and_check(f"D {nm:.2f},{element}", f"palette with {nm:.2f} nm")
        self._defined[nm] = element

    def read(self) -> tuple[float, ...]:
        """Read the wavelengths, repeatedly unless they equal what was defined here."""
        held = self._read_once()
        if held and held == tuple(self._defined):
            return held
        return self._talk.confirmed_reply(self._read_once, "read the palette")

    def _read_once(self) -> tuple[float, ...]:
        command = "read the palette"
        count = float(self._talk.ask("D ?", ELEMENT_REPLY, command)[1])
        if count != int(count) or count > PALETTE_SIZE:
            raise self._talk.line.error(command, f"it says it has {count} elements")
        return tuple(
            float(self._talk.read_reply(ELEMENT_REPLY, command)[1]) for _ in range(int(count))
        )
