"""Compute the PSF through the chain from panel to sensor by direct quadrature, row by row."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch

from optics.accuracy import (
    FLOAT64_ARITHMETIC,
    ErrorEstimate,
    MachineSpeed,
    ToleranceError,
    unreachable_tolerance_error,
)
from optics.chain.direct_sum import DirectSum
from optics.chain.engine import ChainEngine, search_seconds
from optics.chain.propagator_axes import fresnel_area
from optics.chain.reach import TAPER_TOL_SHARE, limited_reach
from optics.chain.split_phase import SplitPhase
from optics.psf_engines.request import PSFRequest
from optics.psf_engines.window_error import (
    AddedLight,
    allowed_own_error,
    largest_ratio,
    window_norm,
)


@dataclass(frozen=True)
class DirectSettings:
    """Tune what a DirectEngine leaves out, and what it tells of its price.

    Attributes
    ----------
    reach_tol_share : float
        Share of the tolerance for light that isn't followed sideways to the stop's edge. Chosen.
    coarsest_inner_tol : float
        Largest tolerance for which the ends of what is followed are planned. Chosen.
    worthwhile_searches : float
        Time of the sum over all light, in searches, beyond which some light is left out if that
        takes less. Chosen.
    planning_calls : float
        Time of planning that doesn't depend on any size, in calls; measured.
    """

    reach_tol_share: float = 0.8
    coarsest_inner_tol: float = 2e-4
    worthwhile_searches: float = 3.0
    planning_calls: float = 40.0


_SETTINGS = DirectSettings()


class DirectEngine(ChainEngine):
    """Computes the PSF by integrals over the panel's pixels and over rows of the stop.

    A pixel's field at the lens is a product of Fresnel integrals along y and x, in closed form
    (see PixelFields). Along the rows of the stop it is integrated in closed form, too (see
    DirectSum). A lens' wave that isn't a product of factors along y and x is a short sum of such
    products (see SplitPhase). So the work grows with the number of rows, not with that of nodes in
    the stop.

    Where that takes little time, all light is followed, and only the rounding of double precision
    limits the error. It is estimated for the light that reaches the window, from the light in the
    stop (see StopLight). Elsewhere, a pixel's light is followed only so far sideways as the
    tolerance takes (see `limited_reach`). For a panel near to its stop, that leaves few pixels at
    each place, and few rows.
    """

    name = "chain, direct"
    precision = "float64"
    _dtype = torch.complex128

    def _plan(self, n: PSFRequest) -> None:
        self._require_served()
        self.arithmetic = FLOAT64_ARITHMETIC
        low, high = n.lens.stop.opening.extent
        self._lens_wave = SplitPhase(n, ((low[0], high[0]), (low[1], high[1])))
        self._left_out = 0.0
        self._take_sum(DirectSum(n, self._camera, self._lens_wave))
        speed = n.budget.speed
        searches = self.total_seconds(n.budget) / search_seconds(speed)
        if searches > _SETTINGS.worthwhile_searches:
            self._limit_reach(n)
        self.sampling = f"{self._sum.row_count} rows of the stop"

    def _take_sum(self, one: DirectSum) -> None:
        """Take a chain's sum, and estimate its rounding."""
        n = self._request.numeric
        self._sum, self._stop_light = one, one.stop_light()
        seen = self._edge_scatter.window_share / float(self.intensity_scale())
        count = math.prod(part.stop - part.start for part in n.window_slices)
        wrong = 2 * self._stop_light.even_error * math.sqrt(count)
        told = wrong / math.sqrt(seen) if seen > 0 else math.inf
        self.error = ErrorEstimate(told, "estimate of rounding, for an evenly lit panel")

    def _limit_reach(self, n: PSFRequest) -> None:
        """Leave out light of a chain that doesn't matter, where that takes less time."""
        whole, seconds = self._sum, self.total_seconds(n.budget)
        allowed = _SETTINGS.reach_tol_share * n.tol
        tol = min(n.tol, _SETTINGS.coarsest_inner_tol)
        reach = limited_reach(self._search, fresnel_area(n), allowed, tol)
        self._take_sum(DirectSum(n, self._camera, self._lens_wave, reach))
        if self.total_seconds(n.budget) < seconds:
            self._left_out = allowed + 2 * TAPER_TOL_SHARE * tol
            left = self._left_out + self.error.value
            self.error = ErrorEstimate(left, "estimate, for an evenly lit panel")
        else:
            self._take_sum(whole)

    def _require_served(self) -> None:
        """Raise ToleranceError for what a chain's direct quadrature doesn't serve."""
        if self._request.differentiable:
            raise ToleranceError("direct quadrature of a chain has no derivatives in lengths")
        if self._request.sphere is not None:
            raise ToleranceError("direct quadrature of a chain takes the parabola of a wave only")

    @property
    def bytes(self) -> int:
        return self._sum.bytes

    def cpu_seconds(self, speed: MachineSpeed) -> float:
        return self._sum.cpu_seconds(speed)

    def planning_seconds(self, speed: MachineSpeed) -> float:
        seconds = super().planning_seconds(speed) + _SETTINGS.planning_calls * speed.call
        if not self.error.value + self.arithmetic <= self._request.tol:
            seconds += self.cpu_seconds(speed)
        return seconds + self._sum.planning_seconds(speed)

    def prepare(self) -> None:
        self._sum.prepare()
        if not self.error.value + self.arithmetic <= self._request.tol:
            # The light that the edge of the stop sends to a dark window isn't known beforehand.
            with torch.no_grad():
                self.intensity(None, None)
            self._planned_error = self.error

    def intensity(
        self,
        phase: torch.Tensor | None,
        amplitude: torch.Tensor | None,
        added: AddedLight | None = None,
    ) -> torch.Tensor:
        modulated = self.panel_field(phase, amplitude)
        if not modulated.numel():
            return self.empty_intensity(modulated)
        field = self._sum.field(modulated.cpu()).to(modulated.device)
        light = (field.real**2 + field.imag**2) * float(self.intensity_scale())
        rounding = self._rounding_error(modulated.detach().cpu(), field.detach().cpu())
        self._refuse_large_rounding(rounding, light.detach(), added)
        if self._left_out:
            return self._intensity_or_replan(light, phase, amplitude, added, rounding=rounding)
        return light

    def _refuse_large_rounding(
        self, rounding: float, light: torch.Tensor, added: AddedLight | None
    ) -> None:
        """Tell the chain's error by rounding for the light in the window; refuse if it's large."""
        norm = window_norm(light, self._request.window_slices)
        how = "estimate of rounding, for the light in the window"
        error = self.tell_error(rounding + self.arithmetic, norm, added, self.arithmetic, how)
        if not error <= self._promised_tol:
            allowed_own_error(self._promised_tol, norm, added)
            raise unreachable_tolerance_error(self._promised_tol, error)

    def _rounding_error(self, modulated: torch.Tensor, field: torch.Tensor) -> float:
        """Estimate the chain's relative error by rounding for the light in the window.

        An error e of the field changes its intensity by 2 |field| e, and the L2 norm of the
        intensity is at least the light over the root of the number of samples.
        """
        window = self._request.window_slices
        seen = window_norm(field.abs(), window)
        count = math.prod(part.stop - part.start for part in window)
        wrong = 2 * math.sqrt(count) * self._stop_light.error(modulated)
        return largest_ratio(wrong, seen)
