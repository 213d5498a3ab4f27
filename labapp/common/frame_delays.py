"""The time that frames of a bench take beyond what its devices document."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class FrameDelays:
    """Measured seconds that a frame takes beyond what the devices document, or less than that.

    frame: of every frame: calls of the devices, checks, and the picture's way to memory.
    filter, slm, target: of the first frame after a change of wavelength, pattern or target.
    """

    frame: float = 0.0
    filter: float = 0.0
    slm: float = 0.0
    target: float = 0.0

    def __str__(self) -> str:
        """Return the delays in words, for the log."""
        return (
            f"beyond what its devices document, a frame takes {self.frame * 1e3:.0f} ms, the first "
            f"after a change of wavelength {self.filter * 1e3:.0f} ms more, of pattern "
            f"{self.slm * 1e3:.0f} ms more"
        )
