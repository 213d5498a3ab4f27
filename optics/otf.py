"""Compute optical transfer functions: of a PSF, of a round lens, and of a slit over all defocus.

The transfer function H(f) is the Fourier transform, with exp(-2 pi i f u), of a PSF whose light
sums to 1. In this package a pupil P makes a PSF by exp(-2 pi i u p / (wavelength z)). H is then
the autocorrelation of the pupil (Goodman, Introduction to Fourier Optics, chapter 6),

    H(f) = integral of P(p - s / 2) P*(p + s / 2) dp / integral of |P|² dp,  s = wavelength z f.
"""

from __future__ import annotations

import functools
import math
from abc import ABC, abstractmethod
from collections.abc import Callable

import torch
from torch.utils.checkpoint import checkpoint

from optics.accuracy import FLOAT64_ARITHMETIC, ToleranceError
from optics.camera import Lens
from optics.camera.pupil import defocus_curvature, require_valid_source
from optics.formation import spectrum_of_samples
from optics.gauss_legendre import gauss_legendre
from optics.plane import Plane
from optics.validation import accepts_numpy, as_floating_point, require_finite, rounded_up

PupilPhase = Callable[[torch.Tensor, torch.Tensor], torch.Tensor]  # radians at (y, x) in metres
SlitPhase = Callable[[torch.Tensor], torch.Tensor]  # radians at positions from -1 to 1


_PROBES = 32  # values on which a node count is tested; chosen

_COARSE_NODES = 24  # of the first evaluation of a phase, which tells how steep it is; chosen

# Most nodes of one Gauss-Legendre rule. Rules of thousands of nodes take longer to compute than to
# use, so that longer ones are composed of these.
_RULE_NODES = 128

# Nodes, of all values together, that are in memory at a time. They fit a processor's cache, and
# torch uses one thread for them (see optics.threads).
_CHUNK_NODES = 1 << 15


@accepts_numpy
def transfer_function(psf: torch.Tensor, plane: Plane) -> torch.Tensor:
    """Compute the OTF of PSFs (..., rows, columns), complex, 1 at zero frequency.

    The PSF is on the samples of `plane`, and phases refer to its origin at n // 2. The result has
    the rfft2 layout of optics.formation.rfft2_frequencies(plane). Light that falls outside the
    picture is missing from it. Raises ValueError for a PSF of another shape, or without light.
    """
    if psf.shape[-2:] != plane.shape:
        raise ValueError(f"psf is {tuple(psf.shape)}; its plane has {plane.shape} samples")
    if psf.is_complex():
        raise ValueError(f"psf is {psf.dtype}; give the light, the field's squared modulus")
    require_finite("psf", psf)
    spectrum = spectrum_of_samples(as_floating_point(psf))
    total = spectrum[..., :1, :1].real
    if not bool((total > 0).all()):
        least = float(total.detach().min())
        raise ValueError(f"psf sums to {least:g}; it needs light, more than 0")
    return spectrum / total


@accepts_numpy
def modulation_transfer(transfer: torch.Tensor) -> torch.Tensor:
    """Compute the MTF, the modulus of a transfer function, real, of any shape.

    Its gradient is zero where the transfer function is zero, and finite everywhere.
    """
    # sqrt(re² + im²) would have the gradient 0 / 0 at zero, and would underflow near it.
    return transfer.abs()


@accepts_numpy
def lens_transfer_function(
    lens: Lens,
    distance: float,
    wavelength: float,
    fy: torch.Tensor,
    fx: torch.Tensor,
    *,
    phase: PupilPhase | None = None,
    tol: float = 1e-6,
) -> torch.Tensor:
    """Compute the OTF of a lens with a clear round stop, complex128, at frequencies (fy, fx).

    distance: metres to the object, math.inf allowed. fy, fx: cycles per metre on the sensor; they
    broadcast, as those of optics.formation.rfft2_frequencies() do. phase: aberrations over the
    pupil; the OTF is differentiable in the tensors that they are computed from. tol: the largest
    absolute error of a value, measured on some of the values by doubling the nodes. The gradient
    uses these nodes. They are too few for the gradient in a fine phase that is still zero; begin
    such an optimisation with small numbers.

    The overlap of two stops (section 6.3 of Goodman) is integrated by Gauss-Legendre nodes. The
    OTF is zero from the cut-off frequency on. The model is paraxial and scalar. Raises
    ToleranceError with the smallest possible tolerance where the phase is too steep or too rough,
    and ValueError for an object, wavelength or lens that the model doesn't cover.
    """
    require_valid_source(distance, wavelength)
    _require_tolerance(tol)
    fy, fx = _broadcast_pair(fy=fy, fx=fx)
    if not (lens.has_clear_stop and lens.has_quadratic_phase):
        raise ValueError(
            f"lens is {lens}; the overlap is that of a thin lens with a clear round stop: give "
            "aberrations as phase, or take the transfer_function() of its PSF"
        )
    radius = float(lens.stop_diameter) / 2
    defocus = float(defocus_curvature(lens, distance, wavelength)) * radius**2
    cutoff = 2 * radius / (wavelength * float(lens.image_distance))
    vy, vx = fy / cutoff, fx / cutoff
    v = torch.hypot(vy, vx)
    inside = v < 1
    if phase is None:
        return _scatter_to_mask(_DefocusedOverlap(defocus).integrate(tol, v[inside]), inside)
    overlap = _AberratedOverlap(radius, defocus, phase)
    return _scatter_to_mask(overlap.integrate(tol, v[inside], vy[inside], vx[inside]), inside)


