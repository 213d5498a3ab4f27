"""Compute PSFs of one pattern together: of colours, distances, wavelengths and fields.

The plan of a single one is kept for the next one like it.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import fields, is_dataclass, replace
from functools import partial
from typing import Any

import torch
from torch.utils.checkpoint import checkpoint

from optics.accuracy import Account, Budget, Result
from optics.caching import ByteCache
from optics.camera import Camera, Lens
from optics.camera.pupil import Scalar
from optics.plane import Plane
from optics.psf.chain_grid import GridEngine
from optics.psf.dim_windows import normalise_amplitude
from optics.psf.operator import PSFOperator
from optics.psf.symmetry import expand_phase, symmetric_shape
from optics.psf.to_sensor import panel_spectrum
from optics.threads import in_full_precision
from optics.validation import accepts_numpy


def psf(
    optics: Camera | Lens,
    phase: torch.Tensor | None = None,
    *,
    distance: Scalar,
    wavelength: Scalar,
    pixels: Plane,
    field: tuple[Scalar, Scalar] = (0.0, 0.0),
    sphere: bool = False,
    tol: float = 1e-3,
) -> Result[torch.Tensor]:
    """Compute the PSF on sensor pixels, with its account.

    It plans a PSFOperator and calls it once. See PSFOperator for the model. The plans of the last
    calls are kept for the same question, as long as none of its lengths is a tensor.

    Parameters
    ----------
    optics : Camera or Lens
        What forms the image.
    phase : torch.Tensor or numpy.ndarray, optional
        Radians, (..., rows, columns) of the panel. Zero by default. A lens alone takes none,
        because only a PSFOperator tells on which points.
    distance : float or 0-d torch.Tensor
        Metres from the object to the panel, or to a lens that stands alone; ``math.inf`` is
        allowed.
    wavelength : float or 0-d torch.Tensor
        Metres.
    pixels : Plane
        The sensor pixels whose light is computed.
    field : tuple of float or 0-d torch.Tensor, optional
        Metres (y, x) on the sensor from the axis to the point's geometric image.
    sphere : bool, optional
        Whether the wave over the panel is the exact spherical wave instead of its parabola.
    tol : float, optional
        Largest relative L2 error from sampling and arithmetic; 1e-3 by default.

    Returns
    -------
    Result of torch.Tensor
        The PSF, ``(..., *pixels.shape)``, as shares of the light leaving the pupil, and its
        account, with the processor time spent.

    Raises
    ------
    ToleranceError
        If `tol` can't be kept.
    ValueError
        For invalid arguments.
    """
    if phase is not None and not isinstance(optics, Camera):
        raise ValueError(
            "phase is given, and a lens alone has no panel; plan a PSFOperator, and give it the "
            "phase on its points"
        )
    started = time.process_time()
    plan = partial(
        PSFOperator,
        optics,
        distance,
        wavelength,
        pixels,
        field=field,
        sphere=sphere,
        tol=tol,
        calls=1,
    )
    operator, is_kept = _kept_plan(plan, (optics, distance, wavelength, pixels, field, sphere, tol))
    value = operator(phase)
    account = operator.account
    if is_kept:
        account = replace(account, planning_predicted=0.0)
    return Result(value, account.with_cpu_spent(time.process_time() - started))


# Plans for psf(). Every thread has its own, since a call changes an operator's account.
_PLANS = ByteCache(256 << 20)


def _kept_plan(plan: Callable[[], PSFOperator], asked: tuple[Any, ...]) -> tuple[PSFOperator, bool]:
    """Return a plan, made or kept from an earlier call, and whether it was kept.

    A question that holds tensors isn't kept, since they may change, nor one that is refused.

    plan: makes it.
    asked: optics, distance, wavelength, pixels and settings.
    """
    optics, *rest = asked
    if isinstance(optics, Camera):
        panel = optics.panel
        optics = (optics.lens, optics.separation, panel.plane, panel.fill_factor, panel.unmodulated)
    question = (threading.get_ident(), optics, *rest)
    if not _is_fixed(question):
        return plan(), False
    made: list[PSFOperator] = []

    def make() -> PSFOperator:
        made.append(plan())
        return made[0]

    return _PLANS.get(question, make), not made


def _is_fixed(value: Any) -> bool:
    """Tell whether a question holds only numbers, names and tuples, which are fixed."""
    if isinstance(value, tuple):
        return all(map(_is_fixed, value))
    if is_dataclass(value):
        return all(_is_fixed(getattr(value, one.name)) for one in fields(value))
    return value is None or isinstance(value, (int, float, str))


class PolychromaticPSF:
    """Computes the incoherent PSF of light of several wavelengths, a weighted sum of intensities.

    Call it with phases (wavelengths, ..., rows, columns), because a panel's phase differs with the
    wavelength, or with nothing. Each wavelength keeps the tolerance of its PSFOperator, and so does
    their sum.

    Parameters
    ----------
    optics : Camera or Lens
        What forms the image.
    distance : float or 0-d torch.Tensor
        Metres from the object to the panel, or to a lens that stands alone; ``math.inf`` is
        allowed.
    wavelengths : sequence of float
        Metres, at least one.
    weights : sequence of float
        One for each wavelength, not negative. They are normalised to a sum of one.
    pixels : Plane
        The sensor pixels whose light is computed.
    **settings : Any
        Keyword arguments of every PSFOperator.

    Attributes
    ----------
    weights : tuple of float
        The normalised weights.
    operators : tuple of PSFOperator
        One for each wavelength.

    Raises
    ------
    ValueError
        Unless there is one weight for each wavelength, all finite and not negative and one of
        them positive. It also raises what PSFOperator raises.
    """

    def __init__(
        self,
        optics: Camera | Lens,
        distance: Any,
        wavelengths: Sequence[float],
        weights: Sequence[float],
        pixels: Plane,
        **settings: Any,
    ) -> None:
        _require_spectrum(wavelengths, weights)
        total = math.fsum(weights)
        self.weights = tuple(weight / total for weight in weights)
        self.operators = tuple(
            PSFOperator(optics, distance, wavelength, pixels, **settings)
            for wavelength in wavelengths
        )

    @accepts_numpy
    def __call__(self, phases: torch.Tensor | None = None) -> torch.Tensor:
        """Compute the PSF of a phase for each wavelength, or of no phase.

        The phases are (wavelengths, ..., rows, columns), the PSF is (..., *pixels.shape).
        """
        if phases is not None and phases.shape[0] != len(self.operators):
            raise ValueError(
                f"phases are {tuple(phases.shape)}; give one for each of the "
                f"{len(self.operators)} wavelengths"
            )
        parts = (
            weight * operator(None if phases is None else phases[number])
            for number, (weight, operator) in enumerate(
                zip(self.weights, self.operators, strict=True)
            )
        )
        return sum(parts, torch.zeros(()))


def _require_spectrum(wavelengths: Sequence[float], weights: Sequence[float]) -> None:
    if not len(wavelengths) == len(weights) >= 1:
        raise ValueError(
            f"there are {len(wavelengths)} wavelengths and {len(weights)} weights; "
            "give one weight for each, and one wavelength at least"
        )
    if not all(0 <= weight < math.inf for weight in weights) or not sum(weights) > 0:
        raise ValueError("weights must be finite and not negative, and one of them positive")


class PSFStack:
    """Computes a camera's PSFs at every one of several distances, wavelengths and fields.

    The PSFs are planned and computed together. The spectrum of a pattern is computed once for all
    distances and fields of a band that are computed on grids: it is the same for all of them,
    except for where it is cut off. One PSF is computed after the other, so that the memory is that
    of one. With derivatives, fields at the sensor are kept as far as `budget` allows, and computed
    once more beyond that.

    Parameters
    ----------
    camera : Camera
        The camera.
    distances : sequence of float or 0-d torch.Tensor
        Metres from the objects to the panel, at least one.
    wavelengths : sequence of float or 0-d torch.Tensor
        Metres, one for each band, at least one.
    pixels : Plane
        The sensor pixels whose light is computed, as for PSFOperator.
    fields : sequence of tuple, optional
        Places (y, x) of the image on the sensor, metres from the axis. On the axis by default.
    budget : Budget, optional
        The memory allowed, and the machine's speed.
    **settings : Any
        Further keyword arguments of every PSFOperator, such as `tol`, which each PSF keeps.

    Attributes
    ----------
    operators : list of list of list of PSFOperator
        The operator of every PSF, as ``operators[distance][band][field]``.

    Raises
    ------
    ValueError
        If distances, wavelengths or fields are empty. It also raises what PSFOperator raises.
    """

    def __init__(
        self,
        camera: Camera,
        distances: Sequence[Any],
        wavelengths: Sequence[Any],
        pixels: Plane,
        *,
        fields: Sequence[tuple[Any, Any]] = ((0.0, 0.0),),
        budget: Budget | None = None,
        **settings: Any,
    ) -> None:
        given_all = {"distances": distances, "wavelengths": wavelengths, "fields": fields}
        for name, given in given_all.items():
            if not len(given):
                raise ValueError(f"{name} is empty; give one at least")
        self._budget = budget or Budget()
        self.pixels = pixels
        self._symmetry, self._panel_shape = settings.get("symmetry", "none"), camera.panel.shape
        self._pattern_shape = symmetric_shape(self._symmetry, self._panel_shape)
        plan = partial(PSFOperator, camera, pixels=pixels, budget=self._budget, **settings)
        self.operators = [
            [[plan(distance=z, wavelength=w, field=one) for one in fields] for w in wavelengths]
            for z in distances
        ]
        self._shared_spectra = [
            _SharedSpectrum(self._operators_of_band(band)) for band in range(len(wavelengths))
        ]

    def _operators_of_band(self, band: int) -> list[PSFOperator]:
        return [operator for row in self.operators for operator in row[band]]

    @property
    def accounts(self) -> list[Account]:
        """The accounts of all PSFs, in the order of the stack: by distance, band and field."""
        return [one.account for row in self.operators for band in row for one in band]

    @accepts_numpy
    @in_full_precision
    def __call__(
        self, phase: torch.Tensor | None = None, amplitude: torch.Tensor | None = None
    ) -> torch.Tensor:
        """Compute all PSFs of a pattern.

        Parameters
        ----------
        phase : torch.Tensor or numpy.ndarray, optional
            Radians, (rows, columns) of the panel for all wavelengths, or (bands, rows, columns). A
            symmetric pattern is given in short (see `PSFOperator`).
        amplitude : torch.Tensor or numpy.ndarray, optional
            Of one of the same shapes.

        Returns
        -------
        torch.Tensor or numpy.ndarray
            The PSFs, (distances, bands, fields, *pixels.shape), in the units of PSFOperator.
        """
        phases, amplitudes = self._per_band("phase", phase), self._per_band("amplitude", amplitude)
        found = [
            self._compute_band(band, *given)
            for band, given in enumerate(zip(phases, amplitudes, strict=True))
        ]
        shape = (len(self.operators), len(self.operators[0][0]), *self.pixels.shape)
        return torch.stack([torch.stack(one).reshape(shape) for one in found], dim=1)

    def _per_band(self, name: str, value: torch.Tensor | None) -> list[torch.Tensor | None]:
        """Return one phase or amplitude for each colour band.

        value: one for each band, or one for all.
        """
        bands, axes = len(self._shared_spectra), len(self._pattern_shape)
        if value is None or value.ndim == axes:
            return [value] * bands
        if value.ndim != axes + 1 or value.shape[0] != bands:
            raise ValueError(
                f"{name} is {tuple(value.shape)}; give {self._pattern_shape} for all bands, or one "
                f"for each of the {bands}"
            )
        return list(value)

    @in_full_precision
    def value_and_gradient(
        self, phase: torch.Tensor, loss: Callable[[torch.Tensor, int, int, int], torch.Tensor]
    ) -> tuple[float, torch.Tensor]:
        """Compute a sum of losses, one for each PSF, and its gradient, with one PSF in memory.

        Parameters
        ----------
        phase : torch.Tensor
            As in a call.
        loss : callable
            Takes a PSF, (rows, columns), and the numbers of its distance, band and field; returns
            a 0-d tensor.

        Returns
        -------
        tuple of float and torch.Tensor
            The sum, and its gradient in the phase, of the phase's shape.
        """
        leaf, total = phase.detach().clone().requires_grad_(), 0.0
        for distance, bands in enumerate(self.operators):
            for band, (in_band, part) in enumerate(
                zip(bands, self._per_band("phase", leaf), strict=True)
            ):
                for field, operator in enumerate(in_band):
                    value = loss(operator.evaluate(part, None), distance, band, field)
                    value.backward()  # type: ignore[no-untyped-call]
                    total += float(value.detach())
        assert leaf.grad is not None
        return total, leaf.grad

    def _compute_band(
        self, band: int, phase: torch.Tensor | None, amplitude: torch.Tensor | None
    ) -> list[torch.Tensor]:
        """Compute the light of one colour band, for all distances and fields."""
        operators, shared = self._operators_of_band(band), self._shared_spectra[band]
        # A symmetric pattern with an amplitude is computed by operators with other grids.
        can_share = shared.is_planned and (self._symmetry == "none" or amplitude is None)
        spectrum = straight = None
        if can_share:
            spectrum = shared.spectrum(self._expand(phase), amplitude)
            if phase is not None and any(one.needs_unmodulated_psf(amplitude) for one in operators):
                straight = shared.spectrum(None, amplitude)
        again = self._needs_recomputation(spectrum)
        found = []
        for one in operators:
            serves = can_share and shared.can_serve(one)
            known = (spectrum, straight) if serves else (None, None)
            if again and known[0] is not None:
                light = checkpoint(one.evaluate, phase, amplitude, *known, use_reentrant=False)
            else:
                light = one.evaluate(phase, amplitude, *known)
            found.append(light)
        return found

    def _expand(self, phase: torch.Tensor | None) -> torch.Tensor | None:
        """Expand the phase of a symmetric pattern to all pixels of the panel."""
        return None if phase is None else expand_phase(self._symmetry, phase, self._panel_shape)

    def _needs_recomputation(self, spectrum: torch.Tensor | None) -> bool:
        """Tell whether derivatives should compute fields at the sensor again.

        That saves the memory that would hold them.
        """
        if spectrum is None or not (spectrum.requires_grad and torch.is_grad_enabled()):
            return False
        kept = sum(
            2 * spectrum.element_size() * one.engine.sample_count
            for band in range(len(self._shared_spectra))
            for one in self._operators_of_band(band)
        )
        # Fields at the sensor that derivatives need may take a quarter of the allowed memory.
        return kept > 0.25 * self._budget.memory


class _SharedSpectrum:
    """Computes one spectrum of the panel for all operators of a band that can use it."""

    def __init__(self, operators: Sequence[PSFOperator]) -> None:
        engines = [one.engine for one in operators]
        self._engines = [
            one for one in engines if isinstance(one, GridEngine) and one.can_share_spectrum
        ]
        if len(self._engines) < 2 or len({one.propagator.dtype for one in self._engines}) > 1:
            self._engines = []
            return
        lengths, held = [], []
        for axis in (0, 1):
            axes = [one.propagator.axes[axis] for one in self._engines]
            lengths.append(max(one.fft_length for one in axes))
            held.append(
                (
                    min(one.band.outer_limits[0] for one in axes),
                    max(one.band.outer_limits[1] for one in axes),
                )
            )
        for one in self._engines:
            one.use_shared_spectrum(lengths, held)
            one.prepare()

    @property
    def is_planned(self) -> bool:
        """Whether there are operators that can use one spectrum of the panel."""
        return bool(self._engines)

    def can_serve(self, operator: PSFOperator) -> bool:
        return any(operator.engine is one for one in self._engines)

    def spectrum(self, phase: torch.Tensor | None, amplitude: torch.Tensor | None) -> torch.Tensor:
        """Compute the spectrum of a pattern that is given on all pixels."""
        first = self._engines[0]
        return panel_spectrum(
            first.propagator, first.panel_field(phase, normalise_amplitude(amplitude, 2)[0])
        )
