"""The plan's table for the pattern with a decoder that comes with the application."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Literal

from labapp.common.errors import UserError
from labapp.files.phase_table import FormulaPattern

if TYPE_CHECKING:
    import torch

    from optics.camera import Camera

_WAVELENGTH_TOLERANCE = 0.5e-9
"""Difference in metres below which two wavelengths count as the same. Chosen: rounding in files."""


class EdofPattern(FormulaPattern):
    """The bundled pattern for an extended depth of field; labapp reconstruct has its decoder."""

    title: ClassVar = "Extended depth of field"
    summary_template: ClassVar = "extended depth of field"
    smooth: ClassVar[bool] = False
    kind: Literal["edof"]

    def phase(self, camera: Camera, generator: torch.Generator) -> torch.Tensor:
        import torch

        from labapp.files.bench_file import BenchFile
        from labapp.files.design_file import bundled_trained_design, read_design
        from labapp.files.reading import validate
        from optics.slm import grey_to_phase

        path = bundled_trained_design()
        design = read_design(path)
        panel = validate(dict(design.bench), BenchFile, str(path)).build_camera().panel
        shown = camera.panel
        if (shown.shape, shown.pitch) != (panel.shape, panel.pitch):
            raise UserError(
                f"pattern edof: is for a panel of {panel.shape[1]}x{panel.shape[0]} pixels of "
                f"{1e6 * panel.pitch:g} µm, and this one has {shown.shape[1]}x{shown.shape[0]} of "
                f"{1e6 * shown.pitch:g} µm. Train one for it: labapp train edof."
            )
        if abs(self.wavelength - design.wavelength) > _WAVELENGTH_TOLERANCE:
            made = f"{1e9 * design.wavelength:g}"
            raise UserError(
                f"pattern edof: is made for {made} nm, and asked for at {self.wavelength_nm:g} nm. "
                f"Take {made} nm (wavelength_nm = {made} in a plan, --wavelength-nm {made}), or "
                "train one for the other: labapp train edof."
            )
        phase: torch.Tensor = grey_to_phase(
            panel, torch.from_numpy(design.grey[0]), design.wavelength
        )
        return phase
