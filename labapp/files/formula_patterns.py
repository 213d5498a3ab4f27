"""All patterns of a plan whose phase is given by a formula; here those for depth of field.

The modules that compute a phase are imported only when one is computed, so that reading plans and
listing the kinds of patterns stay fast.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

from annotated_types import MinLen

from labapp.common.errors import UserError
from labapp.files.phase_table import FormulaPattern, OuterRadius, outer_radius
from labapp.files.table import Count, Key

if TYPE_CHECKING:
    import torch

    from optics.camera import Camera


Near = Annotated[float, Key("nearest depth, 1 / distance in m; infinity is 0", "Near", 2, -20, 20)]
Far = Annotated[float, Key("farthest depth, less than near_dioptre", "Far", 0, -20, 20)]


class MultiFocusPattern(FormulaPattern):
    """Rings of equal area, each a Fresnel lens with one of several foci, for depth of field."""

    title: ClassVar = "Multi-focus rings"
    smooth: ClassVar[bool] = False
    kind: Literal["multi-focus"]
    near_dioptre: Near = 2.0
    far_dioptre: Far = 0.0
    foci: Annotated[Count, Key("how many depths, evenly spaced", "Foci", 10, 1, 500)] = 10
    vergences_dioptre: Annotated[
        tuple[float, ...] | None,
        MinLen(1),
        Key("depths in focus, instead of near_dioptre, far_dioptre and foci"),
    ] = None
    rings: Annotated[Count, Key("how many, foci or more", "Rings", 40, 1, 500)] = 40
    order: Annotated[
        Literal["cyclic", "interleaved", "random"],
        Key("of the foci, from the centre outwards"),
    ] = "interleaved"
    radius_mm: OuterRadius = None

    @property
    def depends_on_seed(self) -> bool:
        return self.order == "random"

    @property
    def summary(self) -> str:
        depths = f"{self.foci} foci, {self.near_dioptre:g} to {self.far_dioptre:g} D"
        if self.vergences_dioptre is not None:
            depths = ", ".join(f"{one:g}" for one in self.vergences_dioptre) + " D"
        return f"{self.rings} multi-focus rings, {depths}"

    def phase(self, camera: Camera, generator: torch.Generator) -> torch.Tensor:
        from optics import patterns

        vergences = self.vergences_dioptre
        if vergences is None:
            vergences = patterns.even_vergences(self.near_dioptre, self.far_dioptre, self.foci)
        return patterns.multi_focus_rings(
            camera.panel,
            vergences,
            self.wavelength,
            self.rings,
            focus_vergence(camera),
            outer_radius(self.radius_mm, camera),
            self.order,
            generator,
        )


class FocalSweepPattern(FormulaPattern):
    """Rings that go smoothly from near to far focus and back, for a large depth of field."""

    title: ClassVar = "Focal-sweep axicon"
    summary_template: ClassVar = (
        "{sweeps} focal sweeps, {near_dioptre:g} to {far_dioptre:g} D, even in {even_in}"
    )
    kind: Literal["focal-sweep"]
    near_dioptre: Near = 2.0
    far_dioptre: Far = 0.0
    sweeps: Annotated[Count, Key("how often the depth crosses the range", "Sweeps", 6, 1, 500)] = 6
    even_in: Annotated[
        Literal["radius", "area"], Key("what the depth in focus grows evenly with")
    ] = "radius"
    radius_mm: OuterRadius = None

    def phase(self, camera: Camera, generator: torch.Generator) -> torch.Tensor:
        from optics import patterns

        return patterns.focal_sweep_axicon(
            camera.panel,
            self.near_dioptre,
            self.far_dioptre,
            self.wavelength,
            self.sweeps,
            focus_vergence(camera),
            outer_radius(self.radius_mm, camera),
            self.even_in,
        )


class LatticeFocalPattern(FormulaPattern):
    """Rectangles that are Fresnel lenses of different foci (Levin and others 2009)."""

    title: ClassVar = "Lattice-focal lens"
    smooth: ClassVar[bool] = False
    summary_template: ClassVar = (
        "lattice-focal {columns}x{rows}, {near_dioptre:g} to {far_dioptre:g} D"
    )
    kind: Literal["lattice-focal"]
    near_dioptre: Near = 2.0
    far_dioptre: Far = 0.0
    columns: Annotated[Count, Key("of rectangles", "Columns", 4, 1, 4096)] = 4
    rows: Annotated[Count, Key("of rectangles", "Rows", 2, 1, 4096)] = 2

    def phase(self, camera: Camera, generator: torch.Generator) -> torch.Tensor:
        from optics import patterns

        return patterns.lattice_focal_lens(
            camera.panel,
            self.near_dioptre,
            self.far_dioptre,
            self.wavelength,
            self.columns,
            self.rows,
            focus_vergence(camera),
        )


def focus_vergence(camera: Camera) -> float:
    """Return the vergence at the panel of the plane in focus, dioptres; 0 is infinity."""
    from optics.camera.pupil import panel_to_focus_distance

    return 1 / panel_to_focus_distance(camera)


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


FORMULA_PATTERNS = tuple(FormulaPattern.__subclasses__())
"""All formula patterns, in the order in which they are listed and offered."""
