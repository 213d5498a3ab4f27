"""The thesis' experiments, repeated on a bench and compared with the published results.

A study is data and two functions. One function makes a plan, which is run like any other plan;
the other function evaluates the run's record. To add a study, write a module with the two
functions and a module in the catalogue with a STUDY (see contract), and add an entry to `STUDIES`.
"""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["STUDIES", "StudyEntry"]


@dataclass(frozen=True)
class StudyEntry:
    """Tell where a study is defined and, in a line, what it shows.

    Parameters
    ----------
    module : str
        Name of the study's module in `labapp.studies.catalogue`, which defines `STUDY`.
    figure : str
        Figures or section of the thesis that the study repeats.
    summary : str
        What the study shows, for the list of studies.

    Examples
    --------
    >>> STUDIES["refocus"].figure
    'Fig. 3.6'
    """

    module: str
    figure: str
    summary: str


STUDIES: dict[str, StudyEntry] = {
    "psf-shapes": StudyEntry("psf_shapes", "Fig. 3.3", "PSFs of many shapes, by phase retrieval"),
    "psf-video": StudyEntry("psf_video", "Fig. 3.4", "a PSF that shrinks with time"),
    "psf-stability": StudyEntry(
        "psf_stability", "Fig. 3.5", "how smooth a phase video makes a PSF"
    ),
    "refocus": StudyEntry("refocus", "Fig. 3.6", "another focus by a lens on the SLM"),
    "cubic-edof": StudyEntry(
        "cubic_edof", "Fig. 2.15-2.17", "more depth of field, by a cubic phase"
    ),
    "edof": StudyEntry(
        "edof",
        "Fig. 5.7-5.13, Tab. 5.1, 5.2",
        "all depths from one photograph, by a designed pattern",
    ),
    "deconvolution": StudyEntry("deconvolution", "Fig. 2.9", "a blurred photograph, restored"),
    "multispectral": StudyEntry(
        "multispectral", "Fig. 4.3-4.8, Tab. 4.1", "six spectral bands from one photograph"
    ),
    "multispectral-noise": StudyEntry(
        "multispectral_noise", "Tab. 4.2", "spectral bands from noisier and noisier photographs"
    ),
    "psf-designs": StudyEntry(
        "psf_designs", "Tab. 4.1, A.1, A.2", "shapes of PSFs that tell spectral bands apart"
    ),
}
"""All studies by name. Their modules aren't imported here, so that `--help` is fast."""
