"""The lens of a camera file: stop, aberrations and ghosts. Some also stand in a scene's [truth]."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from labapp.files.quantities import Amount, Finite, Nanometres, Positive, Share
from labapp.files.reading import FileModel
from optics.camera import Lens
from optics.camera.field_aberrations import FieldAberrations
from optics.camera.ghost import Ghost
from optics.camera.stop import Circle, Stop, regular_polygon


class FieldAberrationsTable(FileModel):
    """Seidel's coefficients of a lens at an image height: W131, W222 and W220, nm of optical path.

    optics.camera.field_aberrations.FieldAberrations describes them.
    """

    height_mm: Positive
    coma_nm: Finite = 0.0
    astigmatism_nm: Finite = 0.0
    curvature_nm: Finite = 0.0

    @model_validator(mode="after")
    def _validate_sizes(self) -> FieldAberrationsTable:
        self.build()
        return self

    def build(self) -> FieldAberrations:
        return FieldAberrations(
            self.height_mm * 1e-3,
            self.coma_nm * 1e-9,
            self.astigmatism_nm * 1e-9,
            self.curvature_nm * 1e-9,
        )


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
