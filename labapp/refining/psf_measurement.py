"""Measure the PSF of the shown frames with the bench's camera, on the design grid."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from labapp.bench.opening import Bench
from labapp.common.errors import UserError
from labapp.pictures.analysis.brackets import Bracket
from labapp.refining.psf_exposure import record_path, take_picture
from labapp.refining.refinement_request import RefinementRequest
from labapp.refining.sensor_view import SensorView
from labapp.refining.start import RefinementStart
from labapp.runs.acquisition.attendance import AskOperator
from optics.metrics import scaled_nrmse, speckle_contrast
from optics.progress import Progress
from optics.retrieval.camera_feedback import JUDGED_TARGET_SHARE

_NOISE_VARIANCE_SHARE = 0.764
"""Share of the variance of white noise that remains after cubic spline interpolation between
pixels, averaged over all positions: the squared integral of the squared cardinal cubic spline."""


@dataclass(frozen=True, eq=False)
class MeasuredPSF:
    """A PSF that was photographed and resampled to the design grid.

    record: of the picture's frames.
    light: (rows, columns) float64, electrons per second and sensor pixel, at least 0.
    nrmse: error of its shape, where the target exceeds 2 % of its peak.
    noise: approximate error that the noise of the picture alone would make.
    contrast: speckle contrast, where the target exceeds half its peak, without the camera's noise.
    central: share of the squared error in the zeroth order, where unmodulated light falls.
    scale: factor by which the target fits the picture best.
    """

    record: Path
    light: torch.Tensor
    nrmse: float
    noise: float
    contrast: float
    central: float
    scale: float


@dataclass(frozen=True, eq=False)
class PSFMeasurer:
    """The camera that optics.retrieval.refine() measures PSFs with; it keeps all measurements.

    `folder` holds the records. With `force`, existing records may be replaced.
    """

    bench: Bench
    request: RefinementRequest
    start: RefinementStart
    view: SensorView
    folder: Path
    force: bool
    ask: AskOperator | None
    measurements: list[MeasuredPSF]

    def __call__(self, phases: torch.Tensor, progress: Progress) -> torch.Tensor:
        """Show phases (frames, rows, columns); return the measured PSF on the goal's plane."""
        number = len(self.measurements) + 1
        bracket = take_picture(
            self.bench,
            self.request,
            self.start.spec.wavelength_nm,
            self.start.grey_levels(self.start.phases_on_panel(phases)),
            number,
            self.folder,
            force=self.force,
            progress=progress,
            ask=self.ask,
        )
        self.measurements.append(self._evaluate_bracket(bracket, record_path(self.folder, number)))
        return self.measurements[-1].light

    def _evaluate_bracket(self, bracket: Bracket, record: Path) -> MeasuredPSF:
        view, target = self.view, self.view.target
        bright = target > JUDGED_TARGET_SHARE * target.max()
        variance = view.resample_nearest(bracket.variance)
        self._require_unclipped(variance[bright], bracket, record)
        light = view.resample_picture(bracket.rate)
        wanted = target[bright]
        scale = float((light[bright] * wanted).sum() / wanted.square().sum())
        noise = float(
            (_NOISE_VARIANCE_SHARE * variance[bright].mean()).sqrt() / wanted.square().mean().sqrt()
        )
        if scale <= noise:
            raise UserError(
                f"{record}: the PSF can't be told from noise. Expose longer with --exposures-ms, "
                "and look whether the star is lit and lies where the calibration found it."
            )
        # Samples beside the sensor get the target's value, so that nothing is corrected there.
        light = torch.where(torch.from_numpy(view.on_sensor), light, scale * target).clamp(min=0)
        return MeasuredPSF(
            record,
            light,
            scaled_nrmse(light[bright], wanted),
            noise / scale,
            speckle_contrast(light, target, _NOISE_VARIANCE_SHARE * variance),
            self._central_error_share(light / scale - target, bright),
            scale,
        )

    def _central_error_share(self, error: torch.Tensor, bright: torch.Tensor) -> float:
        away = np.linalg.norm(
            self.view.sensor_positions - np.array(self.view.registration.centre), axis=-1
        )
        # Unmodulated light falls within 3 sensor pixels of the axis, beside the star's image.
        middle = torch.from_numpy(away < 3 + self.view.star_diameter / 2)
        squared = error.square()
        return float(squared[bright & middle].sum() / squared[bright].sum())

    def _require_unclipped(self, variance: torch.Tensor, bracket: Bracket, record: Path) -> None:
        """Raise UserError if PSF pixels are clipped in every exposure.

        The merged bracket gives such pixels an infinite variance.
        """
        clipped = int(np.isinf(variance.numpy()).sum())
        if not clipped:
            return
        shortest = min(bracket.exposures) * 1e3
        remedy = "Shorten it with --exposures-ms, or dim the lamp."
        if self.start.frames > 1:
            period = self.start.frames * self.bench.slm.frame_time * 1e3
            remedy = (
                f"A video's exposures are whole periods of {period:g} ms: dim the lamp, or make "
                "it of fewer frames."
            )
        raise UserError(
            f"{record}: {clipped / len(variance):.1%} of the PSF is clipped in every exposure; the "
            f"shortest is {shortest:g} ms. {remedy}"
        )
