"""One page of drawings: photon transfer, linearity, darkness, noise and defects."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from labapp.calibration.camera.result_report import camera_rows
from labapp.files.camera_noise_file import CameraNoiseFile
from optics.measuring import CameraNoise
from optics.measuring.photon_transfer import FIT_SHARE

_FITTED, _OTHER, _LINE = "tab:blue", "tab:orange", "black"

_KINDS = (
    ("hot", "hot, by dark signal", "tab:red", "o"),
    ("bright", "hot, by response", "tab:orange", "^"),
    ("weak", "weak", "tab:blue", "v"),
    ("dead", "dead", "black", "x"),
)


def draw_camera(noise: CameraNoise, file: CameraNoiseFile) -> Figure:
    """Draw curves with their fits and residuals, defects, and results on one page."""
    figure = Figure(figsize=(17, 10), dpi=100, layout="constrained")
    badge = "   SIMULATED" if file.camera.simulated else ""
    figure.suptitle(
        f"Camera of {file.bench}: {file.camera.model} {file.camera.serial}, "
        f"{file.date:%Y-%m-%d %H:%M}, {file.frames} frames at {file.wavelength_nm:.0f} nm{badge}",
        fontsize=14,
        fontweight="bold",
    )
    grid = figure.add_gridspec(4, 3, height_ratios=[3, 1.2, 3, 1.2], width_ratios=[1.1, 1, 1])
    upper = figure.add_subplot(grid[0, 0])
    _draw_transfer(upper, figure.add_subplot(grid[1, 0], sharex=upper), noise)
    upper = figure.add_subplot(grid[0, 1])
    _draw_linearity(upper, figure.add_subplot(grid[1, 1], sharex=upper), noise)
    _draw_noise(figure.add_subplot(grid[2:, 0]), noise)
    upper = figure.add_subplot(grid[2, 1])
    _draw_darkness(upper, figure.add_subplot(grid[3, 1], sharex=upper), noise)
    _write_results(figure.add_subplot(grid[0:2, 2]), file)
    _draw_defects(figure.add_subplot(grid[2:, 2]), file)
    return figure


def _draw_transfer(axes: Axes, below: Axes, noise: CameraNoise) -> None:
    """Draw the photon transfer curve with its fit, and residuals in their uncertainties."""
    curve, gain = noise.transfer, noise.transfer.system_gain.value
    used = curve.used
    expected = gain * (curve.signal + curve.offset.value)
    axes.plot(
        curve.signal[~used], curve.variance[~used], "x", color=_OTHER, ms=4, label="not fitted"
    )
    axes.plot(curve.signal[used], curve.variance[used], ".", color=_FITTED, ms=4, label="fitted")
    ends = np.array([0.0, float(curve.signal.max())])
    axes.plot(
        ends, gain * (ends + curve.offset.value), color=_LINE, lw=1,
        label=f"K = {gain:.5g} ± {curve.system_gain.sigma:.1g} DN/e-",
    )  # fmt: skip
    _mark_saturation(axes, noise)
    axes.set_ylim(0, 1.15 * float(max(curve.variance.max(), expected[used].max())))
    axes.set_ylabel("temporal variance less dark, DN²")
    axes.set_title(
        f"Photon transfer: {noise.gain.value:.5g} ± {noise.gain.sigma:.1g} e-/DN, "
        f"reduced χ² {curve.chi2:.2f}",
        fontsize=11,
    )
    axes.legend(fontsize=8, loc="upper left")
    axes.grid(alpha=0.3)
    axes.tick_params(labelbottom=False)
    left = (curve.variance - expected)[used] / curve.sigma[used]
    below.plot(curve.signal[used], left, ".", color=_FITTED, ms=3)
    below.axhspan(-2, 2, color="gray", alpha=0.15)
    below.axhline(0, color=_LINE, lw=0.6)
    below.set(xlabel="signal, DN", ylabel="residual, σ", ylim=(-4.5, 4.5))
    below.grid(alpha=0.3)


def _mark_saturation(axes: Axes, noise: CameraNoise) -> None:
    """Mark where pixels clip, and up to where the curve is fitted."""
    if noise.clip_number is None:
        return
    full = noise.clip_number.value - noise.black_level.value
    axes.axvline(full, color="tab:red", lw=0.8, ls="--", label="pixels clip")
    axes.axvline(FIT_SHARE * full, color="gray", lw=0.8, ls=":", label=f"{FIT_SHARE:.0%} of it")


def _draw_linearity(axes: Axes, below: Axes, noise: CameraNoise) -> None:
    """Draw the signal by exposure time, and its deviation from the best line."""
    curve = noise.transfer
    axes.plot(curve.exposure * 1e3, curve.signal, "x", color=_OTHER, ms=4, label="areas")
    axes.set_ylabel("signal, DN")
    axes.grid(alpha=0.3)
    axes.tick_params(labelbottom=False)
    below.axhline(0, color=_LINE, lw=0.6)
    below.set(xlabel="exposure time, ms", ylabel="deviation, %")
    below.grid(alpha=0.3)
    found = noise.linearity
    if found is None:
        axes.set_title("Linearity: too few exposures between 5 and 95 %", fontsize=11)
        return
    axes.plot(found.exposure * 1e3, found.signal, ".", color=_FITTED, label="judged, 5 to 95 %")
    ends = np.array([0.0, float(curve.exposure.max())])
    axes.plot(ends * 1e3, found.rate * ends, color=_LINE, lw=1, label="line")
    axes.set_ylim(0, 1.1 * float(curve.signal.max()))
    axes.legend(fontsize=8, loc="lower right")
    words = f"Linearity error {found.error.value:.3%}".replace("%", " %")
    if found.drift is not None:
        words += f"; lamp's drift {found.drift.value:+.2%}, taken off".replace("%", " %")
    axes.set_title(words, fontsize=11)
    below.plot(found.exposure * 1e3, 100 * found.deviation, ".", color=_FITTED, ms=4)


def _draw_noise(axes: Axes, noise: CameraNoise) -> None:
    """Draw the signal-to-noise ratio by the signal, with and without the fixed pattern."""
    curve, gain = noise.transfer, noise.gain.value
    light = gain * curve.signal
    squared = gain**2 * (curve.variance + noise.dark.points[0].variance)
    shown = (light > 0) & (squared > 0) & curve.used
    axes.loglog(light[shown], light[shown] / np.sqrt(squared[shown]), ".", color=_FITTED, ms=4,
                label="measured")  # fmt: skip
    most = (noise.full_well or noise.gain * float(curve.signal.max())).value
    x = np.geomspace(max(0.3, noise.sensitivity_threshold.value / 3), most, 200)
    floor = noise.read_noise.value**2 + gain**2 / 12
    axes.loglog(x, x / np.sqrt(x + floor), color=_LINE, lw=1, label="fit, temporal noise")
    if noise.prnu is not None:
        fixed = noise.dsnu.value**2 + (noise.prnu.value * x) ** 2
        axes.loglog(x, x / np.sqrt(x + floor + fixed), "--", color="tab:green", lw=1,
                    label="with PRNU and DSNU")  # fmt: skip
    axes.loglog(x, np.sqrt(x), ":", color="gray", lw=1, label="shot noise alone")
    axes.axvline(noise.sensitivity_threshold.value, color="gray", lw=0.8, ls="--")
    axes.axhline(1, color="gray", lw=0.8, ls="--")
    axes.set(xlabel="light, electrons", ylabel="signal-to-noise ratio")
    limit = "at most " if noise.read_noise_is_limit else ""
    axes.set_title(
        f"Signal to noise: read noise {limit}{noise.read_noise.value:.4g} ± "
        f"{noise.read_noise.sigma:.1g} e-, threshold {noise.sensitivity_threshold.value:.3g} e-",
        fontsize=11,
    )
    axes.legend(fontsize=8, loc="upper left")
    axes.grid(alpha=0.3, which="both")


def _draw_darkness(axes: Axes, below: Axes, noise: CameraNoise) -> None:
    """Draw the dark number and its temporal noise by exposure time."""
    dark = noise.dark
    time, mean, sigma, variance = (
        np.array([getattr(one, name) for one in dark.points])
        for name in ("exposure", "mean", "mean_sigma", "variance")
    )
    axes.errorbar(time, mean, sigma, fmt=".", color=_FITTED, lw=0.8, ms=5)
    ends = np.array([0.0, float(time.max())])
    axes.plot(ends, dark.black_level.value + dark.current.value * ends, color=_LINE, lw=1)
    axes.set_ylabel("mean number, DN")
    axes.ticklabel_format(axis="y", useOffset=False)
    axes.set_title(
        f"Darkness: {noise.black_level.value:.4f} DN, dark current "
        f"{noise.dark_current.value:.3g} ± {noise.dark_current.sigma:.1g} e-/s",
        fontsize=11,
    )
    axes.grid(alpha=0.3)
    axes.tick_params(labelbottom=False)
    below.plot(time, np.sqrt(variance), ".", color=_FITTED, ms=5)
    below.set(xlabel="exposure time, s", ylabel="noise, DN")
    below.grid(alpha=0.3)


def _write_results(axes: Axes, file: CameraNoiseFile) -> None:
    """Write the results as a table."""
    axes.axis("off")
    rows = [[name, value, f"± {sigma}" if sigma else "", unit]
            for name, value, sigma, unit, _ in camera_rows(file)]  # fmt: skip
    table: Any = axes.table(
        rows, loc="upper center", cellLoc="right", colWidths=[0.44, 0.22, 0.2, 0.14], edges="open"
    )
    table.auto_set_font_size(False)
    table.set_fontsize(10)
    table.scale(1, 1.35)
    for (_, column), cell in table.get_celld().items():
        if column in (0, 3):
            cell.set_text_props(ha="left")
    axes.set_title("Results (EMVA 1288), with standard uncertainties", fontsize=11)


def _draw_defects(axes: Axes, file: CameraNoiseFile) -> None:
    """Draw where on the sensor defective pixels lie."""
    for kind, words, colour, marker in _KINDS:
        pixels = np.array(getattr(file.defects, kind)).reshape(-1, 2)
        axes.plot(
            pixels[:, 1], pixels[:, 0], marker, color=colour, mfc="none", ms=5, ls="none",
            label=f"{words}: {len(pixels)}",
        )  # fmt: skip
    axes.set_xlim(-0.5, file.sensor["width"] - 0.5)
    axes.set_ylim(file.sensor["height"] - 0.5, -0.5)
    axes.set_aspect("equal")
    axes.set(xlabel="column", ylabel="row")
    axes.set_title("Defective pixels", fontsize=11)
    axes.legend(fontsize=8, loc="upper center", bbox_to_anchor=(0.5, -0.12), ncols=4)
