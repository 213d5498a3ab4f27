"""Refinement of the camera's model from the photograph alone, and its findings as data and rows."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import torch

from labapp.files.spectra_file import name_bands
from labapp.spectral.problem import SpectralProblem
from optics.inverse.restored_image import RestoredImage
from optics.multispectral import SnapshotCalibration, refine_from_photograph
from optics.progress import Progress


def refine_problem(
    problem: SpectralProblem, progress: Progress
) -> tuple[SpectralProblem, SnapshotCalibration, RestoredImage]:
    """Refine the camera's model from the photograph, and restore the bands with it.

    Returns the problem with refined PSFs and response, the calibration, and the restored bands. The
    problem must have a prior.
    """
    assert problem.prior is not None
    spectra = torch.from_numpy(problem.spectra)
    refined, image = refine_from_photograph(
        problem.observation, spectra, problem.prior, progress=progress
    )
    shares = problem.psfs.sum((1, 2))
    shapes, response = refined.psfs.numpy(), refined.response.numpy()
    return (
        replace(
            problem,
            psfs=shapes * (shares / shapes.sum((1, 2)))[:, None, None],
            response=replace(problem.response, shares=response / shares),
            psf_source=f"{problem.psf_source}, refined from the photograph",
        ),
        refined,
        image,
    )


def parameters_as_data(
    found: SnapshotCalibration, prior: SnapshotCalibration, wavelengths: Sequence[float]
) -> dict[str, Any]:
    """Return a refined camera as plain data: parameters, and what is indeterminate.

    Each parameter has its value before the refinement, with its standard deviation.
    """
    pairs = zip(found.parameters, prior.parameters, strict=True)
    return {
        "parameters": [
            {
                "name": name_bands(one.name, wavelengths),
                "unit": one.unit.replace("pixel", "px"),
                "value": one.value,
                "sigma": one.deviation,
                "lower": one.lower,
                "upper": one.upper,
                "before": old.value,
                "before_sigma": old.deviation,
            }
            for one, old in pairs
        ],
        "indeterminate": list(found.indeterminate),
        "prior": prior.source,
    }


def parameter_rows(
    found: SnapshotCalibration, prior: SnapshotCalibration, wavelengths: Sequence[float]
) -> list[list[str]]:
    """Return a printed row for each parameter of a refined camera, now and before."""
    rows = []
    for one in parameters_as_data(found, prior, wavelengths)["parameters"]:
        now = format_estimate(one["value"], one["sigma"], one["unit"])
        before = format_estimate(one["before"], one["before_sigma"], "")
        rows.append([one["name"], *now, " ".join(before)])
    return rows


def format_estimate(value: float, sigma: float, unit: str) -> tuple[str, str]:
    """Return a value and its standard deviation as text, with the unit.

    The deviation has two significant digits.
    """
    digits = min(max(2, 1 - math.floor(math.log10(sigma))), 6) if sigma > 0 else 4
    return f"{value:.{digits}f}{f' {unit}' if unit else ''}", f"± {sigma:.{digits}f}"
