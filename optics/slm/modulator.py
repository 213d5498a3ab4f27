"""What a panel does to light of one wavelength, effect by effect."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import cached_property

import torch

from optics.slm.coupling import fringing_field_mean
from optics.slm.dynamics import first_start_phase, relaxed_phase, time_node_count, time_nodes
from optics.slm.lut import flatness_phase, grey_to_phase, is_uniform, phase_to_grey, require_levels
from optics.slm.panel import Panel, gap_amplitude, max_phase
from optics.validation import accepts_numpy, require_finite


def flicker_nodes(flicker: float, phase: float, tol: float) -> list[tuple[float, float]]:
    """Return quadrature nodes for the mean over flicker: shares of time, and factors of the phase.

    The factors replace 1 + flicker sin. The rule is that of Gauss for the mean over a sine
    (Chebyshev nodes). For the largest phase in radians, it has as few nodes as give the mean of
    exp(i phase flicker sin), which is Bessel's J0, with an error of at most tol. The error of k
    nodes is 2 J_2k, which is below 2 (half the argument)^2k / (2k)!. Raises ValueError for a phase
    that needs 64 nodes or more.
    """
    if flicker == 0:
        return [(1.0, 1.0)]
    swing = abs(flicker * phase)
    for count in range(1, 64):
        error = 2 * count * math.log(swing / 2 + 1e-300) - math.lgamma(2 * count + 1)
        if error <= math.log(tol / 2):
            angles = [math.pi * (2 * k + 1) / (2 * count) for k in range(count)]
            return [(1 / count, 1 + flicker * math.cos(angle)) for angle in angles]
    raise ValueError(
        f"flicker is {flicker:g} and moves the phase by {swing:.3g} rad, more than can be "
        "averaged; wrap the phase into the panel's range"
    )


def scattered_share(jitter: float) -> float:
    """Compute the share of light that jitter scatters, a normal phase error in radians rms.

    The mean fields of independent pixels, exp(-jitter²/2) each, add coherently. The rest of the
    power, a share of 1 - exp(-jitter²), adds in intensity and is spread evenly, apart from the
    envelope of one pixel (Ruze, Proc. IEEE 54, 633, 1966, for a correlation of one pixel).
    """
    return -math.expm1(-(jitter**2))


def front_reflection_share(panel: Panel) -> float:
    """Compute the share of the panel's light that its cover glass reflects.

    This light adds in intensity, because the glass is far thicker than the coherence length, which
    at 550 nm and a band of 7 nm is wavelength² / band = 43 µm.
    """
    return panel.front_reflection / panel.reflectivity if panel.front_reflection else 0.0


def transmitted_unmodulated_share(panel: Panel) -> float:
    """Compute the share of light that passed the liquid crystal unmodulated.

    This light has the polarisation whose phase the crystal doesn't change (thesis §5.6 gives 5 to
    10 %).
    """
    return (1 - front_reflection_share(panel)) * panel.unmodulated


# Largest error of a mean over a frame, for the two pixels whose phases change most differently. The
# error of pictures is far smaller.
TOL = 1e-2

FLICKER_TOL = 1e-3  # largest error of a mean over flicker, for the pixel of the largest phase


class Modulator:
    """Model what a panel does to light of one wavelength, effect by effect.

    A field of amplitude 1 falls on every pixel. The model gives one complex number for each pixel,
    the mean field over its active area, which a PSFOperator takes as its amplitude, and shares of
    light that add in intensity. The complex number is exact for light near the axis. For light
    whose phase changes by t radians across a pixel, its error is at most t times the coupling's
    effect. An effect whose value in the Panel is 0 or None is off: its code isn't called.
    `modulated_psf` combines all effects.

    Parameters
    ----------
    panel : Panel
        The panel.
    wavelength : float
        Metres.

    Raises
    ------
    ValueError
        If the wavelength is outside the panel's table.
    """

    def __init__(self, panel: Panel, wavelength: float) -> None:
        max_phase(panel, wavelength)
        self.panel, self.wavelength = panel, wavelength

    @property
    def unmodulated_share(self) -> float:
        """Share of light that isn't modulated; it adds in intensity."""
        return front_reflection_share(self.panel) + transmitted_unmodulated_share(self.panel)

    @property
    def unmodulated_fields(self) -> list[tuple[float, torch.Tensor | None]]:
        """Return shares and fields of the light that isn't modulated.

        A field of None is 1 everywhere. Light that passed the panel has the phase of its flatness;
        light that the cover glass reflected doesn't.
        """
        shares = [(self.unmodulated_share, self._illumination_amplitude)]
        if self.panel.flatness is not None:
            shares = [
                (front_reflection_share(self.panel), self._illumination_amplitude),
                (transmitted_unmodulated_share(self.panel), self._static_factor),
            ]
        return [(share, field) for share, field in shares if share > 0]

    @property
    def jitter_scatter_share(self) -> float:
        """Share of modulated light that jitter spreads evenly over the orders."""
        return scattered_share(self.panel.jitter) if self.panel.jitter else 0.0

    def phase(self, grey: torch.Tensor) -> torch.Tensor:
        """Compute the settled phase of grey levels, as `grey_to_phase` does.

        Dispersion and response are included; the coupling of neighbouring pixels isn't.
        """
        return grey_to_phase(self.panel, grey, self.wavelength)

    def grey(self, phase: torch.Tensor, orders: int = 1) -> torch.Tensor:
        """Compute the grey levels that give light a phase, as `phase_to_grey` does."""
        return phase_to_grey(self.panel, phase, self.wavelength, orders)

    @accepts_numpy
    def modulation(self, phase: torch.Tensor) -> torch.Tensor:
        """Compute the complex field of each pixel from the displayed phase, (..., rows, columns).

        The field is the mean of exp(i phase) over the pixel's active area, with the phase blurred
        by the coupling. The gap's light is added. The sum is multiplied by the phase factor of the
        flatness and by the amplitude of the illumination, whose mean square over the panel is 1.
        Without the gap's light and an illumination its magnitude is at most 1.

        The phase is in radians, wrapped as the panel wraps. The field is complex64 for a float32
        phase and complex128 for float64, and differentiable in the phase. Raises ValueError if the
        phase's shape isn't the panel's, or the phase isn't finite.
        """
        if not phase.is_floating_point():
            raise ValueError(f"phase is {phase.dtype}; give radians as float32 or float64")
        if tuple(phase.shape[-2:]) != self.panel.shape:
            raise ValueError(f"phase is {tuple(phase.shape)}; the panel has {self.panel.shape}")
        require_finite("phase", phase)
        return self._with_static_factor(self._pixel_field(phase))

    def modulation_of_grey(
        self, grey: torch.Tensor, *, dtype: torch.dtype = torch.float32
    ) -> torch.Tensor:
        """Compute the complex field of each pixel from grey levels.

        It is the `modulation` of the settled `phase`. Where the field of a pixel follows from its
        own level alone, it is computed once for each level and looked up, in a fifth of the time.

        `dtype` is the type of the phase; float32 gives complex64 fields. Raises ValueError if the
        panel lacks a level, or the shape isn't the panel's.
        """
        panel = self.panel
        if panel.coupling or not is_uniform(panel):
            return self.modulation(torch.as_tensor(self.phase(grey)).to(dtype))
        require_levels(panel, grey)
        if tuple(grey.shape[-2:]) != panel.shape:
            raise ValueError(f"grey is {tuple(grey.shape)}; the panel has {panel.shape}")
        levels = self.phase(torch.arange(panel.levels, device=grey.device))
        fields = self._pixel_field(torch.as_tensor(levels).to(dtype))
        return self._with_static_factor(fields[grey.to(torch.int64)])

    def _pixel_field(self, phase: torch.Tensor) -> torch.Tensor:
        """Compute the field of pixels, without flatness and illumination.

        The phase may have any shape unless neighbouring pixels are coupled.
        """
        panel = self.panel
        if panel.coupling:
            side = math.sqrt(panel.fill_factor)
            field = fringing_field_mean(phase, panel.coupling / panel.pitch, side)
        else:
            field = torch.complex(torch.cos(phase), torch.sin(phase))
        return field + gap_amplitude(panel) if panel.gap_reflection else field

    def _with_static_factor(self, field: torch.Tensor) -> torch.Tensor:
        """Multiply a field by the factor of flatness and illumination."""
        return field if self._static_factor is None else field * self._static_factor.to(field)

    def still_fields(
        self, grey: torch.Tensor, *, dtype: torch.dtype = torch.float32, tol: float = FLICKER_TOL
    ) -> list[tuple[float, torch.Tensor]]:
        """Compute shares of time and fields while still grey levels, (rows, columns), are shown.

        Without flicker there is one pair. The phase is of type `dtype`, where float32 gives
        complex64 fields, and `tol` is the largest error of the mean over the flicker.
        """
        return list(self.iterate_still_fields(grey, dtype=dtype, tol=tol))

    def iterate_still_fields(
        self, grey: torch.Tensor, *, dtype: torch.dtype = torch.float32, tol: float = FLICKER_TOL
    ) -> Iterator[tuple[float, torch.Tensor]]:
        """Yield what `still_fields` lists; each field is computed when it is asked for."""
        if self.panel.flicker:
            phase = torch.as_tensor(self.phase(grey))
            yield from self.flicker_fields(phase, dtype=dtype, tol=tol)
        else:
            yield 1.0, self.modulation_of_grey(grey, dtype=dtype)

    def flicker_fields(
        self, phase: torch.Tensor, *, dtype: torch.dtype | None = None, tol: float = FLICKER_TOL
    ) -> Iterator[tuple[float, torch.Tensor]]:
        """Yield shares of time and fields of a phase, in radians, that is constant but for flicker.

        Differentiable in the phase, which is modulated in its own type unless `dtype` is given.
        """
        flicker, nodes = self.panel.flicker, [(1.0, 1.0)]
        if flicker:
            nodes = flicker_nodes(flicker, float(phase.detach().abs().max()), tol)
        for weight, factor in nodes:
            moved = phase if factor == 1 else factor * phase
            yield weight, self.modulation(moved.to(dtype or phase.dtype))

    def transition_fields(
        self,
        start: torch.Tensor,
        end: torch.Tensor,
        seconds: float,
        *,
        dtype: torch.dtype | None = None,
        tol: float = TOL,
    ) -> Iterator[tuple[float, torch.Tensor]]:
        """Yield shares of time and fields while the crystal relaxes from one phase to another.

        The phases are in radians, (rows, columns), and are modulated in the type `dtype`, by
        default their own. The transition lasts so many seconds. `tol` is the largest error of the
        mean over that time, whose shares sum to 1.
        """
        tau, flicker_tol = self.panel.response_time, min(tol, FLICKER_TOL)
        if not tau:
            yield from self.flicker_fields(end, dtype=dtype, tol=flicker_tol)
            return
        change = (start - end).detach()
        # The gap's light is constant, so that 0 counts as one of the changes.
        spread = float(change.max().clamp(min=0) - change.min().clamp(max=0))
        count = time_node_count(spread, seconds, tau, tol)
        for time, share in zip(*time_nodes(seconds, tau, count), strict=True):
            phase = relaxed_phase(end, start, time, tau)
            for weight, field in self.flicker_fields(phase, dtype=dtype, tol=flicker_tol):
                yield share * weight, field

    def video_cycle_fields(
        self, video_phase: torch.Tensor, frame_time: float, *, tol: float = TOL
    ) -> Iterator[tuple[int, float, torch.Tensor]]:
        """Yield frames, shares of time and fields of one cycle of a video that repeats forever.

        The liquid crystal relaxes to first order, and flickers. Both are averaged over as few nodes
        as keep `tol`, the largest error of the mean over a frame. Each field is computed when it is
        requested. Differentiable in the phases, at which the frames, (frames, rows, columns), would
        settle. A frame is shown for `frame_time` seconds. The shares sum to 1, and those of a frame
        to 1 / frames.
        """
        tau, count = self.panel.response_time, len(video_phase)
        start = first_start_phase(video_phase, frame_time, tau) if tau else video_phase[-1]
        for frame, end in enumerate(video_phase):
            for share, field in self.transition_fields(start, end, frame_time, tol=tol):
                yield frame, share / count, field
            start = relaxed_phase(end, start, frame_time, tau) if tau else end

    @cached_property
    def _illumination_amplitude(self) -> torch.Tensor | None:
        """Amplitude of the illumination, float64, of mean square 1; None if uniform."""
        if self.panel.illumination is None:
            return None
        light = self.panel.illumination.at_pixels(self.panel)
        return torch.sqrt(light / light.mean())

    @cached_property
    def _static_factor(self) -> torch.Tensor | None:
        """Constant factor of the field, flatness and illumination, complex128; None if 1."""
        lit, panel = self._illumination_amplitude, self.panel
        if panel.flatness is None:
            return None if lit is None else lit.to(torch.complex128)
        phase = flatness_phase(panel, self.wavelength)
        return torch.polar(torch.ones_like(phase) if lit is None else lit, phase)
