"""Definition of the study of PSFs of several shapes for multispectral imaging (thesis Tab. A.1)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field

from labapp.studies.catalogue.snapshot_settings import PSFStackSettings
from labapp.studies.contract import Study

ShownShape = Literal["ring", "spiral", "dots"]


class PSFDesignSettings(PSFStackSettings):
    """Hold the study's settings: shapes and sizes of PSFs, and the computed snapshots."""

    QUICK: ClassVar[Mapping[str, Any]] = {
        "shapes": ["ring"],
        "bands_nm": [450, 550, 650],
        "iterations": 8,
        "side_px": 96,
        "twelve": False,
    }

    shapes: Annotated[
        tuple[ShownShape, ...], Field(min_length=1, description="that the panel makes")
    ] = ("ring", "spiral", "dots")
    dots: Annotated[int, Field(ge=2, le=40, description="on a circle, for the shape dots")] = 8
    turns: Annotated[float, Field(gt=0, le=20, description="of the spiral")] = 3.0
    noise: Annotated[
        float, Field(gt=0, le=1, description="of a pixel of the snapshots, relative to white")
    ] = 0.01
    side_px: Annotated[
        int, Field(ge=64, le=1024, description="pixels along a side of the snapshots")
    ] = 256
    peak: Annotated[
        float, Field(ge=0, lt=1, description="share of light in the middle of computed PSFs")
    ] = 0.2
    twelve: Annotated[bool, Field(description="whether twelve bands are restored as well")] = True


STUDY = Study(
    title="Shapes of PSFs for multispectral imaging",
    source="Tables 4.1, A.1 and A.2, Figures 4.4, 4.10 and 4.11",
    shows=(
        "Rings, spirals and dots were photographed as PSFs in six bands (Fig. 4.4), and a "
        "ColorChecker through each (Table 4.1: 21.5, 22.0 and 22.2 dB). Table A.1 has their "
        "dispersion power. With linear dispersion as by a prism, the bands can't be restored "
        "(Fig. 4.11, no numbers). Twelve bands were restored in a simulation (Table A.2)."
    ),
    method=(
        "A pattern is retrieved for each shape, and a star is photographed through it in each "
        "band. Snapshots of a ColorChecker are computed with these PSFs and with drawn ones of the "
        "same size, all with the same light and noise. All are restored alike."
    ),
    settings=PSFDesignSettings,
    module="labapp.studies.psf_designs",
    scene="studies/spectral.toml",
    bench="studies/spectral-bench.toml",
    takes_colour=True,
)
