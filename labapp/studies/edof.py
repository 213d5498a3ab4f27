"""Study of extended depth of field by a designed pattern (thesis Fig. 5.7 to 5.13)."""

from __future__ import annotations

from typing import Any

import numpy as np

from labapp.common.errors import UserError
from labapp.files.plan_file import PlanFile
from labapp.pictures.analysis.brackets import merge_all
from labapp.runs.record.reader import Record
from labapp.studies.catalogue.edof import STUDY, EdofSettings
from labapp.studies.contract import ResultRow, StudyResults
from labapp.studies.edof_decoding import (
    OBJECTS,
    PRINT,
    SHARP,
    Pictures,
    decode_pictures,
    find_sharp_pictures,
    labels_of,
    photograph_name,
)
from labapp.studies.edof_figures import draw_results
from labapp.studies.edof_pattern import DESIGNED, NEUTRAL, PATTERNS, RINGS, pattern_tables
from labapp.studies.edof_psfs import PSFs, compare_psfs, likeness_over_depth, star_name
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


GOAL = 0.03
"""Relative L2 distance of measured and simulated PSFs, beside noise, that is aimed at. Chosen."""

_PUBLISHED = {
    DESIGNED: "29.8 to 31.8 dB, SSIM .80 to .85, learned pattern with U-Net (Table 5.2)",
    RINGS: "21.6 dB, SSIM .43, four APM rings with a Wiener filter (Table 5.2)",
    NEUTRAL: "picture only (Fig. 5.11)",
}

_PATTERN_WORDS = {DESIGNED: "designed pattern", RINGS: "hand-made rings", NEUTRAL: "no pattern"}

_NEAREST_AND_FARTHEST = (
    "23.4 to 34.2 dB at nine distances, which the table doesn't name (Table 5.1)"
)

NOTES = (
    "A PSF is compared within the window of the settings, as a share of the star's light, without "
    "a fitted scale; the simulated one is moved by at most a pixel along each axis. What noise "
    "adds to the distance is computed from the camera's variance, and taken out.",
    "Simulated PSFs are of one wavelength; pixels and star have their real sizes. In the thesis "
    "the star was a hole of 1 mm behind a filter for green light, so that measured PSFs were "
    "blurred more than simulated ones.",
    "PSNR has peak 1, the brightness of the picture in focus at its 99.9th percentile; SSIM is of "
    "sRGB values. Both are of the middle of the frame, against a picture of the same things in "
    "focus without a pattern, which a real bench doesn't have for objects at several distances.",
    "Blind means that the decoder sees the picture, and constants made for the pattern and for all "
    "distances alike. The filter is made for the spectrum of natural photographs, for simulated "
    "PSFs, and for one noise.",
    "Published figures are from simulations by another protocol: in their program, pixels are of "
    "15.4 µm, after averaging 5 x 5; photographs resized to 2048 pixels; noise that doesn't depend "
    "on the light; PSNR of sRGB values. The decoder gets a PSF as a second picture, but for the "
    "variants without it, and 0.5 m is never drawn. Table 5.1 may be 17/16 too high: the program "
    "adds 17 pictures and divides by 16. So no published figure can be compared with ours in dB.",
    "The print is one photograph at its full resolution, on a dark wall. Its noise is that of the "
    "exposure; rows of other pictures differ.",
)


def result_rows(psfs: PSFs, pictures: Pictures, settings: EdofSettings) -> list[ResultRow]:
    """Return all rows: PSFs, pictures of a print, and objects that hide each other."""
    rows = [row(psfs, name) for row in (_psf_row, _likeness_row) for name in (DESIGNED, RINGS)]
    labels = labels_of(pictures)
    rows += [_print_row(pictures, name, label) for name in PATTERNS for label in labels]
    rows += _distance_rows(pictures, labels[-1], settings)
    if settings.layered:
        rows += [_objects_row(pictures, name, label) for name in PATTERNS for label in labels]
    return rows


