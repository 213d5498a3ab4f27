"""One page of drawings: registration, phase responses with residuals, wavefront."""

from __future__ import annotations

import math

import numpy as np
import torch
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from scipy import ndimage

from labapp.calibration.calibration_frames import CalibrationFrames
from labapp.calibration.fitting import CalibrationFits, RegionFit
from labapp.calibration.request import NEUTRAL_NAME
from labapp.files.calibration_file import CalibrationFile
from labapp.runs.record.reader import Record
from optics.camera.pupil import pupil_amplitude
from optics.slm import grey_to_phase


def draw_overview(fits: CalibrationFits, file: CalibrationFile) -> Figure:
    """Draw registration and sweep for each wavelength, and the wavefront, on one page.

    Each wavelength has a row of its own.
    """
    rows = len(fits.registrations) + (fits.wavefront is not None)
    figure = Figure(figsize=(17, 5.2 * rows + 0.6), dpi=100, layout="constrained")
    simulated = [name for name, device in file.devices.items() if device.simulated]
    badge = f"   SIMULATED: {', '.join(simulated)}" if simulated else ""
    figure.suptitle(
        f"Calibration of {file.bench}, {file.date:%Y-%m-%d %H:%M}, {file.frames} frames{badge}",
        fontsize=14,
        fontweight="bold",
    )
    parts = np.atleast_1d(np.asarray(figure.subfigures(rows, 1)))
    with Record(fits.path) as record:
        frames = CalibrationFrames.of(record)
        for part, nm in zip(parts, fits.registrations, strict=False):
            _wavelength_row(part, fits, frames, nm)
    if fits.wavefront is not None:
        _wavefront_row(parts[-1], fits)
    return figure


def _wavelength_row(
    figure: SubFigure, fits: CalibrationFits, frames: CalibrationFrames, nm: float
) -> None:
    grid = figure.add_gridspec(2, 3, width_ratios=[1.15, 1, 1], height_ratios=[3, 1])
    _draw_spots(figure.add_subplot(grid[:, 0]), fits, frames, nm)
    # At most twelve regions are drawn.
    regions = fits.responses.get(nm, [])[:12]
    if regions:
        _draw_curves(figure.add_subplot(grid[:, 1]), fits, regions, nm)
        upper = figure.add_subplot(grid[0, 2])
        _draw_light(upper, figure.add_subplot(grid[1, 2], sharex=upper), regions)


def _draw_spots(axes: Axes, fits: CalibrationFits, frames: CalibrationFrames, nm: float) -> None:
    """Draw the steered spots in one picture, with the registration's residuals and grid."""
    found, design = fits.registrations[nm], fits.design
    dark = frames.mean_dark_frame(nm)
    shown = [NEUTRAL_NAME, *design.steering_names(nm)]
    seen = np.max([frames.mean_light(name, nm, dark)[0] for name in shown], axis=0)
    # Spots of a few pixels are enlarged, because they would be invisible in the whole frame.
    seen = ndimage.grey_dilation(np.where(frames.hot_pixels(dark), 0.0, seen), (3, 3))
    logarithm = np.log10(np.clip(seen / float(seen.max()), 1e-3, 1))
    axes.imshow(logarithm, cmap="magma", interpolation="nearest")
    reach = max(math.hypot(*vector) for vector in design.compass)
    for k in np.linspace(-reach, reach, 9):
        for ends in (((k, -reach), (k, reach)), ((-reach, k), (reach, k))):
            line = found.to_pixels(np.array(ends))
            axes.plot(line[:, 1], line[:, 0], color="white", alpha=0.25, linewidth=0.6)
    places = found.to_pixels(np.array([(0.0, 0.0), *design.compass]))
    # The arrows show the registration's residuals, enlarged.
    arrow_scale = 200.0
    away = found.residuals * arrow_scale
    good = found.inliers
    axes.plot(places[good, 1], places[good, 0], "o", mfc="none", mec="cyan", ms=9, label="fitted")
    if not good.all():
        axes.plot(places[~good, 1], places[~good, 0], "rx", ms=9, label="outlier")
    axes.quiver(
        places[:, 1], places[:, 0], away[:, 1], away[:, 0],
        angles="xy", scale_units="xy", scale=1, color="lime", width=0.004,
    )  # fmt: skip
    axes.set(xlim=(-0.5, seen.shape[1] - 0.5), ylim=(seen.shape[0] - 0.5, -0.5))
    parts = found.parts
    axes.set_title(
        f"{nm:g} nm: flip {parts.flip}, {math.degrees(parts.rotation):+.2f}°; residual "
        f"{found.residual:.3f} px (arrows x{arrow_scale:g}),\nuncertainty in the corners "
        f"{found.field_uncertainty(frames.camera.sensor.shape):.3f} px",
        fontsize=10,
    )
    axes.legend(loc="lower left", fontsize=8)


