"""Wavefront and focus from pictures of the star with known phases on the panel.

One picture of a point can't distinguish a wavefront from its mirror image. Several pictures that
differ by a known defocus on the panel can (phase diversity: Gonsalves 1982, doi
10.1117/12.7972989).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from optics.camera import Panel
from optics.measuring.star_model import StarModel
from optics.plane import Plane
from optics.progress import Progress
from optics.zernike import zernike

Array = NDArray[np.float64]
Term = tuple[int, int]

# Zernike polynomials that are fitted: those of the second to the fourth degree
TERMS: tuple[Term, ...] = tuple((n, m) for n in range(2, 5) for m in range(-n, n + 1, 2))

_DEFOCUS = (2, 0)

_START_DEFOCUS = np.linspace(-1.0, 1.0, 9)  # waves, root mean square: twice the starting values


# Starting values that are fitted, and iterations of a fit, at most; chosen
_STARTS_FOLLOWED, _STEPS = 2, 60
_GOOD_CHI2 = 1.5  # mean squared misfit, in deviations, below which no other start is tried; chosen
# Waves, root mean square, and pixels, that are one unit of the optimiser; chosen
_PARAMETER_UNIT = 0.05
_BEAM_UNIT = 0.2  # the same of the log amplitude at the disc's edge; chosen
_DIFFERENCE_STEP = 0.02  # of derivatives, in these units; chosen
_MAX_CORRELATION = 0.95  # of neighbouring pixels' misfits; chosen
_MODEL_ERROR = 0.005  # besides the noise, as a share of a picture's peak; chosen


@dataclass(frozen=True, eq=False)
class WavefrontFit:
    """A fitted wavefront: optical path besides the pattern, as Zernike polynomials.

    terms: (n, m) of the polynomials.
    coefficients: metres, root mean square over the disc around the pupil.
    covariance: of the coefficients, m².
    radius: that of the disc, metres on the panel.
    rms: root mean square of the path over the open pupil, without mean and tilt, metres.
    sigma: standard deviation of `rms`.
    offset: (y, x) pixels between the star's geometric image and the registration's centre.
    residual: relative L2 difference of pictures and model.
    chi2: mean squared residual in standard deviations, per degree of freedom.
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
        """The focus error in dioptres, and its standard deviation.

        A star outside of the plane in focus has this vergence error.
        """
        k = self.terms.index(_DEFOCUS)
        scale = 4 * math.sqrt(3) / self.radius**2
        sigma = math.sqrt(float(self.covariance[k, k]))
        return scale * float(self.coefficients[k]), scale * sigma

    def path(self, panel: Panel) -> torch.Tensor:
        """Compute the optical path at the panel's pixels in metres, (rows, columns), float64."""
        return zernike_path(self.terms, self.coefficients, self.radius, panel.plane)


def zernike_path(
    terms: Sequence[Term], coefficients: Sequence[float] | Array, radius: float, plane: Plane
) -> torch.Tensor:
    """Sum Zernike terms to a wavefront on a plane, metres, (rows, columns)."""
    y, x = plane.mesh()
    total = torch.zeros(plane.shape, dtype=torch.float64)
    for (n, m), strength in zip(terms, coefficients, strict=True):
        total = total + float(strength) * zernike(n, m, y / radius, x / radius)
    return total