@accepts_numpy
def ambiguity_function(
    phase: SlitPhase | None, shift: torch.Tensor, frequency: torch.Tensor, *, tol: float = 1e-6
) -> torch.Tensor:
    """Compute the ambiguity function of a slit pupil P = exp(i phase(x)), 1 at the origin.

        A(u, v) = 1/2 integral of P(x + u / 2) P*(x - u / 2) exp(2 pi i x v) dx,

    where P is zero beyond |x| = 1 (thesis Eq. 2.40; Brenner, Lohmann and Ojeda-Castañeda,
    Opt. Commun. 44, 323, 1983). A is complex128. shift: u, in half-widths of the slit; A is zero
    from |u| = 2 on. frequency: v, in cycles per half-width. They broadcast: a row and a column
    give the polar display, in which defocused_transfer_function() is a line through the origin.

    tol: the largest error of a value. The result is differentiable in the tensors that the phase
    is computed from. Raises ToleranceError with the smallest possible tolerance, and ValueError
    for numbers that aren't finite.
    """
    _require_tolerance(tol)
    u, v = _broadcast_pair(shift=shift, frequency=frequency)
    inside = u.abs() < 2
    return _scatter_to_mask(_SlitAmbiguity(phase).integrate(tol, u[inside], v[inside]), inside)


@accepts_numpy
def defocused_transfer_function(
    phase: SlitPhase | None, shift: torch.Tensor, waves: torch.Tensor, *, tol: float = 1e-6
) -> torch.Tensor:
    """Compute the OTF of a slit pupil at any defocus, complex128, 1 at zero frequency.

        H(u, W20) = A(u, 2 u W20 / wavelength), thesis Eq. 2.40,

    where A is the slit's ambiguity_function() and exp(2 pi i W20 x² / wavelength) is the defocus.
    shift: u, which is wavelength z times the frequency on the sensor, in half-widths of the slit;
    the cut-off is 2. waves: W20 / wavelength. They broadcast.

    As in Dowski and Cathey, 10.1364/AO.34.001859, the pupil is mirrored: for a phase that isn't
    even, H is the conjugate of the Fourier transform of the PSF. tol and exceptions are those of
    ambiguity_function().
    """
    shift, waves = _broadcast_pair(shift=shift, waves=waves)
    return ambiguity_function(phase, shift, 2 * shift * waves, tol=tol)


