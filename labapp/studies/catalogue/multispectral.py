"""Definition of the study of multispectral imaging from one photograph (thesis section 4.5)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar

from pydantic import Field

from labapp.studies.catalogue.snapshot_settings import SnapshotSettings
from labapp.studies.contract import Study


class MultispectralSettings(SnapshotSettings):
    """Hold the study's settings: PSFs, scene, exposures, and the light of the colours."""

    QUICK: ClassVar[Mapping[str, Any]] = {
        "bands_nm": [450, 550, 650],
        "iterations": 8,
        "scene_ms": [200],
        "sheet_ms": [50],
    }

    light: Annotated[
        str, Field(description="CIE illuminant in which colours are shown and compared")
    ] = "D65"


STUDY = Study(
    title="Multispectral imaging from one photograph",
    source="Figures 4.3, 4.7 and 4.8, Table 4.1, section 4.5",
    shows=(
        "A pattern whose PSF is a ring makes the ring grow with the wavelength. From one "
        "photograph of a colour camera through it, six bands are restored, in a simulation "
        "(Fig. 4.7: 24.9 to 28.9 dB) and with the real camera (Fig. 4.8, and Table 4.1: mean PSNR "
        "of a ColorChecker 21.5 dB). True bands are photographs with a uniform pattern behind a "
        "tunable filter."
    ),
    method=(
        "A star is photographed in each band, with the ring pattern and without one; so is a "
        "scene, in a bracket of exposures. The photographs with the ring are added to one "
        "snapshot. It is restored with the stars' pictures as PSFs, and compared with the "
        "photographs without a pattern. A white sheet says what white is."
    ),
    settings=MultispectralSettings,
    module="labapp.studies.multispectral",
    scene="studies/spectral.toml",
    bench="studies/spectral-bench.toml",
    takes_colour=True,
)
