"""The light of a white sheet in each band, measured with a spectroradiometer and kept as CSV."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.interfaces import Clock, Setting
from labapp.bench.opening import BenchFiles, open_devices
from labapp.common.errors import UserError
from labapp.files.spectra_file import TransmissionTable
from labapp.files.spectrum_file import read_spectra
from labapp.runs.acquisition.attendance import AskOperator
from labapp.spectral.lights import ViewingLight
from labapp.spectral_calibration.request import SpectraRequest
from optics.light import Spectrum
from optics.progress import Progress

INSTRUMENT = "spectroradiometer"

LAMP = "lamp"
"""Name of the column with the white sheet's light without a narrow filter."""

_REPEATS = 2  # of each band; chosen: their difference says how well they repeat

# Least relative standard deviation of a radiance: the accuracy that the CS-2000's data sheet states
# for a lamp of 2856 K.
_LEAST_DEVIATION = 0.02

_ROUND_TRIP = 1e-5  # least radiance that is written, of the largest: below, there is only noise


@dataclass(frozen=True)
class Radiances:
    """Radiances of a white sheet through the filter at each band, as a spectroradiometer saw them.

    wavelengths: (n,), metres, rising.
    bands_nm: centres of the bands.
    values: (bands, repeats, n), W/(sr m² nm), not negative.
    lamp: (n,), the same without a narrow filter; None where the bench can't open it.
    """

    wavelengths: NDArray[np.float64]
    bands_nm: tuple[float, ...]
    values: NDArray[np.float64]
    lamp: NDArray[np.float64] | None


def measure_radiances(
    files: BenchFiles, request: SpectraRequest, progress: Progress, ask: AskOperator, speed: float
) -> Radiances | None:
    """Measure the white sheet's radiance at each band.

    A filter wheel with an open slot shows the lamp's own spectrum as well. Returns None for a bench
    without a spectroradiometer. Raises DeviceError if a device fails.
    """
    setup = files.read()
    if INSTRUMENT not in setup.bench.devices.tables:
        return None
    with open_devices(setup, ("targets", "filter", INSTRUMENT), speed=speed) as (clock, devices):
        meter, filter_, targets = devices[INSTRUMENT], devices["filter"], devices["targets"]
        if targets.by_hand:
            ask(f"Place {request.flat} before the spectroradiometer, then press Enter.", progress)
        _wait(targets.place(request.flat), clock)
        values = []
        for number, nm in enumerate(request.bands_nm):
            progress.report(number / len(request.bands_nm), f"radiance, {nm:g} nm")
            _wait(filter_.set_wavelength(nm * 1e-9), clock)
            values.append([_radiance(meter, progress) for _ in range(_REPEATS)])
        lamp = None
        slot = _open_slot(filter_, request.wavelengths)
        if slot is not None:
            _wait(filter_.set_slot(slot), clock)
            lamp = _radiance(meter, progress)
        progress.report(1.0, "radiances")
        return Radiances(np.array(meter.wavelengths), request.bands_nm, np.array(values), lamp)


def _wait(setting: Setting[Any], clock: Clock) -> None:
    clock.wait_until(setting.ready_at, lambda: False)


def _radiance(meter: Any, progress: Progress) -> NDArray[np.float64]:
    """Return a spectroradiometer's radiance in W/(sr m² nm), without negative noise."""
    found: NDArray[np.float64] = meter.measure(lambda: progress.is_cancelled).radiance
    return np.clip(found * 1e-9, 0, None)


def _open_slot(filter_: Any, wavelengths: Sequence[float]) -> int | None:
    """Return the slot of a filter wheel that passes all bands; None if there is none."""
    for number, slot in enumerate(getattr(filter_, "slots", ()), 1):
        half = slot.bandwidth / 2
        if all(abs(one - slot.wavelength) <= half for one in wavelengths):
            return number
    return None