class _Integral(ABC):
    """Base class of integrals: sums of amplitude x exp(i turn) over Gauss-Legendre nodes.

    The parameters are vectors of one length, and each of their entries gives one value. At most
    `max_nodes` nodes are used along each of the `dimensions`.
    """

    dimensions = 1
    max_nodes = 1 << 14

    @abstractmethod
    def __call__(
        self, nodes: int, *parameters: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor | None]:
        """Return the amplitude, with the rule's weights, and the turn in radians or None.

        Both are (values, nodes, ...).
        """

    def half_phase_range(self, *parameters: torch.Tensor) -> torch.Tensor:
        """Estimate half the range of the integrand's phase for each value, in radians."""
        _, turn = self(_COARSE_NODES, *parameters)
        assert turn is not None
        turn = turn.flatten(1)
        return (turn.amax(1) - turn.amin(1)) / 2

    def integrate(self, tol: float, *parameters: torch.Tensor) -> torch.Tensor:
        """Compute the integral for each entry, with as many nodes as `tol` needs."""
        if parameters[0].numel() == 0:
            return parameters[0].to(torch.complex128)
        with torch.no_grad():
            nodes = self._find_node_count(tol, parameters)
        return self._values(nodes, parameters)

    def _find_node_count(self, tol: float, parameters: tuple[torch.Tensor, ...]) -> int:
        """Find a node count whose doubling changes no probe by more than half of `tol`.

        The search begins with half a node per radian and a few more. The probes range from the
        smoothest integrand to the steepest.
        """
        steepness = self._map_in_chunks(self.half_phase_range, _COARSE_NODES, parameters)
        count = steepness.numel()
        rank = torch.linspace(0, count - 1, min(_PROBES, count), dtype=torch.float64)
        chosen = torch.argsort(steepness)[rank.round().long().to(steepness.device)]
        probes = tuple(p[chosen] for p in parameters)
        turn = float(steepness.max())
        spare = 2.5 * turn ** (1 / 3) - 1.5 * math.log10(min(tol, 1.0)) + 8
        nodes = min(math.ceil(turn / 2 + spare), self.max_nodes)
        while True:
            value, finer = (self._values(n, probes) for n in (nodes, 2 * nodes))
            # Only some values are probed, so the error is taken twice as large.
            error = 2 * float((finer - value).abs().max())
            if error <= tol:
                return nodes
            if nodes == self.max_nodes:
                raise ToleranceError(
                    f"tol {tol:g} can't be kept by {self.max_nodes} nodes a side, for a phase that "
                    f"turns by {2 * turn:.3g} rad; ask for tol {rounded_up(error)} or more, or "
                    "for a phase that is less steep or smoother"
                )
            nodes = min(math.ceil(1.25 * nodes), self.max_nodes)

    def _values(self, nodes: int, parameters: tuple[torch.Tensor, ...]) -> torch.Tensor:
        """Sum the integrand over a number of nodes, one value for each entry."""

        def values(*portion: torch.Tensor) -> torch.Tensor:
            amplitude, turn = self(nodes, *portion)
            if turn is None:
                return amplitude.sum(1).to(torch.complex128)
            # This is four times faster than torch.polar.
            real, imaginary = amplitude * torch.cos(turn), amplitude * torch.sin(turn)
            return torch.complex(real.flatten(1).sum(1), imaginary.flatten(1).sum(1))

        _, turn = self(1, *(p[:1] for p in parameters))
        if turn is None or not turn.requires_grad:
            return self._map_in_chunks(values, nodes, parameters)
        # The gradient computes the sums again, so that the nodes needn't stay in memory.
        again = functools.partial(checkpoint, values, use_reentrant=False)
        return self._map_in_chunks(again, nodes, parameters)

    def _map_in_chunks(
        self,
        function: Callable[..., torch.Tensor],
        nodes: int,
        parameters: tuple[torch.Tensor, ...],
    ) -> torch.Tensor:
        """Apply a function to the parameters in chunks, to bound the memory."""
        size = max(1, _CHUNK_NODES // nodes**self.dimensions)
        portions = zip(*(torch.split(p, size) for p in parameters), strict=True)
        return torch.cat([function(*portion) for portion in portions])


class _DefocusedOverlap(_Integral):
    """Integrate over the overlap of two defocused stops of radius 1 at a distance 2 v, 0 <= v < 1.

    defocus: radians at the edge of the stop. The integral along the shift is a sinc (Hopkins,
    Proc. R. Soc. A 231, 91, 1955).
    """

    def __init__(self, defocus: float) -> None:
        self._defocus = defocus

    def __call__(self, nodes: int, *parameters: torch.Tensor) -> tuple[torch.Tensor, None]:
        (v,) = parameters
        _, reach, weight = _overlap_nodes(v, nodes)
        turn = _defocus_phase_difference(self._defocus, v[:, None], reach)
        return 2 * weight * reach * torch.sinc(turn / math.pi), None

    def half_phase_range(self, *parameters: torch.Tensor) -> torch.Tensor:
        (v,) = parameters
        return _defocus_phase_difference(self._defocus, v, 1 - v).abs()


class _AberratedOverlap(_Integral):
    """Integrate over the overlap of two stops of radius 1 with any phase, shifted by 2 (vy, vx).

    radius: metres, the unit of the positions in `phase`. defocus: radians at the edge of the
    stop, in addition to `phase`.
    """

    dimensions = 2
    max_nodes = 1 << 9

    def __init__(self, radius: float, defocus: float, phase: PupilPhase) -> None:
        self._radius, self._defocus, self._phase = radius, defocus, phase

    def __call__(self, nodes: int, *parameters: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        v, vy, vx = (p[:, None, None] for p in parameters)
        angle, reach, weight = (a[..., None] for a in _overlap_nodes(parameters[0], nodes))
        points, weights = _composite_rule(nodes, v.device)
        along, across = reach * points, torch.sin(angle)
        # Where the two stops coincide, the direction is undefined and the phases are the same.
        length = torch.where(v > 0, v, torch.ones_like(v))
        ey, ex = vy / length, vx / length

        def phase(along: torch.Tensor) -> torch.Tensor:
            y, x = along * ey - across * ex, along * ex + across * ey
            return _evaluate_phase(self._phase(self._radius * y, self._radius * x), y)

        defocus = _defocus_phase_difference(self._defocus, v, along)
        return weight * reach * weights, phase(along - v) - phase(along + v) + defocus


def _overlap_nodes(v: torch.Tensor, nodes: int) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Return angle, reach and weight of nodes in the overlap of two stops of radius 1, 2 v apart.

    sin(angle) is the position across the shift; along the shift the overlap reaches cos(angle) - v
    to either side. As a function of this angle the integrand has no square root, neither at the
    ends of the overlap nor where the stops coincide, so that the sums converge spectrally. The
    weights are those of an integral over a stop of area 1.
    """
    points, weights = _composite_rule(nodes, v.device)
    widest = torch.arccos(v)[:, None]
    angle = widest * points
    cosine = torch.cos(angle)
    return angle, cosine - v[:, None], weights * widest * cosine / math.pi


def _defocus_phase_difference(defocus: float, v: torch.Tensor, along: torch.Tensor) -> torch.Tensor:
    """Return the defocus difference of two pupils 2 v apart, `along` that shift, in radians."""
    return -4 * defocus * v * along


class _SlitAmbiguity(_Integral):
    """Integrate over the overlap of two slits from -1 to 1, shifted by u and tilted by v cycles.

    |u| is below 2.
    """

    def __init__(self, phase: SlitPhase | None) -> None:
        self._phase = phase

    def __call__(self, nodes: int, *parameters: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        u, v = (p[:, None] for p in parameters)
        points, weights = _composite_rule(nodes, u.device)
        reach = 1 - u.abs() / 2
        x = reach * points
        turn = 2 * math.pi * v * x
        if self._phase is not None:
            turn = turn + _evaluate_phase(self._phase(x + u / 2), x)
            turn = turn - _evaluate_phase(self._phase(x - u / 2), x)
        return reach * weights / 2, turn


def _composite_rule(nodes: int, device: torch.device) -> tuple[torch.Tensor, torch.Tensor]:
    """Return Gauss-Legendre nodes, at least `nodes` in equal parts of -1 to 1, and weights."""
    parts = math.ceil(nodes / _RULE_NODES)
    points, weights = (torch.tensor(one) for one in gauss_legendre(math.ceil(nodes / parts)))
    middle = (2 * torch.arange(parts, dtype=torch.float64) + 1) / parts - 1
    points = (middle[:, None] + points / parts).ravel()
    return points.to(device), (weights / parts).repeat(parts).to(device)


def _evaluate_phase(phase: torch.Tensor, at: torch.Tensor) -> torch.Tensor:
    """Return what a caller's phase function answered for the positions `at`, as float64."""
    phase = torch.as_tensor(phase, device=at.device)
    if phase.is_complex():
        raise ValueError(f"phase answers {phase.dtype}; it must answer radians, real numbers")
    try:
        phase = phase.to(torch.float64).broadcast_to(at.shape)
    except RuntimeError:
        raise ValueError(
            f"phase answers {tuple(phase.shape)} for positions {tuple(at.shape)}; it must "
            "answer elementwise"
        ) from None
    require_finite("phase", phase)
    return phase


def _broadcast_pair(**numbers: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Broadcast two arguments to one shape in float64, without gradients; both must be finite."""
    (first, a), (second, b) = (
        (name, torch.as_tensor(value).detach().to(torch.float64)) for name, value in numbers.items()
    )
    require_finite(first, a)
    require_finite(second, b)
    try:
        a, b = torch.broadcast_tensors(a, b)  # type: ignore[no-untyped-call]
    except RuntimeError:
        raise ValueError(
            f"{first} is {tuple(a.shape)} and {second} is {tuple(b.shape)}; give shapes that "
            "broadcast, as a column and a row do"
        ) from None
    return a, b


def _scatter_to_mask(values: torch.Tensor, inside: torch.Tensor) -> torch.Tensor:
    """Put values where the mask `inside` is true, in their order, and exact zeros elsewhere."""
    zeros = torch.zeros(inside.numel(), dtype=torch.complex128, device=inside.device)
    where = torch.nonzero(inside.flatten(), as_tuple=True)
    return zeros.index_put(where, values).reshape(inside.shape)


def _require_tolerance(tol: float) -> None:
    if not tol >= FLOAT64_ARITHMETIC:
        raise ToleranceError(
            f"tol {tol:g} can't be kept; ask for tol {FLOAT64_ARITHMETIC:g} or more"
        )
