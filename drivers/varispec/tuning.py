"""Tune a filter, and read the wavelength to which it is tuned, in nanometres."""

from __future__ import annotations

from drivers.varispec.echo_client import FilterRefusal, VariSpecClient
from drivers.varispec.protocol import WAVELENGTH_REPLY


class Tuning:
    """Set and read the wavelength.

    nm: the wavelength in nanometres that the filter last confirmed; 0 before the first.
    """

    def __init__(self, talk: VariSpecClient) -> None:
        self._talk = talk
        self.nm = 0.0

    def tune(self, nm: float, element: int | None, command: str) -> None:
        """Tune to a wavelength, through the palette if `element` isn't None."""
        self._talk.send_and_check(f"W {nm:.2f}" if element is None else f"P {element}", command)
        actual = self._ask(command)
        # The filter's resolution is 0.01 nm, so a smaller difference than 0.006 nm is rounding.
        if abs(actual - nm) > 0.006:
            raise self._talk.line.error(command, f"it is tuned to {actual:.2f} nm instead")
        self.nm = nm

    def choose(self, element: int, command: str) -> float:
        """Tune to an element of the palette; return its wavelength in nanometres."""
        self._talk.send_and_check(f"P {element:d}", command)
        if self._talk.query_integer("P", command) != element:
            raise self._talk.line.error(command, "it chose another element")
        self.nm = self._talk.confirmed_reply(lambda: self._ask(command), command)
        return self.nm

    def read(self) -> float:
        """Read the wavelength in nm, repeatedly unless it is as last confirmed."""
        command = "read the wavelength"
        told = self._ask(command)
        if told == self.nm:
            return told
        return self._talk.confirmed_reply(lambda: self._ask(command), command)

    def _ask(self, command: str) -> float:
        answer = self._talk.ask("W ?", WAVELENGTH_REPLY, command)
        if answer[1] is not None:
            return float(answer[1])
        # The answer "W*" may be noise, so the status decides, which is read three times.
        if not self._talk.read_status(command).initialised:
            raise FilterRefusal(
                self._talk.line.model,
                command,
                "it is not tuned, nor initialised",
                "Initialise it: refresh(), or open it again",
            )
        raise self._talk.line.error(command, "it is not tuned: W*", "Tune it again")
