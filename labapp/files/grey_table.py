"""Patterns that a plan gives as grey levels, not as phases."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

from annotated_types import Ge, Le, MultipleOf

from labapp.common.errors import UserError
from labapp.files.table import Key, Table

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from optics.camera import Camera, Panel

Grey = Annotated[int, Ge(0), Le(255)]

_LOSSY_ENDINGS = (".jpg", ".jpeg", ".webp", ".avif", ".heic")
"""Endings of pictures whose compression changes grey levels."""


class GreyPattern(Table):
    """A pattern of a plan file that is given as grey levels, whatever phases they make."""

    @property
    def depends_on_seed(self) -> bool:
        """Whether the levels depend on the plan's seed."""
        return False

    @property
    def label(self) -> str:
        """The description on the screen and in records."""
        raise NotImplementedError

    def with_least_work(self) -> GreyPattern:
        """Reduce the work to what shows whether the pattern can be computed."""
        return self

    def grey_levels(self, camera: Camera, folder: Path) -> NDArray[np.uint8]:
        """Return the grey levels on the camera's panel, (rows, columns).

        Pictures are read from `folder`. Raises UserError if the panel can't show the levels.
        """
        raise NotImplementedError


class ConstantPattern(GreyPattern):
    """A neutral pattern: one grey level everywhere."""

    title: ClassVar = "Neutral"
    kind: Literal["constant"]
    grey: Annotated[Grey, Key("level")] = 0

    @property
    def label(self) -> str:
        return "neutral" if self.grey == 0 else f"grey {self.grey}"

    def grey_levels(self, camera: Camera, folder: Path) -> NDArray[np.uint8]:
        import numpy as np

        return np.full(camera.panel.shape, self.grey, dtype=np.uint8)


class GratingPattern(GreyPattern):
    """Equally wide stripes of two grey levels, whose zeroth order tells the phase between them."""

    kind: Literal["grating"]
    period_px: Annotated[int, Ge(2), Le(4096), MultipleOf(2), Key("of both stripes")] = 16
    low: Annotated[Grey, Key("level")] = 0
    high: Annotated[Grey, Key("level")]
    axis: Annotated[Literal["x", "y"], Key("along which levels change")] = "x"

    @property
    def label(self) -> str:
        return f"grating {self.period_px} px, grey {self.low} and {self.high}"

    def grey_levels(self, camera: Camera, folder: Path) -> NDArray[np.uint8]:
        import numpy as np

        rows, columns = np.indices(camera.panel.shape)
        stripes = (columns if self.axis == "x" else rows) // (self.period_px // 2)
        return np.where(stripes % 2, self.high, self.low).astype(np.uint8)


class ImagePattern(GreyPattern):
    """Grey levels from an 8-bit picture of the panel's size, or from a design file (.h5).

    channel is the one to take of a picture in colour.
    """

    title: ClassVar = "Image file"
    kind: Literal["image"]
    file: Annotated[
        str,
        Key(
            "picture, or .h5 of labapp pattern or retrieve",
            "8-bit picture of the panel's size, or a design file",
        ),
    ]
    frame: Annotated[int, Ge(0), Key("of a design file, from 0")] = 0
    channel: Annotated[Literal["red", "green", "blue"] | None, Key("of a picture in colour")] = None

    @property
    def label(self) -> str:
        which = f" frame {self.frame}" if self.frame else ""
        lossy = ", lossy" if self.file.lower().endswith(_LOSSY_ENDINGS) else ""
        return f"image {self.file.rpartition('/')[2]}{which}{lossy}"

    def grey_levels(self, camera: Camera, folder: Path) -> NDArray[np.uint8]:
        from labapp.files.design_file import read_design_frame
        from labapp.files.output_paths import is_design

        path = folder / self.file
        if is_design(path):
            if self.channel is not None:
                raise UserError(f"{path}: is a design, in grey. Leave 'channel' out.")
            return _require_panel_fit(camera.panel, read_design_frame(path, self.frame), path)
        if self.frame:
            raise UserError(f"{path}: is one picture. Leave 'frame' out, or name a design file.")
        return read_grey_pattern(path, camera.panel, self.channel)


def read_grey_pattern(path: Path, panel: Panel, channel: str | None = None) -> NDArray[np.uint8]:
    """Read a picture, or a channel of one in colour, as grey levels, (rows, columns).

    Raises UserError if the panel can't show them.
    """
    from labapp.files.picture.grey_picture import read_grey_picture

    remedy = ', or name one in the plan: channel = "red"'
    grey = read_grey_picture(path, "a pattern", channel=channel, remedy=remedy)
    if grey.dtype != "uint8":
        raise UserError(f"{path}: has {grey.dtype} values; the panel shows 8-bit grey levels.")
    return _require_panel_fit(panel, grey, path)


def _require_panel_fit(panel: Panel, grey: NDArray[np.uint8], path: Path) -> NDArray[np.uint8]:
    """Return the grey levels; raise UserError with their path if the panel can't show them."""
    from optics.slm import require_grey

    try:
        require_grey(panel, grey)
    except (TypeError, ValueError) as error:
        raise UserError(f"{path}: {error}.") from error
    return grey


GREY_PATTERNS: tuple[type[GreyPattern], ...] = (ConstantPattern, GratingPattern, ImagePattern)
"""All kinds of grey-level patterns, in the order in which they are listed."""
