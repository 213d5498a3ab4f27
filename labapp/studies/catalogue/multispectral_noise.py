"""Definition of the study of noise in multispectral imaging (thesis Table 4.2)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar

from pydantic import Field

from labapp.files.quantities import Positive
from labapp.studies.catalogue.snapshot_settings import SnapshotSettings
from labapp.studies.contract import Study


class MultispectralNoiseSettings(SnapshotSettings):
    """Hold the study's settings: noise, seeds, the computed snapshots, and the bench's."""

    QUICK: ClassVar[Mapping[str, Any]] = {
        "bands_nm": [450, 550, 650],
        "iterations": 8,
        "scene_ms": [200],
        "sheet_ms": [50],
        "noise": [0.0, 0.05],
        "seeds": 1,
        "side_px": 96,
    }

    noise: Annotated[
        tuple[Annotated[float, Field(ge=0, le=1)], ...],
        Field(min_length=1, description="standard deviations of a pixel, relative to white"),
    ] = (0.0, 0.01, 0.05, 0.1)
    seeds: Annotated[
        int, Field(ge=1, le=20, description="realisations of the noise of computed snapshots")
    ] = 3
    side_px: Annotated[
        int, Field(ge=64, le=1024, description="pixels along a side of computed snapshots")
    ] = 256
    ring_px: Annotated[
        Positive, Field(le=60, description="radius of computed rings in the longest band")
    ] = 20.0
    peak: Annotated[
        float, Field(ge=0, lt=1, description="share of light in the middle of computed rings")
    ] = 0.2


STUDY = Study(
    title="Noise in multispectral imaging",
    source="Table 4.2; the snapshot of Figure 4.8, section 4.5",
    shows=(
        "Gaussian noise of several standard deviations is added to a ColorChecker's coded "
        "photograph, taken with a ring. The mean PSNR of its six bands falls from 22.3 dB to "
        "14.8 dB."
    ),
    method=(
        "A ColorChecker's snapshot is taken through a ring as in the study multispectral, and "
        "noise is added to it. The same is done with snapshots that are computed from measured "
        "reflectances and exactly known rings with a peak in the middle, with several seeds."
    ),
    settings=MultispectralNoiseSettings,
    module="labapp.studies.multispectral_noise",
    scene="studies/spectral.toml",
    bench="studies/spectral-bench.toml",
    takes_colour=True,
)
