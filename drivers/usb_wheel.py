"""What filter wheels on USB share: the way to them, and what they say of themselves."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

from drivers.interfaces import Identity, Surroundings
from drivers.usb_link import UsbLink
from drivers.wheel import Wheel


class UsbWheel(Wheel):
    """A filter wheel at the end of a link, which is closed with it. The rest: see Wheel."""

    usb_ids: ClassVar[tuple[int, int]]
    """Numbers of vendor and product."""

    def __init__(
        self,
        surroundings: Surroundings,
        slots_nm: Sequence[Sequence[float]],
        names: Sequence[str],
        avoid: Sequence[int],
        step_ms: float,
        settling_ms: float,
        serial: str,
        backend: str,
    ) -> None:
        super().__init__(surroundings, slots_nm, names, avoid, step_ms, settling_ms)
        self._link = UsbLink(self.model, *self.usb_ids, serial, backend)

    @property
    def identity(self) -> Identity:
        return Identity(self.model, self._link.identity.serial, simulated=False)

    def kill(self) -> None:
        """End a call that goes on, and all later ones; from any thread."""
        self._link.cancel()

    def unplugged_reason(self) -> str | None:
        """Why it counts as unplugged, empty while it is there; see Device."""
        return self._link.unplugged_reason()

    def _read_slot(self, command: str) -> int:
        return self._wait_at_slot(command, 0)

    def _wait_at_slot(self, command: str, target: int) -> int:
        """The slot, once the wheel stands there, or anywhere for 0, as it says repeatedly."""
        raise NotImplementedError

    def _close(self) -> None:
        self._link.close()

    def _pause(self, seconds: float) -> None:
        """Wait, but not beyond `_deadline`, nor once the wheel was given up."""
        until = min(self._clock.now() + seconds, self._deadline)
        self._clock.wait_until(until, lambda: self._link.is_cancelled)

    def _descriptors(self) -> dict[str, str]:
        """What its USB descriptors say of it."""
        told = self._link.identity
        return {
            "product": told.product,
            "maker": told.maker,
            "serial number": told.serial,
            "release": told.release,
        }
