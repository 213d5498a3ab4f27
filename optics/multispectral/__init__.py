"""Snapshot multispectral imaging: many spectral bands from one coded photograph.

`restore_spectra` restores the bands, and `estimate_error_map` estimates their errors.
`restore_by_published_objective` restores them by the objective of the thesis. Before anything is
captured, `predict_errors` predicts what PSFs will give, `PsfMerit` rates them, `search_design`
looks for better ones, and `dispersion_power` and `fourier_coverage` describe them.
"""

from optics.multispectral.dead_leaves import draw_dead_leaves
from optics.multispectral.design_search import Design, search_design
from optics.multispectral.designs import (
    dot_psfs,
    linear_dispersion_psfs,
    ring_psfs,
    spiral_psfs,
)
from optics.multispectral.error_map import ErrorMap, estimate_error_map
from optics.multispectral.predicted_error import PredictedErrors, SceneSpectrum, predict_errors
from optics.multispectral.psf_figures import FourierCoverage, dispersion_power, fourier_coverage
from optics.multispectral.psf_merit import PsfMerit
from optics.multispectral.published_restoration import restore_by_published_objective
from optics.multispectral.restoration import restore_spectra

__all__ = [
    "Design",
    "ErrorMap",
    "FourierCoverage",
    "PredictedErrors",
    "PsfMerit",
    "SceneSpectrum",
    "dispersion_power",
    "dot_psfs",
    "draw_dead_leaves",
    "estimate_error_map",
    "fourier_coverage",
    "linear_dispersion_psfs",
    "predict_errors",
    "restore_by_published_objective",
    "restore_spectra",
    "ring_psfs",
    "search_design",
    "spiral_psfs",
]
