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
from labapp.files.field_aberrations_table import FieldAberrationsTable
from labapp.files.ghost_table import GhostTable
from labapp.files.panel_file import PanelTable, with_panel
from labapp.files.polarisation_table import PolarisationTable
from labapp.files.quantities import Amount, Finite, Nanometres, Positive, Share
from labapp.files.reading import FileModel, read_file, validate
from labapp.files.sensor_file import SensorTable, with_sensor
from optics.camera import Camera, Lens, Sensor
from optics.camera.ghost import require_ghosts
from optics.camera.stop import Circle, Stop, regular_polygon
from optics.slm import Panel


class LensTable(FileModel):
    """The lens and its stop in a camera file.

    The defaults switch a feature off; optics.camera.Lens describes all of them. separation_mm is
    the distance from the panel to the lens. blades is the number of straight blades of the stop,
    0 for a round stop. obscuration is the radius of a central disc that hides the stop, in stop
    radii. aberrations are Zernike polynomials [n, m, nm of optical path, root mean square].
    relative_illumination is a data sheet's curve, pairs [mm of image height, share of the light on
    the axis] from [0, 1] to the sensor's corner; without it, the light falls with cos⁴. distortion
    is Brown's [k1, k2] for image heights over the image distance, as OpenCV calibrates them.
    axial_colour is a curve of pairs [nm, µm by which the image of that wavelength lies farther from
    the lens than the sensor], and lateral_colour one of [nm, percent by which it is larger].
    field_aberrations is a table of those that grow with the image height.
    """

    focal_length_mm: Positive
    f_number: Positive
    focus_distance_m: Annotated[float, Field(gt=0)]
    separation_mm: Amount = 0.0
    kind: Literal["thin", "stigmatic"] = "thin"
    blades: Annotated[int, Field(ge=0, le=1000)] = 0
    obscuration: Annotated[float, Field(ge=0, lt=1)] = 0.0
    aberrations: tuple[tuple[int, int, Finite], ...] = ()
    relative_illumination: tuple[tuple[Amount, Finite], ...] = ()
    distortion: tuple[Finite, Finite] = (0.0, 0.0)
    axial_colour: tuple[tuple[Nanometres, Finite], ...] = ()
    field_aberrations: FieldAberrationsTable | None = None
    lateral_colour: tuple[tuple[Nanometres, Finite], ...] = ()

    @model_validator(mode="after")
    def _validate_lens(self) -> LensTable:
        if self.focus_distance_m * 1e3 <= self.focal_length_mm:
            raise ValueError(
                f"focus_distance_m must be more than the focal length, {self.focal_length_mm:g} mm"
            )
        if self.blades in (1, 2):
            raise ValueError(
                f"blades is {self.blades}; a stop has three or more, or 0 for a round one"
            )
        self.build()
        return self

    def build(self) -> Lens:
        """Return the lens in SI units."""
        opening = regular_polygon(self.blades) if self.blades else Circle()
        obscured = (Circle(self.obscuration),) if self.obscuration else ()
        return Lens(
            self.focal_length_mm * 1e-3,
            self.f_number,
            self.focus_distance_m,
            Stop(opening, obscured),
            tuple((n, m, nanometres * 1e-9) for n, m, nanometres in self.aberrations),
            self.kind,
            tuple((height * 1e-3, share) for height, share in self.relative_illumination),
            self.distortion,
            tuple((one * 1e-9, shift * 1e-6) for one, shift in self.axial_colour),
            self.field_aberrations.build() if self.field_aberrations else None,
            tuple((one * 1e-9, change * 1e-2) for one, change in self.lateral_colour),
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
    def _require_light_for_ghosts(self) -> Self:
        require_ghosts([one.build() for one in self.ghosts])
        return self

    @model_validator(mode="after")
    def _require_lens_for_sensor(self) -> Self:
        """Check that the lens' data reach as far as the sensor."""
        table = self.sensor
        sensor = Sensor((table.height, table.width), table.pitch)
        Camera(lens=self.lens.build(), sensor=sensor, focus_drift=self.focus_drift_um * 1e-6)
        return self

    @property
    def active_calibration(self) -> CalibrationFile | None:
        """The bench's calibration, given or named; None if there is none.

        A calibration that is only named is read; UserError if it can't be.
        """
        if isinstance(self.calibration, str):
            return read_file(Path(self.calibration), CalibrationFile)
        return self.calibration

    @property
    def active_camera_calibration(self) -> CameraNoiseFile | None:
        """The calibration of the camera's noise, given or named; None if there is none.

        A calibration that is only named is read; UserError if it can't be.
        """
        if isinstance(self.camera_calibration, str):
            return read_file(Path(self.camera_calibration), CameraNoiseFile)
        return self.camera_calibration

    @property
    def interference(self) -> float | None:
        """Strength of the interference of modulated and unmodulated light.

        None without a description of the polarisation. The sum of their irradiances leaves this
        interference out; see optics.polarisation.PathEffect.
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
        described = self._apply_camera_calibration(self._build_nominal_camera())
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

    def _apply_camera_calibration(self, camera: Camera) -> Camera:
        """Return the camera with the sensor as its calibration measured it."""
        calibration = self.active_camera_calibration
        if calibration is None:
            return camera
        try:
            return replace(camera, sensor=calibration.apply_to(camera.sensor))
        except ValueError as error:
            raise UserError(
                f"the camera calibration of {calibration.date:%Y-%m-%d} is not of this sensor: "
                f"{error}. Calibrate it with labapp calibrate --camera, or remove the key "
                "'camera_calibration' from the bench file."
            ) from error

    def _build_nominal_camera(self) -> Camera:
        panel, transmission = self._apply_polarisation(self.panel.build())
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

    def _apply_polarisation(self, panel: Panel) -> tuple[Panel, float]:
        """Return the panel with the unmodulated share that follows from the polarisation.

        The second value is the camera's transmission, which includes the polarisation's.
        """
        if self.polarisation is None:
            return panel, self.transmission
        effect = self.polarisation.build().effect()
        passed = self.transmission * float(effect.transmission)
        return replace(panel, unmodulated=float(effect.unmodulated)), passed


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
