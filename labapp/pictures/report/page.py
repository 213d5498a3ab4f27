"""The report as one HTML file that needs nothing else, online or off."""

from __future__ import annotations

from html import escape
from pathlib import Path

from labapp.common.drawing import png
from labapp.files.writing import encoded
from labapp.pictures.report import pictures, tables
from labapp.pictures.report.analysis import Analysis
from labapp.pictures.report.html import document, footer, heading, html_figure, html_table


def page(analysis: Analysis) -> str:
    """The whole report as HTML text."""
    parts = [_head(analysis), _exposures(analysis)]
    if analysis.psf is None:
        parts.append(html_figure(png(pictures.gallery(analysis)), "The merged pictures"))
    else:
        parts.append(_psf(analysis))
    if analysis.scores:
        parts.append(_photographs(analysis))
    parts.append(_time(analysis))
    return document(analysis.title, parts)


def _head(analysis: Analysis) -> str:
    summary = ""
    if analysis.best:
        gain = analysis.scores[analysis.best].psnr - analysis.scores["coded"].psnr
        name = tables.NAMES[analysis.best]
        summary = (
            f"<p>{name} brings the coded photograph {gain:.1f} dB closer to the neutral one, "
            "with the PSF that was measured on the star.</p>"
        )
    return heading(analysis.title, analysis.simulated) + summary


def _exposures(analysis: Analysis) -> str:
    return (
        "<h2>Exposures</h2>"
        + html_table(tables.EXPOSURE_COLUMNS, tables.exposure_rows(analysis))
        + f"<p>{escape(tables.EXPOSURE_NOTE)}</p>"
        + html_figure(png(pictures.histogram_figure(analysis)), "Digital numbers by exposure")
    )


def _psf(analysis: Analysis) -> str:
    return (
        "<h2>Point spread function</h2>"
        + html_figure(
            png(pictures.psf_figure(analysis)),
            "Logarithmic scale over four decades. The peak in the centre is unmodulated light.",
        )
        + '<div class="pair">'
        + html_table(["figure", "value "], tables.psf_rows(analysis))
        + html_figure(png(pictures.profile_figure(analysis)), "")
        + "</div>"
    )


def _photographs(analysis: Analysis) -> str:
    figures = "".join(
        html_figure(
            encoded(Path(f"{name}.png"), pictures.displayed(picture)),
            pictures.caption(analysis, name),
        )
        for name, picture in analysis.images.items()
    )
    return (
        "<h2>Photographs</h2>"
        + html_table(["picture", "PSNR dB ", "SSIM "], tables.score_rows(analysis))
        + "<p>Against the neutral photograph, over the central 90 % of each side; white is 1, "
        "and so are the peak of PSNR and the range of SSIM.</p>"
        + f'<div class="pair">{figures}</div><p>{escape(analysis.credit)}</p>'
    )


def _time(analysis: Analysis) -> str:
    rows = [[stage, f"{seconds:.2f}"] for stage, seconds in analysis.seconds.items()]
    return "<h2>Time</h2>" + html_table(["stage", "s "], rows) + footer()
