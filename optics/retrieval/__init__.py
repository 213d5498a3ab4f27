"""From a target to a pattern or a video: phase retrieval (thesis chapter 3), and better.

retrieve() picks the method; gerchberg_saxton() is the plain algorithm on every pixel.
"""

from optics.retrieval.camera_feedback import RefinementResult, refine
from optics.retrieval.grid import design_plane, window_for_reach
from optics.retrieval.methods import METHODS
from optics.retrieval.phase_retrieval import RetrievalResult, retrieve
from optics.retrieval.quality import PatternQuality
from optics.retrieval.start_phases import STARTS

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