def _psf_row(psfs: PSFs, name: str) -> ResultRow:
    """Compare the PSFs behind a pattern with simulated ones, at the worst depth."""
    own = {distance: one for (pattern, distance), one in psfs.items() if pattern == name}
    worst = max(own, key=lambda distance: own[distance].beside_noise)
    one = own[worst]
    moved = max(max(abs(part) for part in found.shift) for found in own.values())
    return ResultRow(
        f"{_PATTERN_WORDS[name]}: PSFs measured and simulated, L2 distance, at the worst of "
        f"{len(own)} distances",
        "picture only: alike but for blur (Fig. 5.7)",
        f"at most {GOAL:.0%} beside noise",
        f"{one.beside_noise:.1%} at {worst:g} m; with noise {one.difference:.1%}, of which noise "
        f"makes {one.noise:.1%}; moved by {moved:.2f} pixels at most",
        one.beside_noise,
    )


def _likeness_row(psfs: PSFs, name: str) -> ResultRow:
    """Return the row on how alike the measured PSFs are at all distances."""
    value = likeness_over_depth(psfs, name)
    return ResultRow(
        f"{_PATTERN_WORDS[name]}: PSFs at all distances, mean correlation with their mean",
        "picture only: the same features at all distances (Fig. 5.8)",
        "1 if they don't depend on depth",
        f"{value:.2f}",
        value,
    )


def _print_row(pictures: Pictures, name: str, label: str) -> ResultRow:
    """Return the row of a decoder's mean score on the print behind a pattern."""
    scores = [
        one
        for (target, pattern, decoder), one in pictures.items()
        if target.startswith(PRINT) and (pattern, decoder) == (name, label)
    ]
    linear, coded, ssim = (
        [getattr(one, key) for one in scores] for key in ("psnr", "srgb_psnr", "ssim")
    )
    return ResultRow(
        f"{_PATTERN_WORDS[name]}; {label}: print at {len(scores)} distances",
        "-" if label.startswith("as taken") else _PUBLISHED[name],
        "-",
        f"{np.mean(linear):.1f} dB, worst {min(linear):.1f} dB; in sRGB {np.mean(coded):.1f} dB, "
        f"SSIM {np.mean(ssim):.2f}; noise {scores[0].noise:.4f}",
        float(np.mean(linear)),
    )


def _distance_rows(pictures: Pictures, label: str, settings: EdofSettings) -> list[ResultRow]:
    """Return the rows of the print at each distance behind the designed pattern."""
    rows = []
    for distance in settings.distances_m:
        one = pictures[photograph_name(distance), DESIGNED, label]
        without = pictures[photograph_name(distance), NEUTRAL, label]
        what = f"designed pattern; {label}: print at {distance:g} m"
        expected = f"without a pattern {without.psnr:.1f} dB"
        rows.append(ResultRow(what, _NEAREST_AND_FARTHEST, expected, one.scores, one.psnr))
    return rows


def _objects_row(pictures: Pictures, name: str, label: str) -> ResultRow:
    """Return the row of a decoder on the objects that hide each other."""
    one = pictures[OBJECTS, name, label]
    what = f"{_PATTERN_WORDS[name]}; {label}: objects at several distances"
    return ResultRow(what, "picture only: edges fail (Fig. 5.13)", "-", one.scores, one.psnr)


def results_as_data(psfs: PSFs, pictures: Pictures) -> dict[str, Any]:
    """Return PSFs and scores of pictures as plain data, for programs."""
    return {
        "psfs": [
            {
                "pattern": name,
                "distance_m": distance,
                "difference": one.difference,
                "noise": one.noise,
                "beside_noise": one.beside_noise,
                "shift_px": list(one.shift),
            }
            for (name, distance), one in psfs.items()
        ],
        "pictures": [
            {
                "target": target,
                "pattern": name,
                "decoder": label,
                "psnr_db": one.psnr,
                "srgb_psnr_db": one.srgb_psnr,
                "ssim": one.ssim,
                "noise": one.noise,
            }
            for (target, name, label), one in pictures.items()
        ],
    }
