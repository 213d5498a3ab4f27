"""Find phase patterns and videos whose PSF has a requested shape (thesis chapter 3).

`retrieve` chooses the method. `optics.retrieval.gerchberg_saxton.gerchberg_saxton` is the plain
algorithm on every pixel of the panel.
"""

from optics.retrieval.camera_feedback import RefinementResult, refine
from optics.retrieval.goal import design_plane, window_for_reach
from optics.retrieval.methods import METHODS
from optics.retrieval.phase_retrieval import PatternQuality, RetrievalResult, retrieve
from optics.retrieval.superpixel import STARTS

__all__ = [
    "METHODS",
    "STARTS",
    "PatternQuality",
    "RefinementResult",
    "RetrievalResult",
    "design_plane",
    "refine",
    "retrieve",
    "window_for_reach",
]
