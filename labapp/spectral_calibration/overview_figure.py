"""One page of drawings: stars as seen and modelled, parameters, and light."""

from __future__ import annotations

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure, SubFigure
from matplotlib.patches import Ellipse
from matplotlib.ticker import MaxNLocator, NullFormatter, StrMethodFormatter
from numpy.typing import NDArray

from labapp.files.spectra_file import ParameterTable, SpectraFile
from labapp.spectral.drawing import cut_middle, reach_of_light, shown_bands
from labapp.spectral_calibration.fitting import SpectraFit
from labapp.spectral_calibration.radiances import LAMP, Radiances

_DECADES = 3  # powers of ten below its peak that a star is drawn over
_DIFFERENCE = 0.05  # of star and model, relative to the star's peak, that has the deepest colour

# Share of a star's modelled light that is drawn, and pixels around it.
_DRAWN_SHARE, _MARGIN = 0.9, 2

_COLOURS = {"R": "tab:red", "G": "tab:green", "B": "tab:blue"}
# Standard deviations; half axis of an ellipse that holds 90 % of two normal variables.
_NINETY = 2.146


def draw_spectra(fit: SpectraFit, file: SpectraFile, seen: Radiances | None) -> Figure:
    """Draw the stars, their model and its parameters on one page.

    Above is a column for each band: the star through the coded pattern, the calibrated model of it,
    and the difference. Below are zeroth orders, places, response, and the white sheet's radiance.
    """
    shown = shown_bands(len(file.bands))
    width = max(2.1 * len(shown), 13.0)
    figure = Figure(figsize=(width, 11.0), dpi=100, layout="constrained")
    simulated = [name for name, device in file.devices.items() if device.simulated]
    badge = f"   SIMULATED: {', '.join(simulated)}" if simulated else ""
    figure.suptitle(
        f"Spectral calibration of {file.bench}, pattern {file.coded_pattern}\n"
        f"{file.date:%Y-%m-%d %H:%M}, {file.frames} frames{badge}",
        fontsize=12,
        fontweight="bold",
    )
    parts = figure.subfigures(2, 1, height_ratios=[6.4, 4.0], squeeze=False)
    _draw_stars(parts[0, 0], fit, file, shown)
    axes = parts[1, 0].subplots(1, 3 if seen is None else 4)
    _draw_zeroth_orders(axes[0], file)
    _draw_places(axes[1], file)
    _draw_response(axes[2], fit, file)
    if seen is not None:
        _draw_radiances(axes[3], seen)
    return figure


def _draw_stars(figure: SubFigure, fit: SpectraFit, file: SpectraFile, shown: list[int]) -> None:
    """Draw stars, their models and what is left, a column for each band.

    Behind colour filters, only the pixels of the colours that see the band are bright.
    """
    axes = figure.subplots(3, len(shown), squeeze=False)
    reach = reach_of_light(fit.predicted, _DRAWN_SHARE) + _MARGIN
    for column, band in zip(axes.T, shown, strict=True):
        seen, model = (cut_middle(one[band], reach) for one in (fit.stars, fit.predicted))
        peak = float(seen.max())
        least = peak * 10.0**-_DECADES
        for axis, picture in zip(column, (seen, model), strict=False):
            drawn = np.maximum(picture, least)
            axis.imshow(drawn, cmap="magma", norm=LogNorm(least, peak), interpolation="nearest")
        left = (seen - model) / peak
        column[2].imshow(
            left, cmap="RdBu_r", vmin=-_DIFFERENCE, vmax=_DIFFERENCE, interpolation="nearest"
        )
        one = file.bands[band]
        column[0].set_title(f"{one.wavelength_nm:g} nm", fontsize=10)
        residual = f"residual {one.star_residual:.1%}".replace("%", " %")
        column[2].set_xlabel(residual, fontsize=9)
        for axis in column:
            axis.set(xticks=[], yticks=[])
    labels = (
        f"star, {_DECADES} decades",
        "calibrated model",
        f"difference, ±{_DIFFERENCE:g} of peak",
    )
    for axis, label in zip(axes[:, 0], labels, strict=True):
        axis.set_ylabel(label, fontsize=9)


def _select_parameters(file: SpectraFile, beginning: str) -> list[ParameterTable]:
    """Return the parameters whose names begin so, a band each."""
    return [one for one in file.parameters if one.name.startswith(beginning)]


