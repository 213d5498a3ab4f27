"""Wavefront and focus, from pictures of the star with known phases on the panel.

One picture of a point can't tell a wavefront from its mirror image; several, with a defocus of
known strength on the panel between them, can (phase diversity: Gonsalves 1982,
doi 10.1117/12.7972989).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from optics.calibration.star_model import StarModel
from optics.camera import Panel
from optics.plane import Plane
from optics.progress import Progress
from optics.zernike import zernike

Array = NDArray[np.float64]
Term = tuple[int, int]

TERMS: tuple[Term, ...] = tuple((n, m) for n in range(2, 5) for m in range(-n, n + 1, 2))
"""Zernike polynomials that are fitted unless others are asked for: defocus to the fourth degree."""

_DEFOCUS = (2, 0)

_START_DEFOCUS = np.linspace(-1.0, 1.0, 9)
"""Waves of defocus, root mean square, from which a fit may begin."""

_STARTS_FOLLOWED = 2
_STEPS = 60

_GOOD_CHI2 = 1.5
"""Mean squared misfit in standard deviations from which no other start is tried."""

_PARAMETER_UNIT = 0.05
"""Of a wave, root mean square, and of a pixel: a step that an optimiser takes for one."""

_BEAM_UNIT = 0.2
"""The same of the logarithm of the light's amplitude at the disc's edge."""

_MAX_CORRELATION = 0.95
"""Correlation of neighbouring pixels' misfits beyond which no number of pixels is believed."""

_DIFFERENCE_STEP = 0.02
"""Of the unit, for derivatives by differences."""

_MODEL_ERROR = 0.005
"""Of a picture's peak, by which the model may be wrong beside the noise."""


@dataclass(frozen=True, eq=False)
class WavefrontFit:
    """Optical path besides the pattern, as Zernike polynomials over a disc about the pupil.

    terms: (n, m). coefficients: metres, root mean square over the disc; covariance: m². radius:
    of the disc, metres on the panel. rms, sigma: of the path over the open pupil, less its mean
    and tilt, and its standard deviation there, metres. offset: (y, x) pixels between the star's
    geometric image and the registration's centre. residual: relative L2 between pictures and
    model. chi2: mean squared residual in standard deviations, less what was fitted.
    """

    terms: tuple[Term, ...]
    coefficients: Array
    covariance: Array
    radius: float
    rms: float
    sigma: float
    offset: tuple[float, float]
    residual: float
    chi2: float

    @property
    def vergence(self) -> tuple[float, float]:
        """Focus error in dioptres, and its standard deviation: of the star's distance, as if it
        stood elsewhere than in the plane in focus."""
        k = self.terms.index(_DEFOCUS)
        scale = 4 * math.sqrt(3) / self.radius**2
        sigma = math.sqrt(float(self.covariance[k, k]))
        return scale * float(self.coefficients[k]), scale * sigma

    def path(self, panel: Panel) -> torch.Tensor:
        """Metres at the panel's pixels, (rows, columns) float64."""
        return zernike_path(self.terms, self.coefficients, self.radius, panel.plane)


def zernike_path(
    terms: Sequence[Term], coefficients: Sequence[float] | Array, radius: float, plane: Plane
) -> torch.Tensor:
    """The sum of Zernike polynomials over a disc, metres, (rows, columns) of a plane."""
    y, x = plane.mesh()
    total = torch.zeros(plane.shape, dtype=torch.float64)
    for (n, m), strength in zip(terms, coefficients, strict=True):
        total = total + float(strength) * zernike(n, m, y / radius, x / radius)
    return total


@dataclass(frozen=True, eq=False)
class StarPictures:
    """What was seen: light (pictures, rows, columns) less its dark, with its variance.

    usable: pixels that may be believed, neither clipped nor hot.
    """

    light: Array
    variance: Array
    usable: NDArray[np.bool_]

    def __post_init__(self) -> None:
        shapes = {self.light.shape, self.variance.shape, self.usable.shape}
        if len(shapes) > 1 or self.light.ndim != 3:
            raise ValueError(
                "light, variance and usable pixels must have the same three axes; here: "
                f"{', '.join(map(str, sorted(shapes)))}"
            )
        if not (np.isfinite(self.light).all() and (self.variance > 0).all()):
            raise ValueError("light must be finite and its variance positive")


