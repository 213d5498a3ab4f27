"""The file CONFIG of `labapp train edof`: what is trained, on what scenes, and how."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, field_validator, model_validator

from labapp.common.errors import UserError
from labapp.edof.design_request import PARAMETRISATION_NAMES, STARTS, EdofRequest
from labapp.files.quantities import Amount, Nanometres, Positive, Share
from labapp.files.reading import FileModel, bundled_path, read_file
from labapp.training.pictures import SHORTEST_EDGES
from labapp.training.scenes import SceneSettings
from optics.edof.learned import DecoderSettings, NetworkShape

Count = Annotated[int, Field(gt=0)]
"""A whole number of 1 or more."""


class PatternTable(FileModel):
    """The pattern before training: designed without pictures, or taken as it is.

    start: one of STARTS, or a design file.
    parameters: how the pattern is described; the symmetry stays in training.
    design_steps: of the design without pictures, as by `labapp design edof`; 0 takes the start as
    it is.
    design_noise: standard deviation of the noise that is designed for, where white is 1.
    fringing_um: blur of the panel's phase by fringing fields, its standard deviation, that the
    pattern shall stand although the decoder doesn't know of it; 0 for none.
    response_error: relative error of the panel's response that it shall stand likewise.
    """

    start: str = "rings"
    parameters: str = "quarter"
    design_steps: Annotated[int, Field(ge=0)] = 2000
    design_noise: Annotated[float, Field(gt=0, lt=1)] = 0.008
    fringing_um: Amount = 0.0
    response_error: Annotated[float, Field(ge=0, le=0.5)] = 0.0

    @field_validator("parameters")
    @classmethod
    def _require_parametrisation(cls, name: str) -> str:
        if name not in PARAMETRISATION_NAMES:
            raise ValueError(f"choose {', '.join(PARAMETRISATION_NAMES)}")
        return name

    @field_validator("start")
    @classmethod
    def _require_start(cls, name: str) -> str:
        if name not in STARTS and not name.endswith(".h5"):
            raise ValueError(f"choose {', '.join(STARTS)}, or give a design file (.h5)")
        return name


class ScenesTable(FileModel):
    """What is in front of the camera in training.

    light: whether pictures' sRGB values are taken as light, or decoded to light. Decoders of linear
    light work in sRGB within, and are scored there.
    binning: sensor pixels along a side of the squares that are averaged into a pixel.
    shortest_edges: range of pixels of the shortest edge to which photographs are averaged down, so
    that they are sharp; smaller ones stay as they are.
    layered_share, most_layers: share of scenes with several layers that hide each other, and the
    most layers of one.
    spectrum: the power spectrum that patterns and filters take pictures to have: that of natural
    photographs at full resolution, or that of the training's own pictures.
    procedural_share: share of pictures that are drawn instead of cut from photographs. Without
    photographs all are.
    """

    light: Literal["srgb", "linear"] = "srgb"
    binning: Count = 1
    shortest_edges: tuple[Positive, Positive] = SHORTEST_EDGES
    layered_share: Share = 0.5
    most_layers: Annotated[int, Field(ge=2)] = 4
    procedural_share: Share = 0.1
    spectrum: Literal["natural", "measured"] = "measured"

    @property
    def settings(self) -> SceneSettings:
        """How many scenes have layers, and how many layers."""
        return SceneSettings(self.layered_share, self.most_layers)


class CaptureTable(FileModel):
    """The noise and the unmodulated light of captures in training.

    noise: range of the standard deviation, where white is 1; it or its logarithm is drawn evenly.
    unmodulated: range of the share of light that the panel leaves unmodulated.
    """

    noise: tuple[Positive, Positive] = (0.001, 0.02)
    spread: Literal["even", "logarithmic"] = "even"
    unmodulated: tuple[Share, Share] = (0.0, 0.06)

    @model_validator(mode="after")
    def _require_order(self) -> CaptureTable:
        if self.noise[0] > self.noise[1]:
            raise ValueError(f"noise is {list(self.noise)}; give the smaller deviation first")
        if self.unmodulated[0] > self.unmodulated[1]:
            raise ValueError(
                f"unmodulated is {list(self.unmodulated)}; give the smaller share first"
            )
        return self


class DepthsTable(FileModel):
    """The depths of training.

    count: depths whose transfer functions are kept: midpoints of equal parts of the range.
    importance: how depths are drawn: evenly in dioptres, in which equal steps defocus equally; or
    by how much the PSF changes with the distance in metres (thesis Eq. 5.10).
    distances_m: drawn instead, all equally often; for a published procedure.
    """

    count: Count = 256
    importance: Literal["even", "focus-shift"] = "even"
    distances_m: tuple[Positive, ...] = ()


class DecoderTable(FileModel):
    """The decoder: a filter before a U-Net, whose size `optics.edof.learned.NetworkShape` tells.

    front: one filter for all depths, that of the capture's depth, or none.
    psf_channel: whether the network is given the true PSF, as the published code does.
    """

    front: Literal["blind", "known", "none"] = "blind"
    psf_channel: bool = False
    channels: Count = 16
    levels: Annotated[int, Field(ge=1, le=6)] = 4
    fold: Annotated[int, Field(ge=1, le=8)] = 2
    convolutions: Count = 2
    dilations: tuple[Count, ...] = ()
    overlapping: bool = False

    def settings(self, light: Literal["srgb", "linear"]) -> DecoderSettings:
        """Return the settings of the decoder for captures of some light."""
        size = self.channels, self.levels, self.fold, self.convolutions
        shape = NetworkShape(*size, self.dilations, self.overlapping)
        return DecoderSettings(shape, self.front, self.psf_channel, light)


class TrainingTable(FileModel):
    """How the decoder is trained; rates, decay and clip are as in `TrainingSchedule`.

    side: pixels along a side of a scene, which is periodic; even.
    samples: scenes of a step.
    loss: the mean of the logarithm of a scene's mean squared error, which is that of the PSNR in
    dB, or of the mean squared error itself (thesis Eq. 5.9).
    structure_weight: of 1 - SSIM, which is added to the loss "level"; 0 leaves it out.
    """

    side: Annotated[int, Field(ge=32)] = 128
    samples: Count = 8
    loss: Literal["level", "squared"] = "level"
    structure_weight: Annotated[float, Field(ge=0, allow_inf_nan=False)] = 0.0
    first_rate: Positive = 1e-3
    last_rate: Positive = 2e-5
    warm_up: Annotated[int, Field(ge=0)] = 100
    average_decay: Annotated[float, Field(ge=0, lt=1)] = 0.999
    clip: Positive = 5.0
    validation_interval: Count = 1000
    validation_scenes: Count = 64

    @field_validator("side")
    @classmethod
    def _require_even(cls, side: int) -> int:
        if side % 2:
            raise ValueError("give an even number of pixels")
        return side

    @model_validator(mode="after")
    def _require_falling_rate(self) -> TrainingTable:
        _require_falling(self.first_rate, self.last_rate)
        return self


class JointTable(FileModel):
    """The joint training of pattern and decoder, after that of the decoder alone.

    share: of all steps; 0 leaves the pattern as designed.
    samples: scenes of a step; each has one depth whose transfer function is computed anew.
    first_rate, last_rate: learning rates of the decoder.
    pattern_rate: learning rate of the pattern in radians, at the first rate; 0 keeps the pattern,
    for a comparison.
    parts: of the range of depths, whose transfer functions are remembered for the filter.
    """

    share: Share = 0.15
    samples: Count = 4
    first_rate: Positive = 2e-4
    last_rate: Positive = 1e-5
    pattern_rate: Amount = 0.01
    parts: Count = 64

    @model_validator(mode="after")
    def _require_falling_rate(self) -> JointTable:
        _require_falling(self.first_rate, self.last_rate)
        return self


def _require_falling(first_rate: float, last_rate: float) -> None:
    """Raise ValueError if the learning rate would grow."""
    if last_rate > first_rate:
        raise ValueError(
            f"last_rate is {last_rate:g} and first_rate {first_rate:g}; the last one may be as "
            "large at most"
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
        found: dict[str, Any] = {}
        for name, value in self.as_data().items():
            if isinstance(value, dict):
                found |= {f"config.{name}.{key}": one for key, one in value.items()}
            else:
                found[f"config.{name}"] = value
        return found


def read_edof_config(path: Path) -> EdofTrainingConfig:
    """Read a configuration; UserError if it is invalid."""
    return read_file(path, EdofTrainingConfig)
