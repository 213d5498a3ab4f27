"""Plans and snapshots of multispectral imaging, which several studies share."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from labapp.files.plan_file import PlanFile
from labapp.runs.record.reader import Record
from labapp.spectral.problem import SpectralProblem
from labapp.spectral.problem_reader import ProblemReader
from labapp.spectral.roles import choose_roles, white_target
from labapp.studies.catalogue.snapshot_settings import PSFStackSettings, SnapshotSettings
from labapp.studies.contract import Study
from labapp.studies.stars import acquisition_block, build_study_plan
from optics.camera import Camera
from optics.progress import Progress

RING = "ring"
"""Name of the pattern whose PSF is a ring."""

DARK_MARGIN = 1.6
"""Reach of a PSF's window from its middle, relative to the radius of its shape in the longest band;
chosen."""


def ring_table(settings: PSFStackSettings) -> dict[str, Any]:
    """Return the plan table of the pattern whose PSF is a ring."""
    return {
        "kind": "ring",
        "radius_um": settings.radius_um,
        "width_um": settings.width_um,
        "wavelength_nm": settings.wavelength_nm,
        "iterations": settings.iterations,
    }


def plan_snapshot(study: Study[Any], settings: SnapshotSettings, camera: Camera) -> PlanFile:
    """Plan a coded snapshot: star and scene in all bands, and a white sheet.

    Star and scene are taken with the neutral pattern and with the ring.
    """
    patterns = {RING: ring_table(settings)}
    window = psf_window(settings, camera)
    return build_study_plan(
        study,
        patterns,
        *star_blocks(settings, patterns),
        band_block(settings, [settings.target], ["neutral", RING], settings.scene_ms),
        band_block(settings, ["flat"], ["neutral"], settings.sheet_ms),
        reconstruct={"coded": RING, "photograph": settings.target, "psf_window_px": window},
    )


def star_blocks(
    settings: PSFStackSettings, patterns: Mapping[str, Any]
) -> tuple[dict[str, Any], ...]:
    """Return plan blocks of the star in all bands, without a pattern and with each."""
    return (
        band_block(settings, ["star"], ["neutral"], settings.star_ms),
        band_block(settings, ["star"], list(patterns), settings.coded_star_ms),
    )


def band_block(
    settings: PSFStackSettings,
    targets: Sequence[str],
    patterns: Sequence[str],
    exposures_ms: Sequence[float],
) -> dict[str, Any]:
    """Return a plan block of targets with each pattern in all bands, after darks."""
    block = acquisition_block(
        targets, patterns, settings.wavelength_nm, exposures_ms=list(exposures_ms)
    )
    return block | {"wavelengths_nm": list(settings.bands_nm)}


def psf_window(settings: PSFStackSettings, camera: Camera) -> int:
    """Return the odd side in pixels of a window that holds the PSF of the longest band."""
    largest = settings.radius_um * max(settings.bands_nm) / settings.wavelength_nm
    return 2 * round(DARK_MARGIN * largest * 1e-6 / camera.sensor.pitch) + 1


def read_problem(record: Record, progress: Progress) -> SpectralProblem:
    """Read the restoration problem of a recorded snapshot, with the true bands."""
    roles = choose_roles(record, None, None, None)
    reader = ProblemReader(record, roles, white_target(record, roles, None), None, progress)
    return reader.add_truth(reader.read_problem(None, "unknown"), None)
