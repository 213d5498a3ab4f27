"""Studies: the thesis' experiments, done again on a bench, with what was published beside.

A study is data and two functions: a plan, which the ordinary engine takes into an ordinary
record, and an evaluation of that record. To add one, write a module with the two, one in the
catalogue with a STUDY (see contract), and name this one in `STUDIES`.
"""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["STUDIES", "StudyEntry"]


@dataclass(frozen=True)
class StudyEntry:
    """Where a study is, and what it is in a line. module: of the catalogue, has a `STUDY`."""

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
    "deconvolution": StudyEntry("deconvolution", "Fig. 2.9", "a blurred photograph, restored"),
}
"""By name. Without what they need to run, so that help is instant."""
