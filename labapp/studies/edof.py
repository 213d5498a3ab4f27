"""Study of extended depth of field by a designed pattern (thesis Fig. 5.7 to 5.13)."""

from __future__ import annotations

from labapp.common.errors import UserError
from labapp.files.plan_file import PlanFile
from labapp.pictures.analysis.brackets import merge_all
from labapp.runs.record.reader import Record
from labapp.studies.catalogue.edof import STUDY, EdofSettings
from labapp.studies.contract import StudyResults
from labapp.studies.edof_decoding import (
    OBJECTS,
    PRINT,
    SHARP,
    decode_pictures,
    find_sharp_pictures,
    photograph_name,
)
from labapp.studies.edof_figures import draw_results
from labapp.studies.edof_pattern import DESIGNED, NEUTRAL, PATTERNS, RINGS, pattern_tables
from labapp.studies.edof_psfs import compare_psfs, star_name
from labapp.studies.edof_rows import NOTES, result_rows, results_as_data
from labapp.studies.stars import acquisition_block, build_study_plan
from optics.camera import Camera
from optics.progress import Progress


def plan(settings: EdofSettings, camera: Camera) -> PlanFile:
    """Plan stars, prints and objects with each pattern, and all of them in focus."""
    if settings.psf_px > min(camera.sensor.shape):
        raise UserError(
            f"study edof: psf_px is {settings.psf_px}, and the sensor has "
            f"{min(camera.sensor.shape)} pixels along its shorter side. Give a smaller psf_px."
        )
    if settings.scored_px > min(settings.frame_px, *camera.sensor.shape):
        raise UserError(
            f"study edof: scored_px is {settings.scored_px}, more than the part of the frame that "
            "is decoded. Give a smaller scored_px."
        )
    nm, distances = settings.wavelength_nm, settings.distances_m
    kinds = [PRINT, OBJECTS] if settings.layered else [PRINT]
    pictures = [photograph_name(one) for one in distances] + kinds[1:]
    return build_study_plan(
        STUDY,
        pattern_tables(settings),
        acquisition_block(
            [star_name(one) for one in distances], PATTERNS, nm, exposures_ms=settings.star_ms
        ),
        acquisition_block(pictures, PATTERNS, nm, exposures_ms=settings.scene_ms),
        acquisition_block(
            [f"{one}-{SHARP}" for one in kinds], [NEUTRAL], nm, exposures_ms=settings.sharp_ms
        ),
    )


def evaluate(record: Record, settings: EdofSettings, progress: Progress) -> StudyResults:
    """Compare PSFs over depth with simulated ones, and decode the pictures."""
    brackets = merge_all(record, progress.part(0, 0.2))
    psfs = compare_psfs(record, brackets, (DESIGNED, RINGS), settings, progress.part(0.2, 0.6))
    sharp = find_sharp_pictures(record, brackets, settings)
    pictures = decode_pictures(record, brackets, sharp, settings, progress.part(0.6, 0.95))
    return StudyResults(
        result_rows(psfs, pictures, settings),
        draw_results(record, psfs, pictures, sharp, settings),
        NOTES,
        results_as_data(psfs, pictures),
    )
