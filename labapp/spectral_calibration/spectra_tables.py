"""The content of spectra.json, with the facts that show if it still holds."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime

import numpy as np
import torch
from numpy.typing import NDArray

import labapp
from labapp.files.calibration_file import DeviceIdentityTable
from labapp.files.spectra_file import (
    BandTable,
    ParameterTable,
    SpectraFile,
    TransmissionTable,
    as_ppm,
    name_bands,
)
from labapp.runs.record.reader import Record
from labapp.spectral.snapshot_prior import usual_uncertainty_in_words
from labapp.spectral_calibration.fitting import SpectraFit
from optics.multispectral import CalibratedParameter, SnapshotCalibration

_DIGITS = 6
"""Significant digits of the model's numbers; the errors of all of them are larger."""

_NO_LAMP = (
    "The filter's own transmission: only the product of lamp and filter was seen. It matters for "
    "photographs that are taken without the filter."
)


def build_spectra_file(
    fit: SpectraFit, transmission: tuple[TransmissionTable, ...], transmission_source: str
) -> SpectraFile:
    """Build the file's content; date, devices and bench come from the run's record."""
    found, model = fit.found, fit.found.model
    known = bool(transmission) and all(one.relative is not None for one in transmission)
    with Record(fit.path) as record:
        bench = record.bench.model_dump(mode="json")
        pitch = record.camera.sensor.pitch
        return SpectraFile(
            version=1,
            date=datetime.fromisoformat(record.text("start_time")),
            bench=record.bench.name,
            record=fit.path.name,
            frames=record.frame_count,
            software=f"labapp {labapp.__version__}",
            devices={
                name: DeviceIdentityTable(**device) for name, device in record.devices.items()
            },
            sensor=bench["sensor"],
            pitch_um=pitch * 1e6,
            coded_pattern=fit.request.coded,
            coded_sha256=fit.coded_sha256,
            nominal_source=_nominal_in_words(fit),
            transmission_source=transmission_source,
            indeterminate=(*found.indeterminate, *(() if known else (_NO_LAMP,))),
            parameters=tuple(
                _parameter_table(one, fit.request.wavelengths) for one in found.parameters
            ),
            bands=_band_tables(fit),
            transmission=transmission,
            filters=model.pattern,
            channels=model.channels,
            zeroth_order=_row(model.zeroth_order),
            response=tuple(_row(one) for one in model.response),
            deviation=_row(found.deviation),
            covariance=tuple(_row(one) for one in found.covariance),
            psfs_ppm=as_ppm(_nominal_psfs(found)),
            neutral_ppm=as_ppm(model.neutral.numpy()),
        )


def _nominal_in_words(fit: SpectraFit) -> str:
    """Say in words what the nominal model is, and how well it was known."""
    request = fit.request
    star = (
        f"fitted as those of a star of {request.star_diameter_um:g} µm"
        if request.star_diameter_um
        else "fitted as if the star were a point, as its size isn't known"
    )
    return (
        f"PSFs of a point, computed from the bench's description and the pattern "
        f"{request.coded!r}, and {star}; before the fit, {usual_uncertainty_in_words()}"
    )


def _nominal_psfs(found: SnapshotCalibration) -> NDArray[np.float64]:
    """Return the model's nominal PSFs, (bands, rows, columns), each with its zeroth order."""
    model = found.model
    order = model.zeroth_order[:, None, None]
    return (order * model.neutral + (1 - order) * model.coded).numpy()


def _parameter_table(one: CalibratedParameter, wavelengths: Sequence[float]) -> ParameterTable:
    digits = [
        _round_number(value)
        for value in (one.value, one.deviation, one.lower, one.upper, one.nominal)
    ]
    return ParameterTable(
        name=name_bands(one.name, wavelengths),
        unit=one.unit.replace("pixel", "px"),
        value=digits[0],
        sigma=digits[1],
        lower=digits[2],
        upper=digits[3],
        nominal=digits[4],
    )


def _band_tables(fit: SpectraFit) -> tuple[BandTable, ...]:
    response = fit.found.response
    return tuple(
        BandTable(
            wavelength_nm=nm,
            white_e_per_s=_round_number(float(response[:, band].max())),
            light_share=_round_number(float(fit.light_share[band])),
            star_residual=_round_number(float(fit.star_residuals[band])),
        )
        for band, nm in enumerate(fit.request.bands_nm)
    )


def _row(values: torch.Tensor) -> tuple[float, ...]:
    return tuple(_round_number(float(one)) for one in values)


def _round_number(value: float) -> float:
    """Round to significant digits."""
    return float(f"{value:.{_DIGITS}g}")