def fit_wavefront(
    model: StarModel,
    pictures: StarPictures,
    *,
    terms: Sequence[Term] = TERMS,
    progress: Progress | None = None,
) -> WavefrontFit:
    """The Zernike polynomials that make a model show what was seen.

    model: of the star through panel and lens, with the patterns that were shown. Least squares
    in units of noise, by gradients through the PSF (L-BFGS), from the defocus that fits best of
    nine; each picture's light and background are fitted with it. Raises ValueError if fewer
    than two pictures were taken, or defocus isn't among the terms.
    """
    if len(pictures.light) < 2 or len(pictures.light) != model.pattern_count:
        raise ValueError(
            f"{len(pictures.light)} pictures of {model.pattern_count} patterns; a wavefront needs "
            "one of each, and two at least"
        )
    if _DEFOCUS not in terms:
        raise ValueError("terms lack defocus, (2, 0); add it")
    progress = progress or Progress()
    task = _WavefrontProblem(model, pictures, tuple(terms))
    starts = sorted(
        (task.initial_parameters(defocus * 0.5) for defocus in _START_DEFOCUS), key=task.cost
    )
    found = []
    for number, start in enumerate(starts[:_STARTS_FOLLOWED]):
        part = progress.part(number / (_STARTS_FOLLOWED + 1), (number + 1) / (_STARTS_FOLLOWED + 1))
        found.append(task.minimise(start, part))
        if task.chi2(found[-1]) < _GOOD_CHI2:
            break
    best = min(found, key=task.cost)
    progress.report(_STARTS_FOLLOWED / (_STARTS_FOLLOWED + 1), "wavefront: uncertainty")
    return task.build_fit(best)


