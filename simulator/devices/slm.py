"""An SLM that shows patterns and videos on the virtual bench's panel."""

from __future__ import annotations

from typing import Self

import numpy as np
from numpy.typing import NDArray

from drivers.interfaces import Setting, Surroundings
from optics.slm import require_grey
from optics.validation import require_positive
from simulator.devices.base import SimulatedDevice


class SimulatedSLM(SimulatedDevice):
    """Simulate a phase-only SLM whose panel is that of the virtual world.

    Parameters
    ----------
    surroundings : Surroundings
        The bench's clock and its virtual world.
    frame_rate_hz : float, optional
        Frames of a video per second, positive; the panel's own rate by default.

    Raises
    ------
    ValueError
        If the frame rate isn't positive.
    DeviceError
        If the bench has no virtual world.
    """

    model = "simulated SLM"
    role = "slm"

    def __init__(self, surroundings: Surroundings, frame_rate_hz: float | None = None) -> None:
        super().__init__(surroundings)
        rate = self._world.camera.panel.frame_rate if frame_rate_hz is None else frame_rate_hz
        require_positive("frame_rate_hz", rate, "Hz")
        self.frame_time = 1 / rate
        self.displayed_pattern = "neutral"

    def __enter__(self) -> Self:
        super().__enter__()
        # Opening the SLM clears what it showed before.
        self._world.grey = np.zeros(self.shape, dtype=np.uint8)
        return self

    @property
    def shape(self) -> tuple[int, int]:
        """Return the panel's rows and columns."""
        return self._world.camera.panel.shape

    @property
    def settling(self) -> float:  # type: ignore[override]
        """Return the time in seconds until a new pattern stands."""
        return self._world.camera.panel.settling

    def show(self, identifier: str, grey: NDArray[np.uint8]) -> Setting[str]:
        """Show a pattern of grey levels (rows, columns)."""
        return self._present(f"show {identifier}", identifier, np.asarray(grey)[None])

    def play(self, identifier: str, video: NDArray[np.uint8]) -> Setting[str]:
        """Show a repeating video of grey levels (frames, rows, columns)."""
        if video.ndim != 3 or not len(video):
            reply = f"a video of shape {video.shape}; it needs frames, rows and columns"
            raise self._refuse(f"play {identifier}", reply, "Compute it again")
        return self._present(f"play {identifier}", identifier, video)

    def make_safe(self) -> None:
        """Show the neutral pattern, the safe state."""
        self.show("neutral", np.zeros(self.shape, dtype=np.uint8))

    def _present(self, command: str, identifier: str, frames: NDArray[np.uint8]) -> Setting[str]:
        """Show frames under an identifier; refuse frames that don't fit the panel."""
        self._faults.begin(command, self.reply_time)
        try:
            for grey in frames:
                require_grey(self._world.camera.panel, grey)
        except (TypeError, ValueError) as error:
            raise self._refuse(command, str(error), "Compute it again") from error
        self._world.play(frames, self.frame_time)
        self.displayed_pattern = identifier
        return Setting(identifier, identifier, self._clock.now() + self.settling)
