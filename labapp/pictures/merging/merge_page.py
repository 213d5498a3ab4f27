"""Build the report of a merged bracket as a single HTML file without external resources."""

from __future__ import annotations

from html import escape

import numpy as np
from matplotlib.figure import Figure

from labapp.common.figure_png import figure_to_png
from labapp.pictures.merging.merged_bracket import MergedFiles
from labapp.pictures.report.html import document, footer, heading, html_figure, html_table
from optics import hdr

EXPOSURE_COLUMNS = ("frame", "file", "exposure ", "light over it ", "clipped ")

_CLEAR = 0.1
"""Relative error up to which the efficiency and bias of a merge are summed up. Chosen."""

_STATES = {
    hdr.VALID: "measured",
    hdr.DARK: "dark: below three standard deviations of noise",
    hdr.CLIPPED: "clipped in all exposures: a lower bound",
    hdr.MAY_CLIP: "near the clip level of the shortest exposure: may be biased",
    hdr.MOVED: "contradictory: exposures were left out",
    hdr.DEFECTIVE: "defective",
}


def exposure_rows(merged: MergedFiles) -> list[list[str]]:
    """Return the rows of the table of exposures."""
    rows, source = [], merged.source
    for number, (name, time) in enumerate(zip(source.names, source.exposures, strict=True)):
        factor = _coded_factor(merged, number)
        if merged.factors is not None:
            found, deviation = merged.factors.factors[number], merged.factors.deviations[number]
            factor = f"{found:.4f} ± {deviation:.4f}" if deviation < 1 else "can't be told"
        rows.append(
            [str(number + 1), name, f"{time:.4g} s", factor, f"{merged.clipped[number]:.2%}"]
        )
    return rows


def _coded_factor(merged: MergedFiles, number: int) -> str:
    """Return the factor of an 8-bit frame in words; others are taken as 1."""
    found = merged.coded_times
    if found is None or number not in found.suspects:
        return "taken as 1"
    if len(found.suspects) > 1:
        return f"{found.factors[number]:.4f}, or others'"
    return f"{found.factors[number]:.4f} ± {found.deviations[number]:.4f}"


def state_rows(merged: MergedFiles) -> list[list[str]]:
    """Return the rows of the table of pixel states; absent ones are left out."""
    shares = {words: merged.share(state) for state, words in _STATES.items()}
    return [[words, f"{share:.3%}"] for words, share in shares.items() if share]


def merge_page(merged: MergedFiles, shown: bytes) -> str:
    """Return the whole report as an HTML page; shown: PNG of the light."""
    warnings = "".join(f"<p><strong>{escape(one)}</strong></p>" for one in merged.told)
    notes = "".join(f"<p>{escape(one)}</p>" for one in merged.notes)
    parts = [
        heading("Merged bracket", ()),
        warnings,
        notes,
        html_figure(shown, "Light, compressed for looking"),
        "<h2>Exposures</h2>",
        html_table(EXPOSURE_COLUMNS, exposure_rows(merged)),
        "<h2>Pixels</h2>",
        html_table(("state", "share "), state_rows(merged)),
        *_trust(merged),
        footer(),
    ]
    return document("Merged bracket", parts)


def accuracy_words(method: str, accuracy: hdr.ExpectedAccuracy) -> str:
    """Say in words how efficient and how biased an estimate is where its light is well measured."""
    clear = accuracy.errors <= _CLEAR
    if not clear.any():
        return f"method {method}: at no light of this bracket is the error {_CLEAR:.0%} or less"
    least, bias = accuracy.efficiencies[clear].min(), np.abs(accuracy.biases[clear])
    chance = 3 * accuracy.bias_noise[clear]
    sure = bool((bias > chance).any())
    largest = bias[bias > chance].max() if sure else chance.max()
    return (
        f"method {method}, by simulation: its efficiency is at least {min(least, 1):.2f} of the "
        f"best unbiased estimate's, its bias {'up to' if sure else 'below'} {largest:.1g} of the "
        f"light, where the error is {_CLEAR:.0%} or less"
    )


def _trust(merged: MergedFiles) -> list[str]:
    """Return the part of the report that says what its numbers rest on."""
    if merged.accuracy is None:
        return [
            "<h2>Response curve</h2>",
            html_figure(
                figure_to_png(response_figure(merged)),
                "Number of a pixel by its light times the exposure time, as the frames show it "
                "(Debevec and Malik 1997). The light's unit is arbitrary",
            ),
        ]
    sensor, defects = merged.source.sensor, merged.source.defects
    rows = [
        ["gain", f"{sensor.gain:.4g} electrons/DN"],
        ["read noise", f"{sensor.read_noise:.3g} electrons"],
        ["dark current", f"{sensor.dark_current:.3g} electrons/s"],
        ["full scale", f"{sensor.full_scale} DN"],
    ]
    if defects is not None:
        rows.append(["defective pixels that were known", str(int(defects.sum()))])
    return [
        "<h2>Sensor</h2>",
        html_table(("", "value "), rows),
        f"<p>Source: {escape(merged.source.sensor_source)}.</p>",
        "<h2>Accuracy</h2>",
        f"<p>{escape(accuracy_words(merged.method, merged.accuracy))}.</p>",
        html_figure(
            figure_to_png(accuracy_figure(merged, merged.accuracy)),
            f"Of frames simulated with these exposures and this sensor, method {merged.method}. "
            "Efficiency: least variance of any unbiased estimate over the mean squared error",
        ),
    ]


def response_figure(merged: MergedFiles) -> Figure:
    """Draw the response curves of 8-bit pictures, one for each band."""
    figure = Figure(figsize=(7, 4.2), dpi=100, layout="constrained")
    axes = figure.subplots()
    colours = ("black",) if len(merged.curves) == 1 else ("tab:red", "tab:green", "tab:blue")
    for curve, colour in zip(merged.curves, colours, strict=True):
        lowest, highest = curve.ends
        numbers = np.arange(lowest, highest + 1)
        axes.semilogx(np.exp(curve.logs[numbers]), numbers, color=colour)
    axes.set(xlabel="light times exposure time, 1 for number 128", ylabel="number")
    return figure


def accuracy_figure(merged: MergedFiles, found: hdr.ExpectedAccuracy) -> Figure:
    """Draw error and efficiency by the light, with its histogram."""
    figure = Figure(figsize=(13, 4.2), dpi=100, layout="constrained")
    left, right = figure.subplots(1, 2)
    left.loglog(found.rates, found.errors, "o-", label="error, rms")
    left.loglog(found.rates, np.maximum(np.abs(found.biases), 1e-6), "s:", label="bias")
    left.loglog(found.rates, found.bias_noise, "--", color="gray", label="chance in the bias")
    left.set(xlabel="light (electrons/s)", ylabel="relative")
    efficiency = left.twinx()
    efficiency.plot(found.rates, found.efficiencies, "^-", color="tab:green", label="efficiency")
    efficiency.set(ylim=(0, 1.3), ylabel="efficiency")
    lines = [*left.get_lines(), *efficiency.get_lines()]
    names = [str(one.get_label()) for one in lines]
    left.legend(lines, names, loc="lower center", bbox_to_anchor=(0.5, 1), ncols=len(lines))
    lit = merged.rate[merged.rate > 0]
    if lit.size:
        right.hist(np.log10(lit[:: max(1, lit.size // 1_000_000)]), bins=120, log=True)
    right.set(xlabel="log₁₀ of the light (electrons/s)", ylabel="pixels")
    return figure