def _draw_zeroth_orders(axes: Axes, file: SpectraFile) -> None:
    nm = [one.wavelength_nm for one in file.bands]
    found = _select_parameters(file, "zeroth order")
    axes.plot(nm, [one.nominal for one in found], "o:", mfc="none", color="0.5", label="nominal")
    axes.errorbar(
        nm,
        [one.value for one in found],
        yerr=[1.645 * one.sigma for one in found],
        fmt="o-",
        capsize=3,
        label="calibrated, 90 %",
    )
    (size,) = _select_parameters(file, "size")
    axes.set_ylim(bottom=0)
    axes.legend(fontsize=8)
    measured = f"{size.value:.4f} ± {size.sigma:.4f}"
    _label(axes, f"Zeroth order's share of the light\nsize of the coded PSFs {measured}")


def _draw_places(axes: Axes, file: SpectraFile) -> None:
    """Draw the places of the PSFs relative to most bands, with ellipses of 90 %."""
    ys, xs = _select_parameters(file, "centre y"), _select_parameters(file, "centre x")
    colours = _band_colours(len(ys))
    reach = 0.05
    for band, y, x, colour in zip(file.bands, ys, xs, colours, strict=True):
        sizes = 2 * _NINETY * x.sigma, 2 * _NINETY * y.sigma
        axes.add_patch(Ellipse((x.value, y.value), *sizes, fc=colour, ec=colour, alpha=0.3))
        axes.plot(x.value, y.value, "o", color=colour, ms=4, label=f"{band.wavelength_nm:g}")
        reach = max(reach, abs(x.value) + sizes[0] / 2, abs(y.value) + sizes[1] / 2)
    axes.set(xlim=(-1.15 * reach, 1.15 * reach), ylim=(1.15 * reach, -1.15 * reach))
    axes.set_box_aspect(1)
    axes.xaxis.set_major_locator(MaxNLocator(4))
    axes.axhline(0, color="0.7", lw=0.6, zorder=0)
    axes.axvline(0, color="0.7", lw=0.6, zorder=0)
    axes.set_title("Places of the PSFs, relative to most bands\nwith ellipses of 90 %", fontsize=10)
    axes.set_xlabel("right, px")
    axes.set_ylabel("down, px")
    axes.legend(fontsize=7, title="nm", title_fontsize=7, ncols=1 + len(ys) // 7)


def _band_colours(count: int) -> NDArray[np.float64]:
    """Return a colour for each band, from blue to red."""
    return np.asarray(colormaps["turbo"](np.linspace(0.08, 0.92, count)))


def _draw_response(axes: Axes, fit: SpectraFit, file: SpectraFile) -> None:
    """Draw what white gives behind each filter, beside the nominal."""
    nm = [one.wavelength_nm for one in file.bands]
    found, nominal = fit.found.response.numpy(), fit.prior.response.numpy()
    white = found.max()
    for number, letter in enumerate(file.channels):
        colour = _COLOURS.get(letter, f"C{number}")
        axes.semilogy(nm, found[number] / white, "o-", color=colour, ms=4, label=letter)
        axes.semilogy(nm, nominal[number] / white, "o:", color=colour, mfc="none", ms=7, alpha=0.6)
    # Plain numbers, as powers of ten would need another font.
    axes.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.set_ylim(max(float((found / white).min()) / 1.5, 1e-4), 1.3)
    axes.legend(fontsize=8)
    _label(axes, "Light of the white sheet behind each filter\ndotted: by the sensor's curves")


def _draw_radiances(axes: Axes, seen: Radiances) -> None:
    """Draw the white sheet's radiance in each band."""
    nm = seen.wavelengths * 1e9
    for values, colour in zip(seen.values, _band_colours(len(seen.values)), strict=True):
        axes.plot(nm, values.mean(0), color=colour)
    if seen.lamp is not None:
        axes.plot(nm, seen.lamp, color="0.4", lw=0.8, label=f"{LAMP}, without narrow filter")
        axes.legend(fontsize=8)
    axes.set_ylim(bottom=0)
    _label(axes, "Radiance of the white sheet\nW/(sr m² nm)")


def _label(axes: Axes, title: str) -> None:
    axes.set_title(title, fontsize=10)
    axes.set_xlabel("wavelength, nm")
    axes.grid(alpha=0.3)
