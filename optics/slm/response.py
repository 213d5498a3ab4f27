"""Describe a panel's phase response to grey levels, measured or from a vendor's table."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import torch

from optics.slm.cells import as_float64
from optics.validation import require_finite, require_wavelength

if TYPE_CHECKING:
    from optics.slm.panel import Panel


@dataclass(frozen=True, eq=False)
class PhaseResponse:
    """Describe a panel's phase by grey level, at wavelengths and in regions of the panel.

    Between wavelengths the shares are interpolated linearly in 1/wavelength², the variable in which
    a liquid crystal's dispersion is smoothest (see `max_phase`), and between the regions' centres
    bilinearly, so that there are no seams. Beyond the outermost ones they are constant.

    Parameters
    ----------
    wavelengths : tuple of float
        Metres, all different.
    shares : torch.Tensor or numpy.ndarray
        Shares of the panel's highest phase, (wavelengths, region rows, region columns, levels);
        kept as a float64 tensor. Regions are equally large and cover the panel. A share may exceed
        1, where a panel's range is larger than its table says. The first share needn't be 0.

    Raises
    ------
    ValueError
        If shares aren't finite, fall from one level to the next, don't rise at all, or have another
        shape, or if wavelengths aren't positive or occur twice.
    """

    wavelengths: tuple[float, ...]
    shares: torch.Tensor

    def __post_init__(self) -> None:
        shares = as_float64(self.shares)
        wavelengths = tuple(float(w) for w in self.wavelengths)
        for wavelength in wavelengths:
            require_wavelength("a response's wavelength", wavelength)
        if len(set(wavelengths)) != len(wavelengths):
            raise ValueError("a response's wavelengths must differ; give each once")
        if shares.ndim != 4 or shares.shape[0] != len(wavelengths) or not shares.numel():
            raise ValueError(
                f"a response's shares are {tuple(shares.shape)}; they need wavelengths "
                f"({len(wavelengths)}), region rows, region columns and levels"
            )
        require_finite("a response", shares)
        _require_rising(shares.detach(), wavelengths)
        object.__setattr__(self, "shares", shares)
        object.__setattr__(self, "wavelengths", wavelengths)

    @staticmethod
    def from_curve(wavelength: float, shares: Any) -> PhaseResponse:
        """Build an SLM's phase response of one curve for all its pixels and every wavelength.

        Parameters
        ----------
        wavelength : float
            Metres, at which the curve was measured.
        shares : torch.Tensor or numpy.ndarray
            Shares of the highest phase, (levels,).

        Returns
        -------
        PhaseResponse
            The response.
        """
        return PhaseResponse((wavelength,), as_float64(shares)[None, None, None])

    @staticmethod
    def from_phases(panel: Panel, wavelengths: Sequence[float], phases: Any) -> PhaseResponse:
        """Build an SLM's phase response to grey levels from measured phases.

        Parameters
        ----------
        panel : Panel
            The panel; the shares are relative to its highest phase.
        wavelengths : sequence of float
            Metres.
        phases : torch.Tensor or numpy.ndarray
            Radians, (wavelengths, levels) or (wavelengths, region rows, region columns, levels).

        Returns
        -------
        PhaseResponse
            The response.

        Raises
        ------
        ValueError
            If the phases have another shape.
        """
        # A panel has a response, so an import at the top would be circular.
        from optics.slm.phase_range import max_phase

        phases = as_float64(phases)
        if phases.ndim == 2:
            phases = phases[:, None, None]
        if phases.ndim != 4 or phases.shape[0] != len(wavelengths):
            raise ValueError(
                f"phases are {tuple(phases.shape)}; they need wavelengths ({len(wavelengths)}) "
                "and levels, with region rows and columns between them or without"
            )
        highest = torch.tensor([max_phase(panel, w) for w in wavelengths], dtype=torch.float64)
        return PhaseResponse(tuple(wavelengths), phases / highest[:, None, None, None])

    @property
    def levels(self) -> int:
        """The number of grey levels of the SLM's response."""
        return self.shares.shape[-1]

    @property
    def regions(self) -> tuple[int, int]:
        """The numbers of rows and columns of regions in the SLM's response."""
        return self.shares.shape[1], self.shares.shape[2]

    def at(self, wavelength: float) -> torch.Tensor:
        """Interpolate the SLM's response at a wavelength, as shares of the highest phase.

        The result is (region rows, region columns, levels). wavelength: metres.
        """
        order = sorted(range(len(self.wavelengths)), key=lambda k: self.wavelengths[k])
        known = [self.wavelengths[k] for k in order]
        if wavelength <= known[0]:
            return self.shares[order[0]]
        for one, other, low, high in zip(order, order[1:], known, known[1:], strict=False):
            if wavelength <= high:
                share = (low**-2 - wavelength**-2) / (low**-2 - high**-2)
                return torch.lerp(self.shares[one], self.shares[other], share)
        return self.shares[order[-1]]


def _require_rising(shares: torch.Tensor, wavelengths: tuple[float, ...]) -> None:
    falls = (shares.diff(dim=-1) < 0).nonzero()
    if len(falls):
        w, row, column, level = falls[0].tolist()
        raise ValueError(
            f"the response falls from level {level} to {level + 1} at "
            f"{wavelengths[w] * 1e9:.0f} nm in region ({row}, {column}), and {len(falls)} times "
            "in all; the phase must grow with the level: smooth the measurement"
        )
    if shares.shape[-1] < 2 or not bool((shares[..., -1] > shares[..., 0]).all()):
        raise ValueError("the response doesn't rise from its first level to its last; it must")
