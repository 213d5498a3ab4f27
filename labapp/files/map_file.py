"""Pictures of quantities that vary over a panel: its flatness, and its illumination."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
import torch
from numpy.typing import NDArray
from pydantic import Field

from labapp.common.errors import UserError
from labapp.files.picture.grey_picture import read_grey_picture
from labapp.files.quantities import Finite
from labapp.files.reading import FileModel
from optics.slm import PanelMap


class MapTable(FileModel):
    """A picture file that covers the panel, of any resolution.

    It is an 8-bit, 16-bit or floating-point PNG or TIFF, or a NumPy .npy. Its values are used as
    they are in the file, not decoded from sRGB.
    """

    file: str

    def with_absolute_path(self, folder: Path) -> MapTable:
        """Return the table with the absolute path of its picture, relative to `folder`."""
        return self.model_copy(update={"file": str(folder / self.file)})

    def build(self) -> PanelMap:
        """Read the panel's map from its picture.

        Raises UserError if it can't be read or is no map.
        """
        return self._map(_values(Path(self.file)))

    def _map(self, values: NDArray[np.float64]) -> PanelMap:
        try:
            return PanelMap(torch.from_numpy(values))
        except ValueError as error:
            raise UserError(f"{self.file}: {error}.") from error


class FlatnessTable(MapTable):
    """A picture of the panel's flatness: optical path that light gets besides the pattern.

    nm_per_grey is the optical path for a step of 1 in the file's values. It is negative for a
    vendor's correction picture, which is meant to be added to patterns. wrapped_nm is the path at
    which the picture wraps around, which is the vendor's wavelength. The picture is unwrapped;
    for that, neighbours must differ by less than half of wrapped_nm.
    """

    nm_per_grey: Finite
    wrapped_nm: Annotated[float, Field(gt=0, allow_inf_nan=False)] | None = None

    def build(self) -> PanelMap:
        path = _values(Path(self.file)) * self.nm_per_grey * 1e-9
        if self.wrapped_nm is not None and path.ndim == 2:
            for axis in (0, 1):
                path = np.unwrap(path, period=self.wrapped_nm * 1e-9, axis=axis)
        return self._map(path)


def _values(path: Path) -> NDArray[np.float64]:
    """Read a picture's numbers, without decoding them from sRGB."""
    return read_grey_picture(path, "a map of the panel").astype(np.float64)
