"""Group the panel's pixels for faster iterations, and give these their start."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass
from itertools import pairwise

import torch

from optics.progress import Progress
from optics.retrieval.far_field import FarField
from optics.retrieval.goal import RetrievalGoal

# Samples across the coarse far field over those across the window, at least.
#
# Light that a phase-only panel scatters beyond the window must not wrap around into it.
_ROOM = 1.5


def superpixel_side(goal: RetrievalGoal) -> int:
    """Return the side in pixels of the largest superpixels that suit a goal's window.

    A superpixel has 16 pixels along its side at most, and the panel's shorter side has 8
    superpixels at least.
    """
    length, window = goal.far_field_samples, max(goal.plane.shape)
    shortest = min(goal.camera.panel.shape)
    for side in range(16, 1, -1):
        fits = length % side == 0 and length // side >= _ROOM * window
        if fits and shortest // side >= 8:
            return side
    return 1


class Superpixels:
    """A panel of superpixels, side x side pixels each, for the same far-field window.

    The light in a small window changes slowly over the panel, so samples that are `side` pixels
    apart describe it. The grid in the far field is the same, and the work is 1 / side² of that with
    all pixels. shape: (rows, columns) of superpixels; the last ones may extend beyond the panel.
    """

    def __init__(self, goal: RetrievalGoal, side: int) -> None:
        self.goal, self.side = goal, side
        rows, columns = goal.camera.panel.shape
        self.shape = (math.ceil(rows / side), math.ceil(columns / side))
        self.far_field = FarField(self.shape, goal.far_field_samples // side, goal.plane.shape)

    @functools.cached_property
    def amplitude(self) -> torch.Tensor:
        """Return the mean amplitude of the pixels in each superpixel, float32."""
        (rows, columns), side = self.shape, self.side
        full = self.goal.amplitude
        margins = (0, columns * side - full.shape[1], 0, rows * side - full.shape[0])
        padded = torch.nn.functional.pad(full, margins)
        return padded.reshape(rows, side, columns, side).mean(dim=(1, 3))

    @functools.cached_property
    def uneven_amplitude(self) -> torch.Tensor | None:
        """The superpixels' amplitude, or None if it is even."""
        amplitude = self.amplitude
        return None if bool((amplitude == amplitude.flatten()[0]).all()) else amplitude

    @functools.cached_property
    def target_intensity(self) -> torch.Tensor:
        """Return the target scaled to all light of the superpixels, (rows, columns) float32."""
        power = float(self.amplitude.double().square().sum()) * self.far_field.length**2
        target = self.goal.target
        return (target / target.sum() * power).to(torch.float32)

    def positions(self, axis: int) -> torch.Tensor:
        """Return the superpixels' centres along an axis, in pixels from the panel's centre."""
        n = self.shape[axis]
        middle = (self.goal.camera.panel.shape[axis] - 1) / 2
        index = torch.arange(n, dtype=torch.float64) * self.side + (self.side - 1) / 2
        return index - middle

    def panel_field(self, phase: torch.Tensor) -> torch.Tensor:
        """Return the field of the superpixels for a phase, (…, rows, columns) complex64."""
        return torch.polar(self.amplitude.expand(phase.shape), phase.to(torch.float32))

    def to_superpixel_origin(self, window: torch.Tensor, sign: int = 1) -> torch.Tensor:
        """Move the panel origin of the window's field from the first pixel to the superpixel.

        The centre of the first superpixel is (side - 1) / 2 pixels from the first pixel. sign: -1
        moves the origin back.
        """
        y, x = (
            sign
            * math.pi
            * (self.side - 1)
            / self.goal.far_field_samples
            * (torch.arange(n, dtype=torch.float64) - n // 2)
            for n in self.goal.plane.shape
        )
        both = y[:, None] + x
        return window * torch.polar(torch.ones_like(both), both).to(torch.complex64)

    def pixel_phases(self, window: torch.Tensor) -> torch.Tensor:
        """Return the phases of all panel pixels for fields on the window, float32.

        The phases are (…, rows, columns). They are exact, since the panel's field of a window is
        band-limited, and is evaluated at every pixel.
        """
        fields = self.to_superpixel_origin(window, -1).reshape(-1, *self.goal.plane.shape)
        # The frames are transformed one by one, because the padded spectra of many frames would
        # need too much memory.
        phases = torch.stack([torch.angle(self.goal.far_field.adjoint(field)) for field in fields])
        return phases.reshape(*window.shape[:-2], *self.goal.camera.panel.shape)


def coarsest_superpixels(goal: RetrievalGoal) -> Superpixels:
    """Return the largest superpixels that represent a goal's window without loss."""
    return Superpixels(goal, superpixel_side(goal))


STARTS = ("smooth", "quadratic", "random")
"""Names of the phases that iterations can start from."""


def quadratic_start(pixels: Superpixels) -> torch.Tensor:
    """Return a quadratic phase, (rows, columns) of the superpixels, that lights all of the target.

    Fewer vortices, and so fewer speckles, develop from it than from a random phase (a spherical
    start: Appl. Phys. Lett. 120, 061103, 2022).
    """
    goal = pixels.goal
    support = goal.target > 0.5 * goal.target.max()
    bends = []
    for axis, side in enumerate(goal.camera.panel.shape):
        n = goal.plane.shape[axis]
        index = torch.arange(n) - n // 2
        extent = float(index[support.any(dim=1 - axis)].abs().max())
        # At the panel's edge, the slope of the phase steers light to `extent` samples.
        x = pixels.positions(axis)
        bends.append(math.pi * extent / (goal.far_field_samples * side / 2) * x**2)
    return bends[0][:, None] + bends[1][None, :]


def random_start(pixels: Superpixels, generator: torch.Generator) -> torch.Tensor:
    """Return a phase that is uniform over one wave in every superpixel, as in the thesis."""
    return torch.rand(pixels.shape, generator=generator, dtype=torch.float64) * 2 * math.pi


def smooth_start(pixels: Superpixels, generator: torch.Generator) -> torch.Tensor:
    """Return the quadratic phase plus a smooth random one, which differs from call to call.

    A start without symmetry leads to less speckle. Frames that start from it have different speckle
    but similar phases, which a slow liquid crystal can follow.
    """
    noise = torch.randn(pixels.shape, generator=generator, dtype=torch.float64)
    # The random phase is blurred by a Gaussian over a twelfth of the panel's height, with periodic
    # borders, and its rms is half a radian.
    sigma = pixels.goal.camera.panel.shape[0] / 12 / pixels.side
    y = torch.fft.fftfreq(noise.shape[0], dtype=torch.float64)
    x = torch.fft.rfftfreq(noise.shape[1], dtype=torch.float64)
    low = torch.exp(-2 * (math.pi * sigma) ** 2 * (y[:, None] ** 2 + x**2))
    smooth = torch.fft.irfft2(torch.fft.rfft2(noise) * low, s=noise.shape)
    return quadratic_start(pixels) + 0.5 * smooth / smooth.std(correction=0).clamp(min=1e-12)


def require_start(start: str) -> None:
    """Raise ValueError for a start that isn't one of STARTS."""
    if start not in STARTS:
        raise ValueError(f"start is {start!r}; choose one of {', '.join(STARTS)}")


def starting_field(pixels: Superpixels, start: str, generator: torch.Generator) -> torch.Tensor:
    """Return the field on the superpixels from which a frame starts, one of STARTS, complex64."""
    require_start(start)
    if start == "random":
        return pixels.panel_field(random_start(pixels, generator))
    if start == "smooth":
        return pixels.panel_field(smooth_start(pixels, generator))
    return pixels.panel_field(quadratic_start(pixels))


@dataclass(frozen=True)
class RetrievalJob:
    """One problem with all that a method needs to solve it; `start` is one of STARTS."""

    goal: RetrievalGoal
    frames: int
    iterations: int
    generator: torch.Generator
    progress: Progress
    start: str

    @property
    def frame_progress(self) -> list[Progress]:
        """Return one progress for each frame, for methods that compute them in turn."""
        ends = [n / self.frames for n in range(self.frames + 1)]
        return [self.progress.part(start, stop) for start, stop in pairwise(ends)]
