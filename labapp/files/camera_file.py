"""The camera file: a description of panel, lens and sensor, without devices."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal, Self, TypeVar

from pydantic import Field, model_validator

from labapp.common.errors import UserError
from labapp.files.calibration_file import CalibrationFile
from labapp.files.camera_noise_file import CameraNoiseFile
from labapp.files.lens_table import GhostTable, LensTable
from labapp.files.panel_file import PanelTable, with_panel
from labapp.files.quantities import Amount, Finite, Positive, Share
from labapp.files.reading import FileModel, read_file, validate
from labapp.files.sensor_file import SensorTable, with_sensor
from optics.camera import Camera, Sensor
from optics.camera.ghost import require_ghosts
from optics.polarisation import BeamSplitter, PolarisedPath, Polariser, SourcePolarisation


class PolarisedLightTable(FileModel):
    """Polarisation of the object's light; degree is that of linear polarisation, 0 by default."""

    degree: Share = 0.0
    angle_deg: Finite = 0.0

    def build(self) -> SourcePolarisation:
        return SourcePolarisation(self.degree, math.radians(self.angle_deg))


class PolariserTable(FileModel):
    """A polariser in the path to or from the panel.

    angle_deg is measured from the panel's modulated axis. extinction is the power along the
    polariser's axis over the power across it, for example 1000 for 1000:1; inf is ideal.
    transmission is that along the axis.
    """

    angle_deg: Finite = 0.0
    extinction: Annotated[float, Field(ge=1)] = math.inf
    transmission: Annotated[float, Field(gt=0, le=1)] = 1.0

    def build(self) -> Polariser:
        return Polariser(math.radians(self.angle_deg), self.extinction, self.transmission)


class SplitterTable(FileModel):
    """A beam splitter cube, which light passes on its way to the panel and back.

    transmitted and reflected are shares of p and s light. angle_deg is the angle from the panel's
    modulated axis to the p direction. first says whether the light is transmitted or reflected on
    its way to the panel.
    """

    transmitted: tuple[Share, Share] = (0.5, 0.5)
    reflected: tuple[Share, Share] = (0.5, 0.5)
    angle_deg: Finite = 0.0
    first: Literal["transmitted", "reflected"] = "transmitted"

    @model_validator(mode="after")
    def _makes_no_light(self) -> SplitterTable:
        self.build()
        return self

    def build(self) -> BeamSplitter:
        return BeamSplitter(self.transmitted, self.reflected, math.radians(self.angle_deg))


class PolarisationTable(FileModel):
    """The polarising elements of a camera in the order of the light; elements left out are absent.

    The panel's unmodulated share and a part of the camera's transmission follow from them.
    """

    light: PolarisedLightTable = PolarisedLightTable()
    polariser: PolariserTable | None = None
    splitter: SplitterTable | None = None
    analyser: PolariserTable | None = None

    @model_validator(mode="after")
    def _passes_light(self) -> PolarisationTable:
        self.build().effect()
        return self

    def build(self) -> PolarisedPath:
        return PolarisedPath(
            self.light.build(),
            self.polariser.build() if self.polariser else None,
            self.splitter.build() if self.splitter else None,
            self.analyser.build() if self.analyser else None,
            self.splitter.first if self.splitter else "transmitted",
        )


