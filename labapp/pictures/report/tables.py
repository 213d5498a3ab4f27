"""The figures of a run's report as tables for people and as plain data for programs."""

from __future__ import annotations

from typing import Any

from labapp.common.console import out, print_table, styled_line
from labapp.pictures.report.record_analysis import RecordAnalysis
from optics.inverse.method_names import RESTORATIONS

PICTURE_NAMES = {
    "neutral": "neutral photograph",
    "coded": "coded photograph",
    **{name: one.title for name, one in RESTORATIONS.items()},
}

EXPOSURE_COLUMNS = (
    "target",
    "pattern",
    "nm ",
    "exposures ms ",
    "full scale ",
    "clipped ",
    "dark ",
    "darks ",
)
VARIANCE_COLUMNS = ("picture", "variance map")
EXPOSURE_NOTE = (
    "Shares of pixels: at full scale in the longest exposure; clipped, or dark, in every one, "
    "so that the merged value is a bound. Darks: dark frames subtracted, per exposure."
)


def print_tables(analysis: RecordAnalysis) -> None:
    """Print the tables of exposures, PSF, restoration and time.

    Parameters
    ----------
    analysis : RecordAnalysis
        Results of the record.
    """
    badge = f"SIMULATED: {', '.join(analysis.simulated)}" if analysis.simulated else "real devices"
    out.print(styled_line((analysis.title, "bold"), "  ", (badge, "yellow")))
    out.print()
    print_table("Exposures", EXPOSURE_COLUMNS, exposure_rows(analysis))
    out.print(EXPOSURE_NOTE + "\n", style="dim")
    for line in analysis.calibrations:
        out.print(line, markup=False)
    for line in analysis.doubts:
        out.print(f"warning: {line}", markup=False)
    if analysis.psf is not None:
        print_table("PSF, on sensor pixels", ["figure", "value "], psf_rows(analysis))
    if analysis.scores:
        heading = "Against the neutral photograph (central 90 %, peak and range 1)"
        print_table(heading, ["picture", "PSNR dB ", "SSIM "], score_rows(analysis))
    if analysis.variance_words:
        print_table("Restorations", VARIANCE_COLUMNS, variance_rows(analysis))
    print_table("Time", ["stage", "s "], [[k, f"{v:.2f}"] for k, v in analysis.seconds.items()])


def exposure_rows(analysis: RecordAnalysis) -> list[list[str]]:
    """Return a row for each bracket, in the order of `EXPOSURE_COLUMNS`."""
    return [
        [
            b.target,
            b.pattern,
            f"{b.wavelength * 1e9:g}",
            " ".join(f"{t * 1e3:g}" for t in b.exposures),
            *map(percent, (b.clipped_by_exposure[-1], b.clipped, b.dark)),
            str(b.dark_frames),
        ]
        for b in analysis.brackets
    ]


def psf_rows(analysis: RecordAnalysis) -> list[list[str]]:
    """Return rows on the PSF: efficiency, contrast and more."""
    psf = analysis.psf
    assert psf is not None
    rows = []
    if psf.efficiency is not None:
        rows.append(["efficiency, of all light in the window", f"{psf.efficiency:.3f}"])
    if psf.contrast is not None:
        rows.append(["speckle contrast, unmodulated light removed", f"{psf.contrast:.3f}"])
    rows.append(["light of the star inside the window", percent(psf.share_in_window)])
    rows.append(["unmodulated share, found in the centre", f"{psf.unmodulated:.3f}"])
    if psf.prediction_error is not None:
        rows.append(["measured against predicted, relative L2", f"{psf.prediction_error:.3f}"])
    return rows


def score_rows(analysis: RecordAnalysis) -> list[list[str]]:
    """Return rows on each photograph: PSNR, its gain by restoration, and SSIM."""
    before = analysis.scores["coded"].psnr
    rows = []
    for name, score in analysis.scores.items():
        gain = "" if name == "coded" else f" ({score.psnr - before:+.1f})"
        rows.append([PICTURE_NAMES[name], f"{score.psnr:.2f}{gain}", f"{score.ssim:.3f}"])
    return rows


def variance_rows(analysis: RecordAnalysis) -> list[list[str]]:
    """Return rows on how restorations used the variance map; none where there is no map."""
    return [[PICTURE_NAMES[name], words] for name, words in analysis.variance_words.items()]


def percent(share: float) -> str:
    """Format a share in percent, or in ppm below 0.05 %."""
    if share == 0:
        return "0 %"
    return f"{share:.1%}".replace("%", " %") if share >= 5e-4 else f"{share * 1e6:.0f} ppm"


def as_data(analysis: RecordAnalysis) -> dict[str, Any]:
    """Return the analysis as plain data for JSON.

    Parameters
    ----------
    analysis : RecordAnalysis
        Results of the record.

    Returns
    -------
    dict
        Exposures, PSF, scores and times; exposures in seconds, wavelengths in metres.
    """
    psf = analysis.psf
    return {
        "title": analysis.title,
        "simulated": analysis.simulated,
        "exposures": [
            {
                "target": b.target,
                "pattern": b.pattern,
                "wavelength_m": b.wavelength,
                "exposures_s": b.exposures,
                "full_scale_share_by_exposure": b.clipped_by_exposure,
                "clipped_share": b.clipped,
                "dark_share": b.dark,
                "dark_frames": b.dark_frames,
            }
            for b in analysis.brackets
        ],
        "psf": psf
        and {
            "efficiency": psf.efficiency,
            "speckle_contrast": psf.contrast,
            "share_inside_window": psf.share_in_window,
            "unmodulated_share": psf.unmodulated,
            "prediction_error": psf.prediction_error,
        },
        "scores": {name: score.as_data for name, score in analysis.scores.items()},
        "score_window": {"crop": "central 90 %", "peak": 1.0, "ssim_data_range": 1.0},
        "best": analysis.best_method,
        "calibrations": analysis.calibrations,
        "calibration_doubts": analysis.doubts,
        "variance_map": analysis.variance_words,
        "seconds": analysis.seconds,
    }