@dataclass(frozen=True, eq=False)
class StarPictures:
    """Pictures of the star, (pictures, rows, columns), less their dark frames.

    variance: that of the light.
    usable: pixels that are neither clipped nor hot.
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
    model: StarModel, pictures: StarPictures, *, progress: Progress | None = None
) -> WavefrontFit:
    """Fit Zernike polynomials to pictures of the star.

    model: the model of the star through panel and lens, with the displayed patterns.

    The fit is by least squares in units of the noise, with gradients through the PSF (L-BFGS). It
    begins at the best of nine values of defocus. The light and the background of each picture are
    fitted, too. Raises ValueError for fewer than two pictures.
    """
    if len(pictures.light) < 2 or len(pictures.light) != model.pattern_count:
        raise ValueError(
            f"{len(pictures.light)} pictures of {model.pattern_count} patterns; a wavefront needs "
            "one of each, and two at least"
        )
    progress = progress or Progress()
    task = _WavefrontProblem(model, pictures)
    starts = sorted(
        (task.initial_parameters(defocus * 0.5) for defocus in _START_DEFOCUS), key=task.cost
    )
    found = []
    parts = _STARTS_FOLLOWED + 1
    for number, start in enumerate(starts[:_STARTS_FOLLOWED]):
        part = progress.part(number / parts, (number + 1) / parts)
        found.append(task.minimise(start, part))
        if task.chi2(found[-1]) < _GOOD_CHI2:
            break
    best = min(found, key=task.cost)
    progress.report(_STARTS_FOLLOWED / parts, "wavefront: uncertainty")
    return task.build_fit(best)


class _WavefrontProblem:
    """The least-squares problem of the fit, and its parameters.

    They are the polynomials' coefficients, in `_PARAMETER_UNIT` waves; the star's position (y, x),
    in as many pixels; and three numbers of the log amplitude on the panel, in `_BEAM_UNIT`: its
    slopes along y and x, and its quadratic fall towards the edge, as for a Gaussian beam.
    """

    def __init__(self, model: StarModel, pictures: StarPictures) -> None:
        self._model = model
        self._light = torch.from_numpy(pictures.light)
        peak = pictures.light.max(axis=(1, 2), keepdims=True)
        variance = pictures.variance + (_MODEL_ERROR * peak) ** 2
        self._weight = torch.from_numpy(np.where(pictures.usable, 1 / variance, 0.0))
        y, x = (axis / model.radius for axis in model.plane.mesh())
        shape = model.plane.shape
        self._shapes = torch.stack([zernike(n, m, y, x).expand(shape) for n, m in TERMS])
        self._path_unit = _PARAMETER_UNIT * model.wavelength
        y, x = y.expand(shape), x.expand(shape)
        self._beam = torch.stack([y, x, y**2 + x**2]) * _BEAM_UNIT

    def initial_parameters(self, waves: float) -> torch.Tensor:
        start = torch.zeros(len(TERMS) + 2 + len(self._beam), dtype=torch.float64)
        start[TERMS.index(_DEFOCUS)] = waves / _PARAMETER_UNIT
        return start

    def predict_pictures(self, parameters: torch.Tensor) -> torch.Tensor:
        """Predict the pictures, each with fitted light and background."""
        n = len(TERMS)
        path = torch.tensordot(parameters[:n], self._shapes, 1) * self._path_unit
        amplitude = torch.exp(torch.tensordot(parameters[n + 2 :], self._beam, 1))
        shares = self._model(path, parameters[n : n + 2] * _PARAMETER_UNIT, amplitude)
        every = zip(shares, self._light, self._weight, strict=True)
        return torch.stack([_fit_light_and_background(*one) for one in every])

    def misfit(self, parameters: torch.Tensor) -> torch.Tensor:
        return ((self.predict_pictures(parameters) - self._light) ** 2 * self._weight).sum()

    def cost(self, parameters: torch.Tensor) -> float:
        with torch.no_grad():
            return float(self.misfit(parameters))

    def chi2(self, parameters: torch.Tensor) -> float:
        """Compute the squared misfit per degree of freedom."""
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
        """Build the wavefront and its uncertainty from the best parameters."""
        root = self._weight.sqrt()
        with torch.no_grad():
            seen = self.predict_pictures(parameters)
            columns = []
            for nudge in torch.eye(len(parameters), dtype=torch.float64) * _DIFFERENCE_STEP:
                more, less = (self.predict_pictures(parameters + s * nudge) for s in (1, -1))
                columns.append(((more - less) / (2 * _DIFFERENCE_STEP) * root).ravel())
        jacobian = torch.stack(columns, dim=1)
        chi2 = self.chi2(parameters)
        # Model errors are correlated between neighbouring pixels, which counts as fewer pixels.
        doubt = max(chi2, 1.0) * _correlation_area((seen - self._light) * root)
        n = len(TERMS)
        covariance = torch.linalg.pinv(jacobian.T @ jacobian, hermitian=True) * doubt
        covariance = covariance[:n, :n].numpy() * self._path_unit**2
        coefficients = parameters[:n].numpy() * self._path_unit
        y, x = (parameters[n : n + 2] * _PARAMETER_UNIT).tolist()
        rms, sigma = self._rms_over_pupil(coefficients, covariance)
        usable = self._weight > 0
        away = float(((seen - self._light)[usable] ** 2).sum().sqrt())
        residual = away / float(self._light[usable].norm())
        return WavefrontFit(
            TERMS, coefficients, covariance, self._model.radius, rms, sigma, (y, x),
            residual, chi2,
        )  # fmt: skip

    def _rms_over_pupil(self, coefficients: Array, covariance: Array) -> tuple[float, float]:
        """Compute the path's rms over the open pupil without mean and tilt, and its sigma."""
        lit = self._model.light_on_panel.numpy()
        weight = (lit / lit.sum()).ravel()
        y, x = self._model.plane.mesh()
        flat = torch.stack([torch.ones(lit.shape), y.expand(lit.shape), x.expand(lit.shape)])
        basis = flat.reshape(3, -1).T.numpy() * np.sqrt(weight)[:, None]
        shapes = self._shapes.reshape(len(TERMS), -1).T.numpy() * np.sqrt(weight)[:, None]
        shapes = shapes - basis @ np.linalg.lstsq(basis, shapes, rcond=None)[0]
        spread = float(np.einsum("pi,ij,pj", shapes, covariance, shapes))
        return float(np.linalg.norm(shapes @ coefficients)), math.sqrt(max(spread, 0.0))


def _correlation_area(misfit: torch.Tensor) -> float:
    """Estimate the area in pixels over which misfits, (pictures, rows, columns), are correlated.

    The correlation is assumed to fall exponentially with distance.
    """
    area = 1.0
    power = float((misfit**2).sum())
    for axis in (-2, -1):
        n = misfit.shape[axis]
        neighbours = misfit.narrow(axis, 0, n - 1) * misfit.narrow(axis, 1, n - 1)
        alike = max(float(neighbours.sum()) / max(power, 1e-300), 0.0)
        alike = min(alike, _MAX_CORRELATION)
        area *= (1 + alike) / (1 - alike)
    return area


def _fit_light_and_background(
    share: torch.Tensor, light: torch.Tensor, weight: torch.Tensor
) -> torch.Tensor:
    """Return share x light + background, with light and background fitted to a picture."""
    with torch.no_grad():
        design = torch.stack([share.ravel(), torch.ones(share.numel(), dtype=share.dtype)], dim=1)
        root = weight.ravel().sqrt()
        solution = torch.linalg.lstsq(design * root[:, None], (light.ravel() * root)[:, None])
        amount, background = solution.solution[:, 0]
    return amount * share + background
