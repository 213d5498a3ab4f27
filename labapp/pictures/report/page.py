"""Build the report of a run as a single HTML file without external resources."""

from __future__ import annotations

from html import escape
from pathlib import Path

import numpy as np

from labapp.common.figure_png import figure_to_png
from labapp.files.picture.photograph_writing import encode_photograph
from labapp.pictures.analysis.brackets import Picture
from labapp.pictures.report import figures, tables
from labapp.pictures.report.html import document, footer, heading, html_figure, html_table
from labapp.pictures.report.record_analysis import RecordAnalysis


def report_page(analysis: RecordAnalysis) -> str:
    """Return the whole report as an HTML page."""
    parts = [_head(analysis), _exposures(analysis)]
    if analysis.psf is None:
        parts.append(html_figure(figure_to_png(figures.gallery(analysis)), "The merged pictures"))
    else:
        parts.append(_psf(analysis))
    if analysis.scores:
        parts.append(_photographs(analysis))
    rows = [[stage, f"{seconds:.2f}"] for stage, seconds in analysis.seconds.items()]
    parts.append("<h2>Time</h2>" + html_table(["stage", "s "], rows) + footer())
    return document(analysis.title, parts)


def _head(analysis: RecordAnalysis) -> str:
    summary = ""
    if analysis.best_method:
        gain = analysis.scores[analysis.best_method].psnr - analysis.scores["coded"].psnr
        name = tables.PICTURE_NAMES[analysis.best_method]
        summary = (
            f"<p>{name} brings the coded photograph {gain:.1f} dB closer to the neutral one, "
            "with the PSF that was measured on the star.</p>"
        )
    in_force = "".join(f"<p>{escape(one)}</p>" for one in analysis.calibrations)
    doubts = "".join(f"<p><strong>{escape(one)}</strong></p>" for one in analysis.doubts)
    return heading(analysis.title, analysis.simulated) + summary + in_force + doubts


def _exposures(analysis: RecordAnalysis) -> str:
    return (
        "<h2>Exposures</h2>"
        + html_table(tables.EXPOSURE_COLUMNS, tables.exposure_rows(analysis))
        + f"<p>{escape(tables.EXPOSURE_NOTE)}</p>"
        + html_figure(
            figure_to_png(figures.histogram_figure(analysis)), "Digital numbers by exposure"
        )
    )


def _psf(analysis: RecordAnalysis) -> str:
    return (
        "<h2>Point spread function</h2>"
        + html_figure(
            figure_to_png(figures.psf_figure(analysis)),
            "Logarithmic scale over four decades. The peak in the centre is unmodulated light.",
        )
        + '<div class="pair">'
        + html_table(["figure", "value "], tables.psf_rows(analysis))
        + html_figure(figure_to_png(figures.profile_figure(analysis)), "")
        + "</div>"
    )


def _photographs(analysis: RecordAnalysis) -> str:
    rendered_pictures = "".join(
        html_figure(encode_png(picture), figures.caption(analysis, name))
        for name, picture in analysis.images.items()
    )
    rows = tables.variance_rows(analysis)
    variance_use = html_table(tables.VARIANCE_COLUMNS, rows) if rows else ""
    return (
        "<h2>Photographs</h2>"
        + html_table(["picture", "PSNR dB ", "SSIM "], tables.score_rows(analysis))
        + "<p>Against the neutral photograph, over the central 90 % of each side; white is 1, "
        "and so are the peak of PSNR and the range of SSIM.</p>"
        + variance_use
        + f'<div class="pair">{rendered_pictures}</div><p>{escape(analysis.credit)}</p>'
    )


def encode_png(picture: Picture) -> bytes:
    """Encode a picture, white at 1 and in colour or grey, as a PNG file of 8-bit sRGB."""
    bands = picture[None] if picture.ndim == 2 else np.moveaxis(picture, -1, 0)
    return encode_photograph(Path("picture.png"), bands.astype(np.float32), True, 1.0)
