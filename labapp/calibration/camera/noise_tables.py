"""The content of camera.json, with the facts that show later if it holds."""

from __future__ import annotations

import math
from datetime import datetime

import numpy as np

import labapp
from labapp.calibration.camera.recorded_frames import RecordedPairs
from labapp.files.calibration_file import DeviceIdentityTable
from labapp.files.camera_noise_file import (
    CameraNoiseFile,
    CurvePointTable,
    DefectTable,
    QuantityTable,
)
from labapp.runs.record.reader import Record
from optics.measuring import CameraNoise, Measured
from optics.measuring.pixel_maps import DEAD_RESPONSE, RESPONSE_EXCESS

_DECIBELS = 20 / math.log(10)
"""Decibels in a natural logarithm of a ratio of amplitudes."""

_DIGITS = 3
"""Digits that are written of an uncertainty; the quantity has as many decimals."""


def build_noise_file(record: Record, pairs: RecordedPairs, noise: CameraNoise) -> CameraNoiseFile:
    """Build the file's content; date, camera and bench come from the run's record."""
    bench = record.bench
    light = list(pairs.frames.light)
    linearity = noise.linearity
    drift = linearity.drift if linearity else None
    return CameraNoiseFile(
        version=1,
        kind="camera noise",
        date=datetime.fromisoformat(record.text("start_time")),
        bench=bench.name,
        record=record.path.name,
        frames=noise.frames + pairs.request.trials,
        software=f"labapp {labapp.__version__}",
        camera=DeviceIdentityTable(**record.devices["camera"]),
        options=bench.devices.camera.options,
        sensor=bench.sensor.model_dump(mode="json"),
        wavelength_nm=pairs.wavelength * 1e9,
        exposures_ms=(min(light) * 1e3, max(light) * 1e3),
        gain_electrons_per_dn=_table(noise.gain),
        system_gain_dn_per_electron=_table(noise.system_gain),
        read_noise_electrons=_table(noise.read_noise),
        read_noise_is_limit=noise.read_noise_is_limit,
        dark_noise_dn=_table(noise.dark_noise),
        black_level_dn=_table(noise.black_level),
        dark_current_electrons_per_s=_table(noise.dark_current),
        full_well_electrons=_optional(noise.full_well),
        clip_number_dn=_optional(noise.clip_number),
        clip_limit=noise.clip_limit,
        saturation_capacity_electrons=_optional(noise.saturation_capacity),
        sensitivity_threshold_electrons=_table(noise.sensitivity_threshold),
        dynamic_range_db=_optional(_decibels(noise.dynamic_range)),
        snr_max_db=_optional(_decibels(noise.snr_max)),
        linearity_error_percent=_optional(linearity.error * 100 if linearity else None),
        lamp_drift_percent=_optional(drift * 100 if drift else None),
        prnu_percent=_optional(noise.prnu * 100 if noise.prnu else None),
        dsnu_electrons=_table(noise.dsnu),
        reduced_chi2=noise.transfer.chi2,
        degrees_of_freedom=noise.transfer.freedom,
        light_unevenness_percent=round(100 * noise.unevenness, 3),
        lamp_jump_percent=round(100 * noise.lamp_jump, 4),
        defects=_defect_table(noise),
        curve=_curve(noise),
    )


def _table(one: Measured) -> QuantityTable:
    """Round a quantity to the digits that its uncertainty has."""
    if not one.sigma > 0:
        return QuantityTable(value=one.value, sigma=0.0)
    decimals = _DIGITS - 1 - math.floor(math.log10(one.sigma))
    return QuantityTable(value=round(one.value, decimals), sigma=round(one.sigma, decimals))


def _optional(one: Measured | None) -> QuantityTable | None:
    return None if one is None else _table(one)


def _decibels(one: Measured | None) -> Measured | None:
    """Convert a ratio of amplitudes to decibels, 20 log10 of it."""
    if one is None:
        return None
    return Measured(_DECIBELS * math.log(one.value), _DECIBELS * one.sigma / one.value)


def _defect_table(noise: CameraNoise) -> DefectTable:
    """Return the defective pixels with the criteria that found them."""
    found, gain = noise.defects, noise.gain.value
    return DefectTable(
        hot=_pixels(found.hot),
        bright=_pixels(found.bright),
        weak=_pixels(found.weak),
        dead=_pixels(found.dead),
        hot_electrons=round(found.dark_limit * gain, 3),
        hot_electrons_per_s=round(found.current_limit * gain, 3),
        response_percent=100 * RESPONSE_EXCESS,
        dead_percent=100 * DEAD_RESPONSE,
    )


def _pixels(found: np.ndarray) -> tuple[tuple[int, int], ...]:
    return tuple((int(row), int(column)) for row, column in found)


def _curve(noise: CameraNoise) -> tuple[CurvePointTable, ...]:
    """Return the photon transfer curve with one point for each exposure time."""
    transfer, points = noise.transfer, []
    for time in np.unique(transfer.exposure):
        same = transfer.exposure == time
        points.append(
            CurvePointTable(
                exposure_ms=float(time) * 1e3,
                signal_dn=round(float(transfer.signal[same].mean()), 4),
                variance_dn2=round(float(transfer.variance[same].mean()), 4),
                fitted=bool(transfer.used[same].all()),
            )
        )
    return tuple(points)
