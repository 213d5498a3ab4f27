"""The SLM's panel in a bench file, or in a file of its own that several benches share."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import torch
from numpy.typing import NDArray
from pydantic import Field, model_validator

from labapp.common.errors import UserError
from labapp.files.file_lookup import find_part_file, split_part
from labapp.files.lut_file import LutTable, read_lut
from labapp.files.picture.grey_picture import read_grey_picture
from labapp.files.quantities import Amount, Finite, NanometresText, Positive, Share
from labapp.files.reading import FileModel, read_file, validate
from optics.slm import Panel, PanelMap


class MapTable(FileModel):
    """A picture file that covers the panel: PNG, TIFF or .npy of any resolution.

    Its values are used as they are in the file, not decoded from sRGB.
    """

    file: str

    def with_absolute_path(self, folder: Path) -> MapTable:
        """Return the table with the absolute path of its picture, relative to `folder`."""
        return self.model_copy(update={"file": str(folder / self.file)})

    def build(self) -> PanelMap:
        """Read the panel's map from its picture; UserError if that can't be read or is no map."""
        try:
            return PanelMap(torch.from_numpy(self._values()))
        except ValueError as error:
            raise UserError(f"{self.file}: {error}.") from error

    def _values(self) -> NDArray[np.float64]:
        """Read the picture's numbers, without decoding them from sRGB."""
        return read_grey_picture(Path(self.file), "a map of the panel").astype(np.float64)


class FlatnessTable(MapTable):
    """A picture of the panel's flatness: optical path that light gets besides the pattern.

    nm_per_grey is the optical path for a step of 1 in the file's values. It is negative for a
    vendor's correction picture, which is meant to be added to patterns. wrapped_nm is the path at
    which the picture wraps around, which is the vendor's wavelength. The picture is unwrapped;
    for that, neighbours must differ by less than half of wrapped_nm.
    """

    nm_per_grey: Finite
    wrapped_nm: Annotated[float, Field(gt=0, allow_inf_nan=False)] | None = None

    def _values(self) -> NDArray[np.float64]:
        path = super()._values() * self.nm_per_grey * 1e-9
        if self.wrapped_nm is not None and path.ndim == 2:
            for axis in (0, 1):
                path = np.unwrap(path, period=self.wrapped_nm * 1e-9, axis=axis)
        return path


Count = Annotated[int, Field(ge=1, le=100_000)]


class PanelTable(FileModel):
    """The SLM's panel in a bench or camera file.

    max_phase_pi maps a wavelength in nm to the highest phase in units of pi. unmodulated is None
    if it follows from the camera's polarisation. The other defaults switch a feature off;
    optics.slm.Panel describes all of them. lut is a file of phases, which read_lut() reads into
    `response`.
    """

    model: str
    width: Count
    height: Count
    pitch_um: Positive
    fill_factor: Annotated[float, Field(gt=0, le=1)]
    levels: Annotated[int, Field(ge=2, le=256)] = 256
    unmodulated: Share | None = None
    reflectivity: Share
    settling_ms: Annotated[float, Field(ge=0)]
    max_phase_pi: dict[NanometresText, Positive]
    frame_rate_hz: Positive = 60.0
    response_time_ms: Amount = 0.0
    coupling_um: Amount = 0.0
    flicker: Share = 0.0
    jitter_rad: Amount = 0.0
    front_reflection: Share = 0.0
    gap_reflection: Share = 0.0
    lut: str | None = None
    response: LutTable | None = None
    flatness: FlatnessTable | None = None
    illumination: MapTable | None = None

    @model_validator(mode="after")
    def _validate_panel(self) -> PanelTable:
        if self.lut is not None and self.response is not None:
            raise ValueError("give lut or response, not both")
        self._build_without_maps()
        return self

    def build(self) -> Panel:
        """Return the panel in SI units.

        Raises UserError if a file that the table names can't be read, or doesn't fit the panel.
        """
        table = self.resolve_files(Path()) if self.lut is not None else self
        maps = {
            name: getattr(self, name).build()
            for name in ("flatness", "illumination")
            if getattr(self, name) is not None
        }
        try:
            return table._build_without_maps(**maps)
        except ValueError as error:
            raise UserError(f"{self.model}: {error}.") from error

    def _build_without_maps(self, **maps: Any) -> Panel:
        panel = Panel(
            shape=(self.height, self.width),
            pitch=self.pitch_um * 1e-6,
            fill_factor=self.fill_factor,
            levels=self.levels,
            max_phase=tuple((float(nm) * 1e-9, p * math.pi) for nm, p in self.max_phase_pi.items()),
            unmodulated=self.unmodulated or 0.0,
            reflectivity=self.reflectivity,
            settling=self.settling_ms * 1e-3,
            frame_rate=self.frame_rate_hz,
            response_time=self.response_time_ms * 1e-3,
            coupling=self.coupling_um * 1e-6,
            flicker=self.flicker,
            jitter=self.jitter_rad,
            front_reflection=self.front_reflection,
            gap_reflection=self.gap_reflection,
            **maps,
        )
        if self.response is None:
            return panel
        return replace(panel, response=self.response.build(panel))

    def resolve_files(self, folder: Path) -> PanelTable:
        """Return the table with its look-up table read, and absolute paths of pictures.

        Paths are relative to `folder`. Raises UserError if the look-up table can't be read.
        """
        change: dict[str, Any] = {}
        if self.lut is not None:
            path = folder / self.lut
            change = {"lut": None, "response": read_lut(path, self.levels)}
            try:
                self.model_copy(update=change)._build_without_maps()
            except ValueError as error:
                raise UserError(f"{path}: {error}.") from error
        for name in ("flatness", "illumination"):
            table = getattr(self, name)
            if table is not None:
                change[name] = table.with_absolute_path(folder.resolve())
        return self.model_copy(update=change)


class PanelFile(PanelTable):
    """A panel file, which several benches can share."""

    version: Literal[1]


def read_panel(file: str, folder: Path) -> PanelTable:
    """Read a panel, given a bundled name or a path relative to `folder`.

    Raises UserError with file, key, value and rule.
    """
    path = find_part_file("panel", file, folder)
    data = read_file(path, PanelFile).model_dump(exclude={"version"})
    return validate(data, PanelTable, str(path)).resolve_files(path.parent)


def with_panel(data: dict[str, Any], folder: Path, source: str) -> dict[str, Any]:
    """Return a bench's plain data with its panel file included, if it names one.

    Keys beside `file` override those of the panel file. A table `polarisation` overrides the
    panel file's unmodulated share. `source` is the name of the bench file in errors.
    """
    found = split_part(data, "panel", source)
    if found is None:
        return data
    file, own = found
    given = read_panel(file, folder).model_dump()
    if "lut" in own:
        given["response"] = None
    if data.get("polarisation") is not None:
        given["unmodulated"] = None
    return data | {"panel": given | own}
