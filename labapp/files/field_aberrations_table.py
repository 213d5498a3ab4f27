"""The table of a lens' field aberrations, in camera files and in a scene's [truth.lens]."""

from __future__ import annotations

from pydantic import model_validator

from labapp.files.quantities import Finite, Positive
from labapp.files.reading import FileModel
from optics.camera.field_aberrations import FieldAberrations


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
