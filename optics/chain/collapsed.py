"""Compute the PSF of a panel before a lens as if it stood in the lens, if the error is small."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

import torch

from optics.accuracy import (
    ErrorEstimate,
    MachineSpeed,
    ToleranceError,
    unreachable_tolerance_error,
)
from optics.camera import Camera
from optics.chain.cut_pixels import cut_pixel_error_share
from optics.chain.engine import search_seconds
from optics.chain.grid import GridEngine
from optics.chain.lens_grid import LensGridSearch
from optics.chain.low_light import LowLightCorrection
from optics.chain.thin_camera import collapse_to_thin_camera
from optics.plane import Plane
from optics.psf_engines.behind_panel import BehindPanelEngine
from optics.psf_engines.panel_engine import PanelEngine
from optics.psf_engines.request import PSFRequest
from optics.psf_engines.window_error import (
    UNKNOWN_LIGHT,
    AddedLight,
    allowed_own_error,
    largest_ratio,
    window_norm,
)
from optics.pupil import (
    MIN_RAY_MATRIX_B_SHARE,
    numeric_camera,
    open_area,
    pupil_amplitude,
    vergence_error,
)
from optics.quarter_symmetry import mirror_quarter
from optics.validation import as_number, rounded_up


class CollapsedEngine(BehindPanelEngine):
    """Computes the PSF by one Fourier integral from the panel, with the stop's shadow on it.

    See `collapse_to_thin_camera` for the model. It has two errors. First, it neglects the
    diffraction between the panel and the stop's edge. Second, a panel pixel that the shadow covers
    in part passes light in proportion to its open area, while the real stop cuts the pixel. Both
    errors are estimated (see `StopEdgeScatter` and `cut_pixel_error_share`), and the engine raises
    ToleranceError where they exceed the tolerance. They are added, because both may have the same
    sign.

    mirrored: whether a quarter of a mirrored pattern is given, as for PanelEngine; only where the
    stop's shadow leaves the panel open.
    """

    name = "collapsed"

    def __init__(
        self,
        request: PSFRequest,
        camera: Camera,
        search: LensGridSearch,
        transform: str | None = None,
        *,
        mirrored: bool = False,
    ) -> None:
        self._request, self._camera, self._search = request, camera, search
        self._mirrored = mirrored
        n = request.numeric
        plain = numeric_camera(camera)
        if not can_collapse(plain):
            raise ValueError(
                "method is 'collapsed'; it serves thin lenses without aberrations only, whose "
                'panel isn\'t near to the plane in focus; take method="chain"'
            )
        thin = collapse_to_thin_camera(plain, n.distance, n.field)
        if not open_area(thin) > 0:
            raise ToleranceError(
                "the shadow of the stop misses the panel, and light that is bent there doesn't go "
                'through a collapsed camera; take method="chain"'
            )
        self._require_fixed_pixel_edges(request, thin)
        if mirrored and float(pupil_amplitude(thin).min()) < 1:
            raise ToleranceError("the stop's shadow cuts the panel; the light isn't mirrored")
        self._edge_error, self._cut_pixel_error = search.edge_scatter.collapse_error(), 0.0
        if self._edge_error < n.tol:
            self._cut_pixel_error = self._estimate_cut_pixel_error(thin)
        neglected = self._edge_error + self._cut_pixel_error
        left = n.tol - neglected
        if not left > 0:
            raise ToleranceError(
                f"tol {n.tol:g} can't be kept by a collapsed camera: what the stop's edge does to "
                f'the light is worth about {rounded_up(neglected)}; take method="chain"'
            )
        inner = _thin_lens_request(request, camera, left)
        self._panel_engine = PanelEngine(inner, thin, transform=transform, mirrored=mirrored)
        self._open_area_ratio = open_area(thin) / open_area(plain)
        self.precision, self.arithmetic = (
            self._panel_engine.precision,
            self._panel_engine.arithmetic,
        )
        self.sampling = self._panel_engine.sampling
        inner_error = self._panel_engine.error
        self.error = ErrorEstimate(
            inner_error.value + neglected,
            f"{inner_error.how}, and an estimate of the stop's edge for an evenly lit panel",
        )

    def _estimate_cut_pixel_error(self, thin: Camera) -> float:
        """Estimate the chain's error if pixels that the stop cuts count as dimmer whole ones."""
        inner = _thin_lens_request(self._request, self._camera, self._request.tol)
        edge = self._search.edge_scatter
        return edge.error_from_light_share(
            cut_pixel_error_share(inner, thin, edge.direct_area / edge.shadow_magnification**2)
        )

    @staticmethod
    def _require_fixed_pixel_edges(request: PSFRequest, thin: Camera) -> None:
        """Raise ToleranceError if the chain needs derivatives and the stop's shadow cuts pixels.

        The collapsed camera has no derivative of the area that the shadow leaves open.
        """
        if request.differentiable and float(pupil_amplitude(thin).min()) < 1:
            raise ToleranceError(
                "the derivatives of a stop whose shadow cuts the panel can't be kept by a "
                'collapsed camera; take method="chain"'
            )

    @property
    def bytes(self) -> int:
        return self._panel_engine.bytes

    def cpu_seconds(self, speed: MachineSpeed) -> float:
        return self._panel_engine.cpu_seconds(speed)

    def planning_seconds(self, speed: MachineSpeed) -> float:
        return search_seconds(speed) + self._panel_engine.planning_seconds(speed)

    def prepare(self) -> None:
        self._panel_engine.prepare()

    def points(self) -> tuple[torch.Tensor, torch.Tensor]:
        return self._panel_engine.points()

    def intensity(
        self,
        phase: torch.Tensor | None,
        amplitude: torch.Tensor | None,
        added: AddedLight | None = None,
    ) -> torch.Tensor:
        beside = self._beside_inner_light(added)
        light = self._panel_engine.intensity(phase, amplitude, beside) * self._open_area_ratio
        edge = self._search.edge_scatter
        dimness = LowLightCorrection(
            edge,
            self._request.window_slices,
            light,
            amplitude,
            lambda: edge.passing_brightness(self._panel_field(phase, amplitude)),
        )
        lost = (
            self._edge_error / dimness.error_divisor(edge.collapse_passing_share)
            + self._cut_pixel_error / dimness.uniform_error_divisor
        )
        used = self._panel_engine.used_engine
        norm = window_norm(light.detach(), self._request.window_slices)
        inner = used.error.value + used.arithmetic
        if beside is not None:
            inner = largest_ratio(
                inner * torch.hypot(norm, self._open_area_ratio * beside.norm.to(norm)), norm
            )
        how = "estimate for the light in the window"
        error = self.tell_error(lost + inner, norm, added, used.arithmetic, how)
        self._stand_in = None
        if error <= self._request.tol:
            return light
        allowed_own_error(self._request.tol, norm, added)
        self._stand_in = self._fallback_engine
        return self._stand_in.intensity(phase, amplitude, added)

    def _beside_inner_light(self, added: AddedLight | None) -> AddedLight | None:
        """Return what is added to a chain's light in the units of the collapsed camera's.

        Its error isn't the panel engine's, and isn't judged there. Beside light that isn't known
        yet, the panel engine keeps its tolerance by itself, which costs it little.
        """
        if added is None or added is UNKNOWN_LIGHT:
            return None
        norm = added.norm / self._open_area_ratio
        return AddedLight(norm, torch.zeros_like(norm))

    def _panel_field(
        self, phase: torch.Tensor | None, amplitude: torch.Tensor | None
    ) -> torch.Tensor:
        """Return the field behind the chain's panel."""
        shape = self._camera.panel.shape
        if self._mirrored and phase is not None:
            phase = mirror_quarter(phase, shape)
        factor = self.modulation_factor(phase, amplitude, shape, torch.complex64)
        return torch.ones(shape, dtype=torch.complex64) if factor is None else factor

    @cached_property
    def _fallback_engine(self) -> GridEngine:
        """The chain's engine for windows so dim that light scattered at the stop's edge matters.

        Raises ToleranceError for a quarter of a pattern, which that engine doesn't take.
        """
        if self._mirrored:
            raise unreachable_tolerance_error(self._request.tol, self.error.value)
        chain = GridEngine(self._request, self._camera, self._search)
        chain.prepare()
        return chain


