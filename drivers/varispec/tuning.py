"""Tuning a VariSpec, and knowing what it is tuned to. Nanometres."""

from __future__ import annotations

from drivers.varispec.echo_client import FilterRefusal, VariSpecClient
from drivers.varispec.protocol import WAVELENGTH_REPLY

_RESOLUTION = 0.006
"""Wavelengths that differ by less are the same: the filter takes 0.01 nm."""


class Tuning:
    """nm: the wavelength that the filter last confirmed, 0 before it has."""

    def __init__(self, talk: VariSpecClient) -> None:
        self._talk = talk
        self.nm = 0.0

    def tune(self, nm: float, element: int | None, command: str) -> None:
        """To a wavelength, by the element of the palette that holds it where one does."""
        self._talk.send_and_check(f"W {nm:.2f}" if element is None else f"P {element}", command)
        actual = self._ask(command)
        if abs(actual - nm) > _RESOLUTION:
            raise self._talk.line.error(command, f"it is tuned to {actual:.2f} nm instead")
        self.nm = nm

    def choose(self, element: int, command: str) -> float:
        """To an element of the palette; its wavelength."""
        self._talk.send_and_check(f"P {element:d}", command)
        if self._talk.query_integer("P", command) != element:
            raise self._talk.line.error(command, "it chose another element")
        self.nm = self._talk.confirmed_reply(lambda: self._ask(command), command)
        return self.nm

    def read(self) -> float:
        """What it says; one answer is enough where it is what it last confirmed."""
        command = "read the wavelength"
        told = self._ask(command)
        if told == self.nm:
            return told
        return self._talk.confirmed_reply(lambda: self._ask(command), command)

    def _ask(self, command: str) -> float:
        answer = self._talk.ask("W ?", WAVELENGTH_REPLY, command)
        if answer[1] is not None:
            return float(answer[1])
        # The star may be noise; a status that says so thrice is not.
        if not self._talk.read_status(command).initialised:
            raise FilterRefusal(
                self._talk.line.model,
                command,
                "it is not tuned, nor initialised",
                "Initialise it: refresh(), or open it again",
            )
        raise self._talk.line.error(command, "it is not tuned: W*", "Tune it again")
