"""The one exception that every device raises."""

from __future__ import annotations


class DeviceError(Exception):
    """Raised if a device fails, with a message that a person at the bench can act on.

    device: the device's model. command: the command that failed. reply: the device's reply.
    remedy: what to try. role: the device's role on the bench (slm, filter, camera, targets), empty
    until the bench passes the error on. lasting: whether another try would fail in the same way, so
    that a run stops.
    """

    role = ""
    lasting = False

    def __init__(self, device: str, command: str, reply: str, remedy: str) -> None:
        super().__init__(device, command, reply, remedy)
        self.device, self.command, self.reply, self.remedy = device, command, reply, remedy

    def __str__(self) -> str:
        return f"{self.device}: {self.command}: {self.reply}. {self.remedy}"
