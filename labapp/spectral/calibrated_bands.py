"""PSFs and response of wanted bands, taken from a calibration's file."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray

from labapp.common.errors import UserError
from labapp.files.spectra_file import SpectraSource
from labapp.files.wavelengths import list_nanometres
from labapp.pictures.analysis.brackets import WAVELENGTH_TOLERANCE
from labapp.runs.record.reader import Record
from labapp.spectral.band_psfs import SHIFT_NOTE, BandPSFs
from labapp.spectral.band_response import BandResponse, band_edges, broad_gains, mosaic_of
from labapp.spectral.snapshot_prior import (
    positive_response,
    require_filters,
    scale_bands,
    usual_uncertainty_in_words,
)
from optics.multispectral import ModelUncertainty, SnapshotCalibration, SnapshotModel

_PITCH_TOLERANCE = 1e-3  # relative difference of two pitches that are taken for the same


@dataclass(frozen=True, eq=False)
class CalibratedBands:
    """What a calibration's file says of some bands.

    calibration: of these bands. Its response is that of white, in electrons per second.
    light_share: (bands,), share of the light that the coded pattern passes.
    is_absolute: whether the response is the white sheet's light. In broad light, only ratios are
        known.
    source: where it is from, in words.
    notes: remarks for the user.
    """

    calibration: SnapshotCalibration
    light_share: NDArray[np.float64]
    is_absolute: bool
    source: str
    notes: tuple[str, ...]

    @property
    def psfs(self) -> BandPSFs:
        """Return the calibrated PSFs as shares of the light."""
        shapes = self.calibration.psfs.numpy()
        shapes = shapes / shapes.sum((1, 2), keepdims=True)
        return BandPSFs(shapes, None, (), self.notes).with_light_share(self.light_share)

    @property
    def response(self) -> BandResponse:
        """Return what white gives in each band, from the calibration's white sheet."""
        response, model = self.calibration.response.numpy(), self.calibration.model
        white = float(response.max())
        return BandResponse(
            model.pattern,
            model.channels,
            response / white,
            white if self.is_absolute else None,
            f"the white sheet of {self.source}",
        )

    @property
    def prior(self) -> SnapshotCalibration:
        """Return the calibration as the start of a refinement from the photograph.

        Its response is relative to white, and includes the coded pattern's share of the light. The
        camera may have changed since then, as far as a nominal one may be wrong.
        """
        known = self.calibration
        change = known.model.layout.prior_covariance(ModelUncertainty())
        known = replace(
            known,
            covariance=known.covariance + change,
            source=f"{known.source}; for changes since then, {usual_uncertainty_in_words()}",
        )
        return scale_bands(known, self.light_share / float(self.response.white or 1))


def choose_calibrated_bands(
    source: SpectraSource, record: Record, coded: str, bands: Sequence[float], *, is_broad: bool
) -> CalibratedBands:
    """Choose bands (metres) from a calibration, for a record's photograph with the pattern `coded`.

    `is_broad` says whether it is one photograph in broad light. Raises UserError if the calibration
    is of another sensor, pattern or of other bands.
    """
    _require_same_sensor(source, record)
    file, chosen = source.file, _band_numbers(source, bands)
    known = _select_bands(file.build(), chosen)
    if hashlib.sha256(record.pattern(coded).tobytes()).hexdigest() != file.coded_sha256:
        raise UserError(
            f"--calibration {source.path}: is of another pattern than {coded!r} of {record.path}, "
            "grey level by grey level, whose PSFs may be others. Calibrate with the plan of this "
            "run: labapp calibrate --spectra --plan PLAN.toml."
        )
    notes: tuple[str, ...] = (SHIFT_NOTE,)
    if is_broad:
        known, note = _in_broad_light(source, record, known, chosen, bands)
        notes = (SHIFT_NOTE, note)
    shares = np.array([file.bands[one].light_share for one in chosen])
    words = f"{source.path}, {file.date:%Y-%m-%d}"
    return CalibratedBands(known, shares, not is_broad, words, notes)


def _require_same_sensor(source: SpectraSource, record: Record) -> None:
    """Raise UserError if the calibration is of another sensor than the record's."""
    file, mosaic = source.file, require_filters(f"--calibration {source.path}", mosaic_of(record))
    pitch = record.camera.sensor.pitch * 1e6
    if not math.isclose(pitch, file.pitch_um, rel_tol=_PITCH_TOLERANCE):
        raise UserError(
            f"--calibration {source.path}: is of pixels {file.pitch_um:g} µm apart, and those of "
            f"{record.path} are {pitch:g} µm apart. Calibrate the camera of the record."
        )
    if (mosaic.pattern, "".join(mosaic.channels)) != (file.filters, file.channels):
        raise UserError(
            f"--calibration {source.path}: is of the filters {'/'.join(file.filters)}, and "
            f"{record.path} has {'/'.join(mosaic.pattern)}. Calibrate the camera of the record."
        )


def _band_numbers(source: SpectraSource, bands: Sequence[float]) -> list[int]:
    """Return the numbers of bands in a calibration; raise UserError if it lacks one."""
    known = source.file.wavelengths
    numbers = []
    for one in bands:
        at = [k for k, own in enumerate(known) if abs(own - one) < WAVELENGTH_TOLERANCE]
        if not at:
            raise UserError(
                f"--calibration {source.path}: has the bands {list_nanometres(known)}, and not "
                f"{one * 1e9:g} nm. Leave that band out of --bands, or calibrate it."
            )
        numbers.append(at[0])
    return numbers


def _select_bands(known: SnapshotCalibration, chosen: list[int]) -> SnapshotCalibration:
    """Keep only the chosen bands of a calibration, with their part of the covariance."""
    model, layout, at = known.model, known.model.layout, torch.tensor(chosen)
    every = torch.arange(layout.count)
    places = torch.cat([
        every[layout.zeroth_orders][at],
        torch.tensor([layout.scale]),
        *(one[at] for one in every[layout.centres].reshape(2, -1)),
        *(one[at] for one in layout.ratio_places),
    ])  # fmt: skip
    part = SnapshotModel(
        model.coded[at], model.neutral[at], model.zeroth_order[at], model.response[:, at],
        model.pattern, model.channels,
    )  # fmt: skip
    return replace(
        known,
        model=part,
        deviation=known.deviation[places],
        covariance=known.covariance[places][:, places],
    )


def _in_broad_light(
    source: SpectraSource,
    record: Record,
    known: SnapshotCalibration,
    chosen: list[int],
    bands: Sequence[float],
) -> tuple[SnapshotCalibration, str]:
    """Adapt a calibration to one photograph in broad light, and return it with a remark.

    A band reaches halfway to the next ones. The light of white is taken to be that through the
    narrow filter over the filter's transmission, if it was measured. Only the bands' ratios count.
    """
    gains = positive_response(broad_gains(mosaic_of(record), bands))
    levels = known.model.response.sum(0).numpy() * np.diff(band_edges(bands))
    tables = source.file.transmission
    passed = [tables[one].relative for one in chosen] if tables else [None]
    if None in passed:
        over = "whose transmission the calibration doesn't know"
    else:
        levels = levels / np.array(passed, dtype=np.float64)
        over = "over its measured transmission"
    response = torch.from_numpy(gains / gains.sum(0) * levels)
    known = replace(known, model=replace(known.model, response=response))
    note = (
        "the snapshot is in broad light: the levels of its bands are those of the white sheet "
        f"through the narrow filter, {over}"
    )
    return scale_bands(known, np.full(len(chosen), 1 / float(known.response.max()))), note
