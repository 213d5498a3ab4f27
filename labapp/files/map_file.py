"""Pictures of what differs from place to place on a panel: its flatness, the light on it."""

from __future__ import annotations

import io
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import torch
from numpy.typing import NDArray
from pydantic import Field

from labapp.common.errors import UserError
from labapp.files.quantities import Finite
from labapp.files.reading import FileModel, decode_image, read_bytes
from optics.slm import PanelMap


class MapTable(FileModel):
    """A picture that covers the panel, as coarse or as fine as it is: 8- or 16-bit or float PNG
    or TIFF, or NumPy's .npy. Its values are as they are in the file, not sRGB."""

    file: str

    def with_absolute_path(self, folder: Path) -> MapTable:
        """With an absolute path, looked for in `folder`."""
        return self.model_copy(update={"file": str(folder / self.file)})

    def build(self) -> PanelMap:
        """UserError if the file can't be read, or holds no map."""
        return self._map(_values(Path(self.file)))

    def _map(self, values: NDArray[np.float64]) -> PanelMap:
        try:
            return PanelMap(torch.from_numpy(values))
        except ValueError as error:
            raise UserError(f"{self.file}: {error}.") from error


class FlatnessTable(MapTable):
    """Optical path that light gets besides the pattern.

    nm_per_grey: of path, for 1 of the file's values; negative for a vendor's correction
    picture, which is to be added to patterns. wrapped_nm: the path at which the picture begins
    anew, the vendor's wavelength; it is unwrapped, which needs neighbours that differ by less
    than half of it.
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
    values: NDArray[Any] | None = None
    if path.suffix.lower() == ".npy":
        with suppress(ValueError, EOFError):
            values = np.load(io.BytesIO(read_bytes(path)), allow_pickle=False)
    else:
        values = decode_image(path, colour=False)
    if values is None or values.dtype.kind not in "iuf":
        raise UserError(f"{path}: is no map. Give a grey PNG or TIFF, or numbers as .npy.")
    return values.astype(np.float64)
