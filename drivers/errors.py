"""How a device says that something went wrong."""

from __future__ import annotations


class DeviceError(Exception):
    """A failure of a device, in words that a person at the bench can act on.

    device: its model. command: what it was asked. reply: what it answered.
    remedy: what to try. role: what the bench calls it (slm, filter, camera, targets), once
    the bench has passed the error on.
    """

    role = ""

    def __init__(self, device: str, command: str, reply: str, remedy: str) -> None:
        super().__init__(device, command, reply, remedy)
        self.device, self.command, self.reply, self.remedy = device, command, reply, remedy

    def __str__(self) -> str:
        return f"{self.device}: {self.command}: {self.reply}. {self.remedy}"
