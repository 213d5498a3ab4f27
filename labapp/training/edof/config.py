"""The file CONFIG of `labapp train edof`: what is trained, on what scenes, and how."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from labapp.common.errors import UserError
from labapp.edof.design_request import STARTS, EdofRequest
from labapp.files.quantities import Nanometres
from labapp.files.reading import FileModel, bundled_path, read_file
from labapp.training.edof.config_tables import (
    CaptureTable,
    DecoderTable,
    DepthsTable,
    JointTable,
    PatternTable,
    ScenesTable,
    TrainingTable,
)

BUNDLED_CONFIG = bundled_path("edof-training.toml")
"""The configuration with which the bundled pattern and its decoder were trained."""

DEFAULT_BENCH = bundled_path("studies/edof-bench.toml")
"""The bench that is trained for unless the configuration names one: that of thesis chapter 5."""

_Dioptre = Annotated[float, Field(ge=0, lt=math.inf)]


class EdofTrainingConfig(FileModel):
    """The file of `labapp train edof`."""

    version: Literal[1] = 1
    seed: Annotated[int, Field(ge=0)] = 1
    bench: str | None = None
    wavelength_nm: Nanometres = 520.0
    far_dioptre: _Dioptre = 0.0
    near_dioptre: _Dioptre = 2.0
    pattern: PatternTable = PatternTable()
    scenes: ScenesTable = ScenesTable()
    capture: CaptureTable = CaptureTable()
    depths: DepthsTable = DepthsTable()
    decoder: DecoderTable = DecoderTable()
    training: TrainingTable = TrainingTable()
    joint: JointTable = JointTable()

    @model_validator(mode="after")
    def _require_consistency(self) -> EdofTrainingConfig:
        if self.far_dioptre >= self.near_dioptre:
            raise ValueError(
                f"near_dioptre is {self.near_dioptre:g} and far_dioptre {self.far_dioptre:g}; near "
                "must be more than far: dioptres are 1 over metres, and 0 is infinity"
            )
        multiple = self.decoder.settings(self.scenes.light).shape.multiple
        if self.training.side % multiple:
            raise ValueError(
                f"training.side is {self.training.side}; this decoder needs a multiple of "
                f"{multiple} pixels"
            )
        return self

    @property
    def wavelength(self) -> float:
        """The wavelength that is trained for, metres."""
        return self.wavelength_nm * 1e-9

    def design_request(self, folder: Path) -> EdofRequest:
        """Return the request for the pattern before training; paths are relative to `folder`.

        Raises UserError if there is no file of that name to start from.
        """
        start = self.pattern.start
        if start not in STARTS and not (folder / start).is_file():
            raise UserError(
                f'start = "{start}" in [pattern]: {folder / start} doesn\'t exist. Choose '
                f"{', '.join(STARTS)}, or name a design file, relative to the configuration."
            )
        bench = DEFAULT_BENCH if self.bench is None else folder / self.bench
        return EdofRequest(
            bench,
            (self.wavelength,),
            self.near_dioptre,
            self.far_dioptre,
            self.pattern.design_noise,
            "known" if self.decoder.front == "known" else "blind",
            None,
            start if start in STARTS else str(folder / start),
            self.pattern.parameters,
            512 // self.scenes.binning // 2 * 2,
            1,
            self.seed,
            self.scenes.binning,
            1e-6 * self.pattern.fringing_um,
            self.pattern.response_error,
        )

    def as_data(self) -> dict[str, Any]:
        """Return the configuration as plain data, as its file has it."""
        return self.model_dump(mode="json")

    def as_settings(self) -> dict[str, Any]:
        """Return all keys and values side by side, as "config.training.side"."""
        return dict(_flatten("config", self.as_data()))


def _flatten(name: str, value: Any) -> Iterator[tuple[str, Any]]:
    """Yield the keys and values of a table, with the table's name before them."""
    if not isinstance(value, Mapping):
        yield name, value
        return
    for key, one in value.items():
        yield from _flatten(f"{name}.{key}", one)


def read_edof_config(path: Path) -> EdofTrainingConfig:
    """Read a configuration; UserError if it is invalid."""
    return read_file(path, EdofTrainingConfig)
