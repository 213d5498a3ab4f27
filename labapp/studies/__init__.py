"""Studies: the thesis' experiments, done again on a bench, with what was published beside.

A study is data and two functions: a plan, which the ordinary engine takes into an ordinary
record, and an evaluation of that record. To add one, write a module with the two, one in the
catalogue with a STUDY (see contract), and name this one in `STUDIES`.
"""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["STUDIES", "Entry"]


@dataclass(frozen=True)
class Entry:
    """Where a study is, and what it is in a line. module: of the catalogue, has a `STUDY`."""

    module: str
    figure: str
    line: str


STUDIES: dict[str, Entry] = {
    "psf-shapes": Entry("psf_shapes", "Fig. 3.3", "PSFs of many shapes, by phase retrieval"),
    "psf-video": Entry("psf_video", "Fig. 3.4", "a PSF that shrinks with time"),
    "psf-stability": Entry("psf_stability", "Fig. 3.5", "how smooth a phase video makes a PSF"),
    "refocus": Entry("refocus", "Fig. 3.6", "another focus by a lens on the SLM"),
    "cubic-edof": Entry("cubic_edof", "Fig. 2.15-2.17", "more depth of field, by a cubic phase"),
    "deconvolution": Entry("deconvolution", "Fig. 2.9", "a blurred photograph, restored"),
}
"""By name. Without what they need to run, so that help is instant."""
