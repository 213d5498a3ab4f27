"""Definition of the study of deconvolution of a blurred photograph (thesis Fig. 2.9)."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar

from pydantic import Field

from labapp.files.phase_table import Iterations
from labapp.files.quantities import Nanometres, Positive
from labapp.studies.contract import Study, StudySettings


class DeconvolutionSettings(StudySettings):
    """Hold the study's settings: the shape of the blur, the restorations, and the exposures."""

    QUICK: ClassVar[dict[str, Any]] = {"photograph_ms": [400], "iterations": 8, "blind": False}

    radius_um: Annotated[
        Positive, Field(description="of the heart that a point becomes; 27 um are 16 pixels across")
    ] = 27.0
    width_um: Annotated[Positive, Field(description="of its stroke, standard deviation")] = 5.0
    wavelength_nm: Annotated[Nanometres, Field(description="of the filter")] = 550.0
    iterations: Annotated[Iterations, Field(description="of phase retrieval")] = 30
    lucy: Annotated[Iterations, Field(description="of Richardson-Lucy, at most")] = 100
    blind: Annotated[
        bool, Field(description="whether the kernel is looked for as well, a minute or so")
    ] = True
    star_ms: Annotated[
        tuple[Positive, ...], Field(min_length=1, description="bracket of the star")
    ] = (1.0, 8.0, 64.0, 512.0)
    photograph_ms: Annotated[
        tuple[Positive, ...], Field(min_length=1, description="exposures of the photograph")
    ] = (400.0,)


STUDY = Study(
    title="Deconvolution of a blurred photograph",
    source="Figure 2.9, section 2.4.2",
    shows=(
        "A picture of 500 x 500 pixels, a blur kernel of 16 x 16, the blurred picture with "
        "Gaussian noise, and its restorations by Wiener's filter, by Richardson-Lucy, and by "
        "blind deconvolution. No numbers are printed."
    ),
    method=(
        "A pattern is retrieved whose PSF is a heart of 16 pixels; a star and a photograph are "
        "taken with it. The photograph is restored with the star's picture as its PSF."
    ),
    settings=DeconvolutionSettings,
    module="labapp.studies.deconvolution",
)