def can_collapse(camera: Camera) -> bool:
    """Tell whether a thin lens at the chain's panel can replace the lens behind it.

    The lens must have no aberrations, and the panel must not be too near to the plane in focus.
    """
    return (
        camera.lens.has_quadratic_phase
        and camera.ray_matrix_b >= MIN_RAY_MATRIX_B_SHARE * camera.lens.image_distance
    )


def _thin_lens_request(request: PSFRequest, camera: Camera, tol: float) -> PSFRequest:
    """Convert a PSF request for the chain into one for the thin lens at its panel.

    If the point is out of focus, its image moves, because the stop moves to the panel. The ray
    through the panel's middle meets the sensor at the distance -field z1 (1 + z1/d) (1/(d + z1) -
    1/F) from the ray through the middle of the lens.
    """
    thin = collapse_to_thin_camera(camera, request.distance, request.numeric.field)
    # V (1 + z1/d) z1, and 1 + z1/d = (d + z1) / d.
    moved = (
        vergence_error(request.lens, request.object_to_lens_distance) * request.shadow_magnification
    )
    moved = moved * request.separation
    centre = tuple(
        c - f * moved if as_number(f) or isinstance(f, torch.Tensor) else c
        for c, f in zip(request.samples.centre, request.field, strict=True)
    )
    samples = request.samples
    plane = Plane(samples.shape, samples.pitch, (centre[0], centre[1]))
    nothing = (0.0, 0.0)
    return replace(request, lens=thin.lens, samples=plane, tol=tol, separation=0.0, field=nothing)
