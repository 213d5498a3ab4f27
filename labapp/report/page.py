"""The report as one HTML file that needs nothing else, online or off."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from datetime import UTC, datetime
from html import escape

import cv2

import labapp
from labapp.analysis import Analysis
from labapp.analysis.brackets import Picture
from labapp.report import pictures, tables

_STYLE = """
:root { color-scheme: light dark; --line: #8884; --soft: #8882; }
body { font: 16px/1.5 system-ui, sans-serif; max-width: 78rem; margin: 2rem auto; padding: 0 1rem; }
h1 { margin-bottom: .2rem } h2 { margin-top: 2.2rem }
.badge { background: #b45309; color: #fff; border-radius: .4rem; padding: .1rem .6rem;
  font-weight: 600; font-size: .9rem }
table { border-collapse: collapse; margin: .6rem 0 }
th, td { padding: .25rem .9rem .25rem 0; text-align: left; border-bottom: 1px solid var(--line) }
td.number, th.number { text-align: right; font-variant-numeric: tabular-nums }
figure { margin: .6rem 0 } figcaption { font-size: .95rem; padding: .2rem 0 }
img { max-width: 100%; height: auto; border-radius: .3rem; background: #fff }
.pair { display: grid; grid-template-columns: repeat(auto-fit, minmax(30rem, 1fr)); gap: 1rem;
  align-items: start }
footer { margin-top: 3rem; font-size: .85rem; opacity: .7 }
"""


def page(analysis: Analysis) -> str:
    """The whole report as HTML text."""
    parts = [_head(analysis), _exposures(analysis)]
    if analysis.psf is None:
        parts.append(_figure(pictures.png(pictures.gallery(analysis)), "The merged pictures"))
    else:
        parts.append(_psf(analysis))
    if analysis.scores:
        parts.append(_photographs(analysis))
    parts.append(_time(analysis))
    body = "\n".join(parts)
    return (
        '<!doctype html><html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{escape(analysis.title)}</title><style>{_STYLE}</style></head>"
        f"<body>{body}</body></html>\n"
    )


def _head(analysis: Analysis) -> str:
    badge = ""
    if analysis.simulated:
        badge = f'<span class="badge">SIMULATED: {escape(", ".join(analysis.simulated))}</span>'
    summary = ""
    if analysis.best:
        gain = analysis.scores[analysis.best].psnr - analysis.scores["coded"].psnr
        name = tables.NAMES[analysis.best]
        summary = (
            f"<p>{name} brings the coded photograph {gain:.1f} dB closer to the neutral one, "
            "with the PSF that was measured on the star.</p>"
        )
    return f"<h1>{escape(analysis.title)}</h1>{badge}{summary}"


def _exposures(analysis: Analysis) -> str:
    return (
        "<h2>Exposures</h2>"
        + _table(tables.EXPOSURE_COLUMNS, tables.exposure_rows(analysis))
        + f"<p>{escape(tables.EXPOSURE_NOTE)}</p>"
        + _figure(pictures.png(pictures.histogram_figure(analysis)), "Digital numbers by exposure")
    )


def _psf(analysis: Analysis) -> str:
    return (
        "<h2>Point spread function</h2>"
        + _figure(
            pictures.png(pictures.psf_figure(analysis)),
            "Logarithmic scale over four decades. The peak in the centre is unmodulated light.",
        )
        + '<div class="pair">'
        + _table(["figure", "value "], tables.psf_rows(analysis))
        + _figure(pictures.png(pictures.profile_figure(analysis)), "")
        + "</div>"
    )


def _photographs(analysis: Analysis) -> str:
    figures = "".join(
        _figure(_encoded(picture), pictures.caption(analysis, name))
        for name, picture in analysis.images.items()
    )
    return (
        "<h2>Photographs</h2>"
        + _table(["picture", "PSNR dB ", "SSIM "], tables.score_rows(analysis))
        + "<p>Against the neutral photograph, over the central 90 % of each side; white is 1, "
        "and so are the peak of PSNR and the range of SSIM.</p>"
        + f'<div class="pair">{figures}</div><p>{escape(analysis.credit)}</p>'
    )


def _time(analysis: Analysis) -> str:
    rows = [[stage, f"{seconds:.2f}"] for stage, seconds in analysis.seconds.items()]
    made = datetime.now(UTC).isoformat(timespec="seconds")
    return (
        "<h2>Time</h2>"
        + _table(["stage", "s "], rows)
        + f"<footer>labapp {labapp.__version__}, {made}</footer>"
    )


def _table(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Columns whose heading ends in a blank are numbers."""
    kinds = [' class="number"' if head.endswith(" ") else "" for head in heads]
    top = "".join(f"<th{k}>{escape(h.strip())}</th>" for h, k in zip(heads, kinds, strict=True))
    lines = [
        "".join(f"<td{k}>{escape(cell)}</td>" for cell, k in zip(row, kinds, strict=True))
        for row in rows
    ]
    inner = "".join(f"<tr>{line}</tr>" for line in lines)
    return f"<table><thead><tr>{top}</tr></thead><tbody>{inner}</tbody></table>"


def _figure(data: bytes, text: str) -> str:
    source = "data:image/png;base64," + base64.b64encode(data).decode()
    under = f"<figcaption>{escape(text)}</figcaption>" if text else ""
    return f'<figure><img src="{source}" alt="{escape(text)}">{under}</figure>'


def _encoded(picture: Picture) -> bytes:
    done, data = cv2.imencode(".png", pictures.displayed(picture))
    if not done:
        raise RuntimeError("OpenCV could not encode a PNG")
    return data.tobytes()