def _draw_curves(axes: Axes, fits: CalibrationFits, regions: list[RegionFit], nm: float) -> None:
    panel = fits.camera.panel
    levels = np.arange(panel.levels)
    for number, region in enumerate(regions):
        fit = region.fit
        (line,) = axes.plot(levels, fit.phase / math.pi, label=f"region {number + 1}")
        low, high = ((fit.phase + s * fit.sigma) / math.pi for s in (-1, 1))
        axes.fill_between(levels, low, high, color=line.get_color(), alpha=0.3)
    if fits.camera.panel.response is None:
        table = grey_to_phase(panel, torch.arange(panel.levels), nm * 1e-9).numpy()
        axes.plot(levels, table / math.pi, "k--", linewidth=0.8, label="description")
    axes.set(xlabel="grey level", ylabel="phase, π")
    worst = max(float(region.fit.sigma.max()) for region in regions)
    axes.set_title(f"Phase response; 1σ at most {worst:.3f} rad", fontsize=10)
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8)


def _draw_light(axes: Axes, below: Axes, regions: list[RegionFit]) -> None:
    """Draw first orders' light against the fitted phase step, and residuals below."""
    for number, region in enumerate(regions):
        sweep, fit = region.sweep, region.fit
        step = fit.phase[sweep.high] - fit.phase[sweep.low]
        share = (sweep.light - fit.offset) / fit.swing
        residual = (sweep.light - fit.predicted) / fit.swing
        colour = f"C{number}"
        axes.plot(step[fit.inliers] / math.pi, share[fit.inliers], ".", color=colour)
        axes.plot(step[~fit.inliers] / math.pi, share[~fit.inliers], "x", color=colour)
        below.errorbar(
            step / math.pi, 100 * residual, 100 * sweep.noise / fit.swing,
            fmt=".", color=colour, linewidth=0.7, markersize=3,
        )  # fmt: skip
        fine = np.linspace(float(step.min()), float(step.max()), 400)
        expected = sweep.law(fine, fit.blur**2, fit.ripple**2) + fit.ghost * np.sin(fine)
        axes.plot(fine / math.pi, expected, color=colour, linewidth=0.7)
    residuals = [region.fit.residual for region in regions]
    axes.set_title(
        f"First-order light of the sweep; residual {100 * max(residuals):.2f} % rms at most",
        fontsize=10,
    )
    axes.set_ylabel("share of the swing")
    axes.grid(alpha=0.3)
    axes.tick_params(labelbottom=False)
    below.axhline(0, color="k", linewidth=0.6)
    below.set(xlabel="fitted step between the stripes, π", ylabel="residual, %")
    below.grid(alpha=0.3)


def _wavefront_row(figure: SubFigure, fits: CalibrationFits) -> None:
    found, pictures = fits.wavefront, fits.pictures
    assert found is not None
    assert pictures is not None
    flat, bars, seen = figure.subplots(1, 3, width_ratios=[1.15, 1, 1])
    path = found.path(fits.camera.panel).numpy() * 1e9
    lit = pupil_amplitude(fits.camera).numpy() > 0
    path = np.where(lit, path - path[lit].mean(), np.nan)
    most = max(float(np.nanmax(np.abs(path))), 1.0)
    image = flat.imshow(path, cmap="RdBu_r", vmin=-most, vmax=most, interpolation="nearest")
    figure.colorbar(image, ax=flat, shrink=0.8, label="nm")
    flat.set_title(
        f"Optical path besides the pattern: {found.rms * 1e9:.1f} ± {found.sigma * 1e9:.1f} nm rms",
        fontsize=10,
    )
    sigma = np.sqrt(np.diag(found.covariance)) * 1e9
    labels = [f"{n},{m}" for n, m in found.terms]
    bars.bar(labels, found.coefficients * 1e9, yerr=sigma, capsize=3)
    bars.set_ylabel("nm rms over the disc")
    bars.tick_params(axis="x", rotation=60)
    vergence, error = found.vergence
    bars.set_title(f"Zernike n,m; focus error {vergence:+.4f} ± {error:.4f} dioptres", fontsize=10)
    bars.grid(alpha=0.3)
    row = np.concatenate([light / light.max() for light in pictures.light], axis=1)
    seen.imshow(np.log10(np.clip(row, 1e-3, 1)), cmap="magma", interpolation="nearest")
    seen.set_title(
        f"The star: neutral, and with known defocus; residual {found.residual:.1%}", fontsize=10
    )
    seen.set(xticks=[], yticks=[])
