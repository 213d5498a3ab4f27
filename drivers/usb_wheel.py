"""What filter wheels on USB have in common: the link and the descriptors."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

from drivers.interfaces import Identity, Surroundings
from drivers.usb_link import UsbLink
from drivers.wheel import Wheel


class UsbWheel(Wheel):
    """Base of filter wheels that open and close a `UsbLink`; see Wheel."""

    usb_ids: ClassVar[tuple[int, int]]
    """Vendor and product ID."""

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
        """End the present call and all later ones; from any thread."""
        self._link.cancel()

    def unplugged_reason(self) -> str | None:
        """Return why it counts as unplugged; see Device."""
        return self._link.unplugged_reason()

    def _read_slot(self, command: str) -> int:
        return self._wait_at_slot(command, 0)

    def _wait_at_slot(self, command: str, target: int) -> int:
        """Wait until the target slot is reported repeatedly; return the slot.

        target: 0 for any slot.
        """
        raise NotImplementedError

    def _close(self) -> None:
        self._link.close()

    def _pause(self, seconds: float) -> None:
        """Wait for `seconds` between queries.

        The wait ends early at `_deadline`, and when the link is cancelled.
        """
        until = min(self._clock.now() + seconds, self._deadline)
        self._clock.wait_until(until, lambda: self._link.is_cancelled)

    def _descriptors(self) -> dict[str, str]:
        """Return what the USB descriptors say of the wheel's identity, as texts by name."""
        told = self._link.identity
        return {
            "product": told.product,
            "maker": told.maker,
            "serial number": told.serial,
            "release": told.release,
        }
