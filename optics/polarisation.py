"""Compute how polarisers, a beam splitter and the panel change and lose polarised light.

The method is Jones calculus (Saleh and Teich, Fundamentals of Photonics, 6.1; Goodman,
Introduction to Fourier Optics, on liquid-crystal modulators) for the parts of the bench: thesis
Fig. 5.6 has a polariser, a beam splitter cube that light passes twice, and a panel that modulates
one linear polarisation only (§2.3, §3.4, §5.6).

Jones vectors are (along, across) the panel's modulated axis, complex128. Angles are in radians
from that axis. Mirrors don't change the sign of an angle: the path is treated as unfolded.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import torch

from optics.validation import (
    as_number,
    needs_gradient,
    require_choice,
    require_positive,
    require_share,
)

Scalar = Any  # a number, or a 0-d tensor in which the result is differentiable

# Share of the light below which the elements are crossed and only rounding errors are left.
_MIN_TRANSMISSION = (64 * torch.finfo(torch.float64).eps) ** 2


def _as_float64(value: Scalar) -> torch.Tensor:
    return torch.as_tensor(value, dtype=torch.float64)


def _require_angle(value: Scalar) -> None:
    number = as_number(value)
    if not math.isfinite(number):
        raise ValueError(f"angle is {number:g} rad; it must be finite")


def linear_jones_vector(angle: Scalar) -> torch.Tensor:
    """Return the Jones vector (2,) of linearly polarised light of power 1, complex128."""
    angle = _as_float64(angle)
    return torch.stack((torch.cos(angle), torch.sin(angle))).to(torch.complex128)


def diattenuator_matrix(angle: Scalar, along: torch.Tensor, across: torch.Tensor) -> torch.Tensor:
    """Return the Jones matrix of a part that attenuates two polarisations differently, (2, 2).

    The amplitude factors are those along the part's axis, at `angle`, and across it, without delay.
    """
    forth, aside = linear_jones_vector(angle), linear_jones_vector(_as_float64(angle) + math.pi / 2)
    return along * torch.outer(forth, forth) + across * torch.outer(aside, aside)


@dataclass(frozen=True)
class SourcePolarisation:
    """Describe the object's polarisation: unpolarised (degree 0), linear (1), or partly polarised.

    degree: degree of polarisation. angle: radians, direction of the polarised part. Two
    orthogonal linear waves of independent phases are the same light (section 11.4 of Saleh and
    Teich). Raises ValueError for a degree that isn't a share, and for an infinite angle.
    """

    degree: Scalar = 0.0
    angle: Scalar = 0.0

    def __post_init__(self) -> None:
        require_share("degree", as_number(self.degree))
        _require_angle(self.angle)

    @property
    def incoherent_components(self) -> list[tuple[torch.Tensor, torch.Tensor]]:
        """The two incoherent waves: shares of the power and Jones vectors."""
        degree, angle = _as_float64(self.degree), _as_float64(self.angle)
        across = linear_jones_vector(angle + math.pi / 2)
        return [((1 + degree) / 2, linear_jones_vector(angle)), ((1 - degree) / 2, across)]


@dataclass(frozen=True)
class Polariser:
    """Describe a linear polariser.

    angle: radians from the panel's modulated axis to the polariser's. extinction: power that
    passes along the polariser's axis over power that passes across it, 1 or more; inf is ideal.
    transmission: share of the power along its axis that passes. Raises ValueError for numbers out
    of these ranges.
    """

    angle: Scalar = 0.0
    extinction: Scalar = math.inf
    transmission: Scalar = 1.0

    def __post_init__(self) -> None:
        _require_angle(self.angle)
        extinction = as_number(self.extinction)
        if not extinction >= 1:
            raise ValueError(
                f"extinction is {extinction:g}; it is the power along the polariser's axis over "
                "that across it: 1 or more, inf for an ideal one"
            )
        require_positive("transmission", self.transmission, "")
        require_share("transmission", as_number(self.transmission))

    @property
    def jones_matrix(self) -> torch.Tensor:
        along = torch.sqrt(_as_float64(self.transmission))
        across = along * torch.rsqrt(_as_float64(self.extinction))
        return diattenuator_matrix(self.angle, along, across)


@dataclass(frozen=True)
class BeamSplitter:
    """Describe a beam splitter cube by its transmitted and reflected shares of (p, s) power.

    p light is polarised in the plane of incidence, s light across it. The defaults are a
    non-polarising cube; transmitted=(1, 0), reflected=(0, 1) is a polarising one. angle: radians
    from the panel's modulated axis to p. A delay between p and s isn't modelled; it changes
    nothing where p or s lies along the modulated axis. Raises ValueError for shares outside 0 to
    1, for shares that sum to more than 1, and for a share of 0 whose derivative is required: the
    derivative of its amplitude is infinite.
    """

    transmitted: tuple[Scalar, Scalar] = (0.5, 0.5)
    reflected: tuple[Scalar, Scalar] = (0.5, 0.5)
    angle: Scalar = 0.0

    def __post_init__(self) -> None:
        _require_angle(self.angle)
        for name in ("transmitted", "reflected"):
            shares = getattr(self, name)
            if len(shares) != 2:
                raise ValueError(f"{name} has {len(shares)} shares; give two, of p and of s")
            for share in shares:
                require_share(name, as_number(share))
                if needs_gradient(share) and as_number(share) == 0:
                    raise ValueError(
                        f"{name} is 0 and its derivative is wanted, which is infinite; give a "
                        "number instead of a tensor, or a share above 0"
                    )
        for one, passed, turned in zip("ps", self.transmitted, self.reflected, strict=True):
            whole = as_number(passed) + as_number(turned)
            if whole > 1 + 1e-12:  # Rounding errors are allowed.
                raise ValueError(
                    f"transmitted and reflected shares of {one} light sum to {whole:g}; "
                    "a cube gives no light: 1 at most"
                )

    def jones_matrix(self, port: Literal["transmitted", "reflected"]) -> torch.Tensor:
        """Return the Jones matrix for transmitted or for reflected light."""
        shares = self.transmitted if port == "transmitted" else self.reflected
        return diattenuator_matrix(self.angle, *(torch.sqrt(_as_float64(one)) for one in shares))


class PathEffect(NamedTuple):
    """What a path of polarising elements does to light, panel included, as 0-d tensors.

    transmission: share of the power that passes if neither the panel nor other parts absorb.
    unmodulated: share of the passed power that the panel doesn't modulate. interference:
    complex128, 2⟨E_m* E_u⟩ of modulated and unmodulated light after the path, over the power that
    passes. Let p be the sensor's field with the pattern and q the one with a neutral panel, each
    for light of power 1. A point's light there is then

        (1 - unmodulated) |p|² + unmodulated |q|² + Re(interference · conj(p) · q).

    The sum in intensity of thesis §5.6 leaves out the last term. Its phase is known except for
    the delay between the panel's axes at grey level 0. Its strength, abs(interference), is at
    most 2 sqrt(unmodulated (1 - unmodulated)).
    """

    transmission: torch.Tensor
    unmodulated: torch.Tensor
    interference: torch.Tensor


@dataclass(frozen=True)
class PolarisedPath:
    """Describe the polarising elements that light passes on its way to the panel and to the lens.

    Light passes a single polariser between splitter and panel twice; give it as both. None stands
    for no element.
    """

    light: SourcePolarisation = SourcePolarisation()
    polariser: Polariser | None = None  # before the splitter
    splitter: BeamSplitter | None = None  # passed twice, to the panel and back (thesis Fig. 5.6)
    analyser: Polariser | None = None  # behind the splitter
    first: Literal["transmitted", "reflected"] = "transmitted"  # to the panel; back, the other

    def __post_init__(self) -> None:
        require_choice("first", self.first, ("transmitted", "reflected"))

    @property
    def jones_to_panel(self) -> torch.Tensor:
        """The Jones matrix from the object to the panel: polariser and beam splitter."""
        return self._splitter_matrix(self.first) @ _polariser_matrix(self.polariser)

    @property
    def jones_from_panel(self) -> torch.Tensor:
        """The Jones matrix from the panel to the lens: beam splitter and analyser."""
        back = self._splitter_matrix("reflected" if self.first == "transmitted" else "transmitted")
        return _polariser_matrix(self.analyser) @ back

    def _splitter_matrix(self, port: Literal["transmitted", "reflected"]) -> torch.Tensor:
        return _NOTHING if self.splitter is None else self.splitter.jones_matrix(port)

    def effect(self) -> PathEffect:
        """Compute what the elements and the panel do to the light, by Jones calculus.

        The panel modulates one axis only. Its Jones matrix is diag(exp(i pattern), 1). Let G = Σ
        share · m m† be the coherency matrix of the light that falls on it, L the Jones matrix
        behind it, and N = L† L. The modulated power is then N₀₀ G₀₀, the unmodulated power N₁₁ G₁₁.
        The two interfere by N₀₁ G₁₀, which is zero where L keeps them orthogonal: without an
        analyser, and with a splitter that doesn't polarise, or whose axes are the panel's. The
        result is differentiable in every number of the elements. Raises ValueError where no light
        passes.
        """
        before, after = self.jones_to_panel, self.jones_from_panel
        waves = ((share, before @ wave) for share, wave in self.light.incoherent_components)
        falling = torch.stack([share * torch.outer(w, w.conj()) for share, w in waves]).sum(0)
        leaving = after.conj().T @ after
        modulated = (leaving[0, 0] * falling[0, 0]).real
        unmodulated = (leaving[1, 1] * falling[1, 1]).real
        passed = modulated + unmodulated
        if float(passed.detach()) <= _MIN_TRANSMISSION:
            raise ValueError(
                "no light passes the polarisers, splitter and analyser; they are crossed: "
                "turn one of them"
            )
        mixed = 2 * leaving[0, 1] * falling[1, 0] / passed
        return PathEffect(passed, unmodulated / passed, mixed)


_NOTHING = torch.eye(2, dtype=torch.complex128)  # the matrix of no element


def _polariser_matrix(polariser: Polariser | None) -> torch.Tensor:
    return _NOTHING if polariser is None else polariser.jones_matrix
