"""From a target to a pattern or a video: phase retrieval (thesis chapter 3), and better.

retrieve() picks the method; gerchberg_saxton() is the plain algorithm on every pixel.
"""

from optics.retrieval.choice import Retrieved as Retrieved
from optics.retrieval.choice import retrieve as retrieve
from optics.retrieval.feedback import Refined as Refined
from optics.retrieval.feedback import refine as refine
from optics.retrieval.grid import design_plane as design_plane
from optics.retrieval.grid import window_for as window_for
from optics.retrieval.judging import Quality as Quality
from optics.retrieval.methods import METHODS as METHODS
from optics.retrieval.starts import STARTS as STARTS
