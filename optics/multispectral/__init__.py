"""Snapshot multispectral imaging: many spectral bands from one coded photograph.

`restore_spectra` restores the bands, and `estimate_error_map` estimates their errors.
`restore_by_published_objective` restores them by the objective of the thesis. Before anything is
captured, `predict_errors` predicts what PSFs will give, `PsfMerit` rates them, `search_design`
looks for better ones, and `dispersion_power` and `fourier_coverage` describe them.

`SnapshotModel` says what may be wrong in the model of a camera. `calibrate_from_frames` estimates
it from calibration frames, and `refine_from_photograph` from the photograph alone.
"""

from optics.multispectral.design_search import (
    Design,
    dot_psfs,
    linear_dispersion_psfs,
    ring_psfs,
    search_design,
    spiral_psfs,
)
from optics.multispectral.error_map import ErrorMap, estimate_error_map
from optics.multispectral.frame_calibration import calibrate_from_frames
from optics.multispectral.predicted_error import PredictedErrors, SceneSpectrum, predict_errors
from optics.multispectral.psf_merit import (
    FourierCoverage,
    PsfMerit,
    dispersion_power,
    draw_dead_leaves,
    fourier_coverage,
)
from optics.multispectral.published_restoration import restore_by_published_objective
from optics.multispectral.restoration import restore_spectra
from optics.multispectral.self_calibration import refine_from_photograph
from optics.multispectral.snapshot_calibration import (
    BandTransmission,
    CalibratedParameter,
    SnapshotCalibration,
)
from optics.multispectral.snapshot_model import ModelUncertainty, SnapshotModel

__all__ = [
    "BandTransmission",
    "CalibratedParameter",
    "Design",
    "ErrorMap",
    "FourierCoverage",
    "ModelUncertainty",
    "PredictedErrors",
    "PsfMerit",
    "SceneSpectrum",
    "SnapshotCalibration",
    "SnapshotModel",
    "calibrate_from_frames",
    "dispersion_power",
    "dot_psfs",
    "draw_dead_leaves",
    "estimate_error_map",
    "fourier_coverage",
    "linear_dispersion_psfs",
    "predict_errors",
    "refine_from_photograph",
    "restore_by_published_objective",
    "restore_spectra",
    "ring_psfs",
    "search_design",
    "spiral_psfs",
]