class _WavefrontProblem:
    """Parameters are the polynomials, in _UNIT waves; the star's place (y, x), in _UNIT pixels;
    and, in _BEAM_UNIT, the slopes along y and x and the fall towards the edge of the light's
    amplitude on the panel, as a Gaussian beam has them."""

    def __init__(self, model: StarModel, pictures: StarPictures, terms: tuple[Term, ...]) -> None:
        self._model, self._terms = model, terms
        self._light = torch.from_numpy(pictures.light)
        peak = pictures.light.max(axis=(1, 2), keepdims=True)
        variance = pictures.variance + (_MODEL_ERROR * peak) ** 2
        weight = np.where(pictures.usable, 1 / variance, 0.0)
        self._weight = torch.from_numpy(weight)
        y, x = model.plane.mesh()
        shapes = [zernike(n, m, y / model.radius, x / model.radius) for n, m in terms]
        self._shapes = torch.stack([shape.expand(model.plane.shape) for shape in shapes])
        self._path_unit = _PARAMETER_UNIT * model.wavelength
        y, x = (axis.expand(model.plane.shape) / model.radius for axis in (y, x))
        self._beam = torch.stack([y, x, y**2 + x**2]) * _BEAM_UNIT

    def initial_parameters(self, waves: float) -> torch.Tensor:
        start = torch.zeros(len(self._terms) + 2 + len(self._beam), dtype=torch.float64)
        start[self._terms.index(_DEFOCUS)] = waves / _PARAMETER_UNIT
        return start

    def _split_parameters(
        self, parameters: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Polynomials, place and beam."""
        n = len(self._terms)
        return parameters[:n], parameters[n : n + 2], parameters[n + 2 :]

    def predict_pictures(self, parameters: torch.Tensor) -> torch.Tensor:
        """The model's pictures, each with the light and background that fit best."""
        polynomials, place, beam = self._split_parameters(parameters)
        path = torch.tensordot(polynomials, self._shapes, 1) * self._path_unit
        amplitude = torch.exp(torch.tensordot(beam, self._beam, 1))
        shares = self._model(path, place * _PARAMETER_UNIT, amplitude)
        return torch.stack(
            [
                _fit_light_and_background(share, light, weight)
                for share, light, weight in zip(shares, self._light, self._weight, strict=True)
            ]
        )

    def misfit(self, parameters: torch.Tensor) -> torch.Tensor:
        return ((self.predict_pictures(parameters) - self._light) ** 2 * self._weight).sum()

    def cost(self, parameters: torch.Tensor) -> float:
        with torch.no_grad():
            return float(self.misfit(parameters))

    def chi2(self, parameters: torch.Tensor) -> float:
        """Mean squared misfit in standard deviations, less what was fitted."""
        used = int((self._weight > 0).sum())
        return self.cost(parameters) / max(used - len(parameters) - 2 * len(self._light), 1)

    def minimise(self, start: torch.Tensor, progress: Progress) -> torch.Tensor:
        parameters = start.clone().requires_grad_(True)
        scale = max(self.cost(start), 1.0)
        optimiser = torch.optim.LBFGS(
            [parameters], max_iter=_STEPS, history_size=20, line_search_fn="strong_wolfe"
        )
        calls = 0

        def closure() -> torch.Tensor:
            nonlocal calls
            calls += 1
            progress.report(min(calls / (1.25 * _STEPS), 1.0), "wavefront")
            optimiser.zero_grad()
            loss = self.misfit(parameters) / scale
            loss.backward()  # type: ignore[no-untyped-call]
            return loss

        optimiser.step(closure)  # type: ignore[no-untyped-call]
        return parameters.detach()

    def build_fit(self, parameters: torch.Tensor) -> WavefrontFit:
        with torch.no_grad():
            seen = self.predict_pictures(parameters)
            columns = []
            for k in range(len(parameters)):
                nudge = torch.zeros_like(parameters)
                nudge[k] = _DIFFERENCE_STEP
                change = self.predict_pictures(parameters + nudge) - self.predict_pictures(
                    parameters - nudge
                )
                columns.append((change / (2 * _DIFFERENCE_STEP) * self._weight.sqrt()).ravel())
        jacobian = torch.stack(columns, dim=1)
        chi2 = self.chi2(parameters)
        # Where the model is wrong, neighbouring pixels say the same.
        doubt = max(chi2, 1.0) * _correlation_area((seen - self._light) * self._weight.sqrt())
        covariance = torch.linalg.pinv(jacobian.T @ jacobian, hermitian=True) * doubt
        n = len(self._terms)
        polynomials = covariance[:n, :n].numpy() * self._path_unit**2
        coefficients = parameters[:n].numpy() * self._path_unit
        place = self._split_parameters(parameters)[1] * _PARAMETER_UNIT
        rms, sigma = self._rms_over_pupil(coefficients, polynomials)
        usable = self._weight > 0
        away = float(((seen - self._light)[usable] ** 2).sum().sqrt())
        return WavefrontFit(
            self._terms,
            coefficients,
            polynomials,
            self._model.radius,
            rms,
            sigma,
            (float(place[0]), float(place[1])),
            away / float(self._light[usable].norm()),
            chi2,
        )

    def _rms_over_pupil(self, coefficients: Array, covariance: Array) -> tuple[float, float]:
        """Root mean square of the path over the open pupil, less mean and tilt, and its sigma."""
        lit = self._model.light_on_panel.numpy()
        weight = (lit / lit.sum()).ravel()
        y, x = self._model.plane.mesh()
        flat = torch.stack([torch.ones(lit.shape), y.expand(lit.shape), x.expand(lit.shape)])
        basis = flat.reshape(3, -1).T.numpy() * np.sqrt(weight)[:, None]
        shapes = self._shapes.reshape(len(self._terms), -1).T.numpy() * np.sqrt(weight)[:, None]
        shapes = shapes - basis @ np.linalg.lstsq(basis, shapes, rcond=None)[0]
        spread = float(np.einsum("pi,ij,pj", shapes, covariance, shapes))
        return float(np.linalg.norm(shapes @ coefficients)), math.sqrt(max(spread, 0.0))


def _correlation_area(misfit: torch.Tensor) -> float:
    """How many pixels (pictures, rows, columns) say one thing: the area over which misfits are
    alike, if they fade exponentially."""
    area = 1.0
    power = float((misfit**2).sum())
    for axis in (-2, -1):
        n = misfit.shape[axis]
        neighbours = misfit.narrow(axis, 0, n - 1) * misfit.narrow(axis, 1, n - 1)
        alike = min(max(float(neighbours.sum()) / max(power, 1e-300), 0.0), _MAX_CORRELATION)
        area *= (1 + alike) / (1 - alike)
    return area


def _fit_light_and_background(
    share: torch.Tensor, light: torch.Tensor, weight: torch.Tensor
) -> torch.Tensor:
    """A picture's share times the light, plus the background, that fit best."""
    with torch.no_grad():
        design = torch.stack([share.ravel(), torch.ones(share.numel(), dtype=share.dtype)], dim=1)
        root = weight.ravel().sqrt()
        solution = torch.linalg.lstsq(design * root[:, None], (light.ravel() * root)[:, None])
        amount, background = solution.solution[:, 0]
    return amount * share + background