def radiances_to_csv(found: Radiances) -> bytes:
    """Return the text of a CSV file with a white sheet's radiances, a column a measurement."""
    names = [
        f"{nm:g}-{repeat + 1}" for nm in found.bands_nm for repeat in range(found.values.shape[1])
    ]
    columns = [one for band in found.values for one in band]
    if found.lamp is not None:
        names, columns = [*names, LAMP], [*columns, found.lamp]
    lines = [
        "# Radiance of the white sheet through the filter at each band, W/(sr m2 nm).",
        ",".join(["wavelength_nm", *names]),
    ]
    least = _ROUND_TRIP * max(float(one.max()) for one in columns)
    for wavelength, row in zip(found.wavelengths, np.array(columns).T, strict=True):
        cells = [f"{one:.5g}" if one > least else "0" for one in row]
        lines.append(",".join([f"{wavelength * 1e9:g}", *cells]))
    return ("\n".join(lines) + "\n").encode()


def read_radiances(path: Path, bands_nm: Sequence[float]) -> Radiances | None:
    """Read a CSV file with a white sheet's radiances; None if there is no such file.

    Raises UserError for a file of other bands.
    """
    if not path.exists():
        return None
    spectra = read_spectra(path)
    values = []
    for nm in bands_nm:
        names = [one for one in spectra if one.rsplit("-", 1)[0] == f"{nm:g}"]
        if not names:
            raise UserError(
                f"{path}: has no column for {nm:g} nm; it has {', '.join(spectra)}. Remove the "
                "file, or measure again."
            )
        values.append([spectra[one].values for one in names])
    lamp = spectra.get(LAMP)
    wavelengths = next(iter(spectra.values())).wavelengths
    return Radiances(
        np.array(wavelengths),
        tuple(bands_nm),
        np.array(values),
        None if lamp is None else np.array(lamp.values),
    )


def transmission_tables(
    found: Radiances | None, lamp: ViewingLight | None
) -> tuple[tuple[TransmissionTable, ...], str]:
    """Return what the radiances say of each band, and in words where that is from.

    Raises UserError if a band's light, or the lamp's at a band, is nothing but noise.

    lamp: spectrum of the lamp on any scale, from elsewhere. The measured one is preferred.
    """
    if found is None:
        return (), (
            "not measured: the bench has no spectroradiometer, so that the filter's share in the "
            "bands' light isn't known"
        )
    step = np.gradient(found.wavelengths) * 1e9
    light = found.values @ step
    if not (light > 0).all():
        dark = found.bands_nm[int(np.argmin(light.min(1)))]
        raise UserError(
            f"the spectroradiometer sees no light at {dark:g} nm. Check lamp, sheet and filter."
        )
    shape = found.values.mean(1)
    centres = (shape @ (step * found.wavelengths)) / (shape @ step)
    widths = (shape @ step) / shape.max(1)
    source = "radiance of the white sheet in each band"
    if found.lamp is not None:
        own = Spectrum(tuple(found.wavelengths), tuple(found.lamp)).at(centres)
        source = f"{source}, over that through the open slot"
    elif lamp is not None:
        own = lamp.spectrum.at(centres)
        source = f"{source}, over the lamp's spectrum {lamp.name!r}"
    else:
        own = None
        source = (
            f"{source}: lamp and filter together, as the filter has no open position. Give the "
            "lamp's spectrum (--lamp) to tell them apart"
        )
    passed = None if own is None else _relative_transmission(found, light.mean(1), own)
    repeat = light.std(1, ddof=1) / light.mean(1) if light.shape[1] > 1 else np.zeros(len(light))
    sigmas = np.hypot(_LEAST_DEVIATION, repeat)
    tables = tuple(
        TransmissionTable(
            wavelength_nm=centre * 1e9,
            width_nm=width,
            radiance_w_sr_m2=radiance,
            relative=None if passed is None else float(passed[at]),
            sigma=None if passed is None else float(passed[at] * sigmas[at]),
        )
        for at, (centre, width, radiance) in enumerate(
            zip(centres, widths, light.mean(1), strict=True)
        )
    )
    return tables, source


def _relative_transmission(
    found: Radiances, light: NDArray[np.float64], own: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return each band's light over the lamp's `own`, (bands,), the largest being 1."""
    if not (own > 0).all():
        dark = found.bands_nm[int(np.argmin(own))]
        raise UserError(
            f"--lamp: its spectrum is dark at {dark:g} nm. Give one that covers all bands."
        )
    share = light / own
    return np.asarray(share / share.max())