class CameraFile(FileModel):
    """A camera file: the description of panel, lens and sensor, and their calibration.

    transmission is the share of the light that passes everything except the panel and the
    elements in `polarisation`. The panel's unmodulated share is either given or follows from
    `polarisation`. calibration is the name of a file that `labapp calibrate` wrote, or its
    contents; its measurements replace the description. camera_calibration is likewise that of
    `labapp calibrate --camera`, whose measurements replace those of the sensor. glare is
    the share of the light that veils the picture evenly. vibration_um is how far the image trembles
    on the sensor, root mean square along each axis, vibration_hz how often; without vibration_hz,
    many times in every exposure. ghosts are copies of the picture that the lens' reflections make.
    focus_drift_um is how far behind the sensor the image comes to lie while the camera warms up,
    focus_drift_s the time constant.
    """

    version: Literal[1]
    name: str
    transmission: Share
    panel: PanelTable
    lens: LensTable
    sensor: SensorTable
    polarisation: PolarisationTable | None = None
    calibration: str | CalibrationFile | None = None
    camera_calibration: str | CameraNoiseFile | None = None
    glare: Share = 0.0
    vibration_um: Amount = 0.0
    vibration_hz: Positive | None = None
    ghosts: tuple[GhostTable, ...] = ()
    focus_drift_um: Finite = 0.0
    focus_drift_s: Positive = 1800.0

    @model_validator(mode="after")
    def _require_one_unmodulated_share(self) -> Self:
        given, table = self.panel.unmodulated, self.polarisation
        if given is None and table is None:
            raise ValueError(
                "key 'panel.unmodulated' is missing; add it, or a table [polarisation] from "
                "which it follows"
            )
        if given is not None and table is not None:
            share = float(table.build().effect().unmodulated)
            raise ValueError(
                f"key 'panel.unmodulated' is {given:g}, and from the table 'polarisation' follows "
                f"{share:.3g}; remove one of the two"
            )
        return self

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        """Check that the ghosts leave light, and the lens' data reach as far as the sensor."""
        require_ghosts([one.build() for one in self.ghosts])
        table = self.sensor
        sensor = Sensor((table.height, table.width), table.pitch)
        Camera(lens=self.lens.build(), sensor=sensor, focus_drift=self.focus_drift_um * 1e-6)
        return self

    @property
    def active_calibration(self) -> CalibrationFile | None:
        """The bench's calibration, given or read from the file named; None if there is none."""
        if isinstance(self.calibration, str):
            return read_file(Path(self.calibration), CalibrationFile)
        return self.calibration

    @property
    def active_camera_calibration(self) -> CameraNoiseFile | None:
        """The camera noise's calibration, given or read; None if there is none."""
        if isinstance(self.camera_calibration, str):
            return read_file(Path(self.camera_calibration), CameraNoiseFile)
        return self.camera_calibration

    @property
    def interference(self) -> float | None:
        """Strength of the interference of modulated and unmodulated light; None if it isn't known.

        The sum of their irradiances leaves it out; see optics.polarisation.PathEffect.
        """
        if self.polarisation is None:
            return None
        return float(self.polarisation.build().effect().interference.abs())

    def without_calibration(self) -> Self:
        """Return what is described, without its calibrations."""
        return self.model_copy(update={"calibration": None, "camera_calibration": None})

    def build_camera(self) -> Camera:
        """Return the calibrated camera.

        Raises UserError if a calibration is of another panel or sensor.
        """
        described, noise = self._build_nominal_camera(), self.active_camera_calibration
        if noise is not None:
            try:
                described = replace(described, sensor=noise.apply_to(described.sensor))
            except ValueError as error:
                raise UserError(
                    f"the camera calibration of {noise.date:%Y-%m-%d} is not of this sensor: "
                    f"{error}. Calibrate it with labapp calibrate --camera, or remove the key "
                    "'camera_calibration' from the bench file."
                ) from error
        calibration = self.active_calibration
        if calibration is None:
            return described
        try:
            return calibration.apply_to(described)
        except ValueError as error:
            raise UserError(
                f"the calibration of {calibration.date:%Y-%m-%d} is not of this panel: {error}. "
                "Calibrate this bench, or remove the key 'calibration' from its file."
            ) from error

    def _build_nominal_camera(self) -> Camera:
        panel, transmission = self.panel.build(), self.transmission
        if self.polarisation is not None:
            effect = self.polarisation.build().effect()
            panel = replace(panel, unmodulated=float(effect.unmodulated))
            transmission *= float(effect.transmission)
        separation = self.lens.separation_mm * 1e-3
        lens, sensor = self.lens.build(), self.sensor.build()
        return Camera(
            panel,
            lens,
            sensor,
            transmission,
            separation,
            self.glare,
            self.vibration_um * 1e-6,
            self.vibration_hz or math.inf,
            tuple(one.build() for one in self.ghosts),
            focus_drift=self.focus_drift_um * 1e-6,
            focus_drift_time=self.focus_drift_s,
        )


C = TypeVar("C", bound=CameraFile)


def resolve_included_files(data: dict[str, Any], path: Path, model: type[C]) -> C:
    """Return a camera or a bench with the contents of the files that it includes.

    Panel and sensor may be files of their own, as in `panel = { file = "mine.toml" }`, or names
    of bundled ones (see labapp.files.panel_file and sensor_file). Keys beside `file` override
    those of the included file. Files are searched for in the folder of the file that names them.
    Large pictures are kept as absolute paths, so that a record of the result can be read again.
    Raises UserError with file, key, value and rule.
    """
    folder = path.resolve().parent
    source = str(path)
    whole = with_sensor(with_panel(data, folder, source), folder, source)
    file = validate(whole, model, source)
    if not file.sensor.has_all_curves:
        # The sensor can be validated as a whole only when its curves have been read.
        curves = file.sensor.resolve_files(folder).model_dump()
        file = validate(whole | {"sensor": curves}, model, source)
    found: dict[str, Any] = {"panel": file.panel.resolve_files(folder)}
    if isinstance(file.calibration, str):
        found["calibration"] = read_file(folder / file.calibration, CalibrationFile)
    if isinstance(file.camera_calibration, str):
        found["camera_calibration"] = read_file(folder / file.camera_calibration, CameraNoiseFile)
    return file.model_copy(update=found)
