"""Cross-validation of a snapshot camera's model: pixels that a restoration doesn't see judge it."""

from __future__ import annotations

import torch

from optics.multispectral.photograph_fit import PhotographFit
from optics.multispectral.snapshot_calibration import SnapshotCalibration
from optics.progress import Progress

_EVERY = 8
"""One pixel in so many is held out, at random places. With 3, the scene between them is restored so
much worse that the estimates get worse."""

_STEPS = 3
"""Steps of Gauss-Newton's method. Measured on six scenes: the zeroth order is within 0.01 of the
end after three."""

_DIFFERENCES = (0.01, 0.003)
"""Steps of zeroth order and scale for derivatives, which are small beside what matters."""

_LARGEST_STEPS = (0.03, 0.01)
"""Largest step of zeroth order and scale. Beyond a zeroth order of 0.29, rings have no zeros in
their OTF any more, and a step across that point leads astray."""

_CAUTION = 25.0
"""Factor on the variance of the held-out residuals, whose errors are alike in neighbouring pixels
and which other wrong parameters change as well. Measured on six scenes: the estimate's errors are
about five times as large as the residuals alone let expect."""


def validate_on_held_out_pixels(
    fit: PhotographFit, prior: SnapshotCalibration, progress: Progress
) -> torch.Tensor:
    """Estimate a snapshot camera's zeroth order and scale by cross-validation.

    The photograph is restored without some of its pixels, and the model whose restoration predicts
    these pixels best is looked for by Gauss-Newton's method. An error of the zeroth order that all
    bands share and the scale are estimated, as they matter most; all else stays as it was. Unlike
    the residual of pixels that the restoration has seen, that of others isn't least for models that
    allow the picture to explain noise.

    Parameters
    ----------
    fit : PhotographFit
        The photograph.
    prior : SnapshotCalibration
        What is known before.
    progress : Progress
        Receives reports, and can cancel the work.

    Returns
    -------
    torch.Tensor, (parameters,), float64
        The model's deviations from nominal: a start for better estimates.

    References
    ----------
    Reeves and Mersereau 1992, doi 10.1109/83.148604 (blur identification by cross-validation).
    """
    layout, start = prior.model.layout, prior.deviation
    ways = torch.zeros(2, layout.count, dtype=torch.float64)
    ways[0, layout.zeroth_orders] = 1
    ways[1, layout.scale] = 1
    precision = ways @ torch.linalg.inv(prior.covariance) @ ways.mT
    largest = torch.tensor(_LARGEST_STEPS, dtype=torch.float64)
    generator = torch.Generator().manual_seed(0)
    chosen = torch.randint(_EVERY, tuple(fit.weights.shape), generator=generator) == 0
    judges = chosen & (fit.weights > 0)
    place = torch.zeros(2, dtype=torch.float64)
    weight: float | None = None
    for number in range(_STEPS):
        progress.report(number / _STEPS, f"zeroth order and size of PSFs {number + 1}/{_STEPS}")
        deviation = start + place @ ways
        if number < 2:
            _, weight = fit.restore(fit.observe(deviation))
        residual = _held_out_residual(fit, deviation, judges, weight)
        slopes = torch.stack([
            (residual - _held_out_residual(fit, deviation + step * way, judges, weight)) / step
            for step, way in zip(_DIFFERENCES, ways, strict=True)
        ])  # fmt: skip
        variance = _CAUTION * residual.square().mean()
        information = slopes @ slopes.mT / variance + precision
        step = torch.linalg.solve(information, slopes @ residual / variance - precision @ place)
        place = place + step * (largest / step.abs().clamp(min=1e-12)).min().clamp(max=1)
    return start + place @ ways


def _held_out_residual(
    fit: PhotographFit, deviation: torch.Tensor, judges: torch.Tensor, weight: float | None
) -> torch.Tensor:
    """Return the residuals of a snapshot's held-out pixels, over their noise, as a vector."""
    seen = fit.observe(deviation, weights=fit.weights * ~judges)
    picture, _ = fit.restore(seen, weight)
    left = seen.image - fit.predict(seen, picture)
    return (left * fit.weights.sqrt() / fit.noise)[judges].to(torch.float64)
