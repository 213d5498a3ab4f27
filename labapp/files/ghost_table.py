"""Tables [[ghosts]]: copies of the picture that a lens' reflections make."""

from __future__ import annotations

from pydantic import model_validator

from labapp.files.quantities import Amount, Finite, Share
from labapp.files.reading import FileModel
from optics.camera.ghost import Ghost


class GhostTable(FileModel):
    """One ghost of the lens; optics.camera.ghost.Ghost describes it.

    share is that of the light which falls on the sensor as this ghost, magnification the ghost's
    size over that of the picture, negative if it is turned by 180°, and blur_mm the diameter of the
    disc that a point becomes.
    """

    share: Share
    magnification: Finite
    blur_mm: Amount = 0.0

    @model_validator(mode="after")
    def _validate_ghost(self) -> GhostTable:
        self.build()
        return self

    def build(self) -> Ghost:
        """Return the ghost, its blur in metres."""
        return Ghost(self.share, self.magnification, self.blur_mm * 1e-3)
