"""From a target to a pattern or a video: phase retrieval (thesis chapter 3), and better.

retrieve() picks the method; gerchberg_saxton() is the plain algorithm on every pixel.
"""

from optics.retrieval.camera_feedback import RefinementResult as RefinementResult
from optics.retrieval.camera_feedback import refine as refine
from optics.retrieval.grid import design_plane as design_plane
from optics.retrieval.grid import window_for_reach as window_for_reach
from optics.retrieval.methods import METHODS as METHODS
from optics.retrieval.phase_retrieval import RetrievalResult as RetrievalResult
from optics.retrieval.phase_retrieval import retrieve as retrieve
from optics.retrieval.quality import PatternQuality as PatternQuality
from optics.retrieval.start_phases import STARTS as STARTS
