"""Compute the PSFs of what stands in the pupil, with which captures are made, on their pixels."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import torch

from optics.camera import Camera
from optics.edof.dioptres import metres_from_dioptres, require_dioptres
from optics.edof.protocol import EdofProtocol
from optics.fourier import rfft2
from optics.plane import Plane, origin_to_corner
from optics.psf import PSFStack
from optics.quarter_symmetry import crop_quarter
from optics.slm.panel import Panel
from optics.threads import in_full_precision
from optics.validation import require_count, require_finite, require_positive

STOP_DIAMETERS = (1e-3, 2e-3, 4e-3)
"""Diameters in metres of the round stops that every evaluation compares patterns with."""


@dataclass(frozen=True, eq=False)
class PupilPattern:
    """A pattern in the pupil: phase, and amplitude where light is blocked.

    Parameters
    ----------
    name : str
        Name in tables.
    phase : torch.Tensor, (rows, columns), optional
        Radians on the panel's pixels; zero by default.
    amplitude : torch.Tensor, (rows, columns), optional
        Amplitude transmittance of the panel's pixels, 0 to 1; one by default.

    Raises
    ------
    ValueError
        If values aren't finite, an amplitude isn't within 0 to 1, or it blocks all light.
    """

    name: str
    phase: torch.Tensor | None = None
    amplitude: torch.Tensor | None = None

    def __post_init__(self) -> None:
        if self.phase is not None:
            require_finite("phase", self.phase)
        if self.amplitude is None:
            return
        require_finite("amplitude", self.amplitude)
        low, high = float(self.amplitude.min()), float(self.amplitude.max())
        if not (low >= 0 and 0 < high <= 1):
            raise ValueError(
                f"amplitude goes from {low:g} to {high:g}; it must lie within 0 to 1, and pass "
                "light somewhere"
            )


def collected_share(pattern: PupilPattern, camera: Camera) -> float:
    """Return the share of the open pupil's light that a pattern collects; a phase alone: 1.

    The pupil is what the panel and the lens' stop both pass, as if they stood in one plane. Raises
    ValueError if the pattern has another shape than the panel, or passes no light within the stop.
    """
    panel = camera.panel
    for name in ("phase", "amplitude"):
        given = getattr(pattern, name)
        if given is not None and tuple(given.shape) != panel.shape:
            raise ValueError(
                f"{name} of {pattern.name} is {tuple(given.shape)}; the panel has {panel.shape}"
            )
    if pattern.amplitude is None:
        return 1.0
    open_pupil = _disc(panel, camera.lens.stop_diameter)
    power = pattern.amplitude.to(torch.float64).square() * open_pupil
    share = float(power.sum() / open_pupil.sum())
    if not share > 0:
        raise ValueError(f"amplitude of {pattern.name} passes no light within the lens' stop")
    return share


def round_stop(panel: Panel, diameter: float) -> PupilPattern:
    """Return a round hole without phase, made of whole panel pixels.

    Parameters
    ----------
    panel : Panel
        The panel whose pixels it covers.
    diameter : float
        Metres.

    Returns
    -------
    PupilPattern
        The hole, centred on the axis.

    Raises
    ------
    ValueError
        If the diameter isn't positive, or less than two pixels.
    """
    require_positive("diameter", diameter, "m")
    if diameter < 2 * panel.pitch:
        raise ValueError(
            f"diameter is {diameter:g} m; whole pixels make no hole of that size: give "
            f"{2 * panel.pitch:g} m at least"
        )
    inside = _disc(panel, diameter)
    return PupilPattern(f"stop {diameter * 1e3:g} mm", amplitude=inside.to(torch.float32))


def _disc(panel: Panel, diameter: float) -> torch.Tensor:
    """Return 1 for the panel's pixels whose centres lie in a round hole, else 0, float64."""
    y, x = panel.plane.mesh()
    return (y**2 + x**2 <= (0.5 * float(diameter)) ** 2).to(torch.float64)


PSFSource = Callable[[PupilPattern, Sequence[float]], torch.Tensor]
"""Computes PSFs (depths, rows, columns) of a pattern at depths in dioptres.

They are in the protocol's window at full resolution, as shares of the open pupil's light.
"""

_TOLERANCE = 1e-3  # largest relative L2 error of a PSF from sampling and arithmetic. Chosen.

ENERGY_TOLERANCE = 4e-2
"""Relative amount by which a PSF may sum to more than the light that its pattern collects.

A PSF that is sampled at pixels' centres sums to its transfer function at zero frequency and at
whole cycles per pixel. The full aperture of 15.36 mm passes one cycle per 3.45 um at 520 nm with a
modulation of up to 1.9 %, for both signs of it.
"""


@dataclass(frozen=True, eq=False)
class DepthPSFs:
    """The PSFs of a pattern at several depths, and how much of its light they hold."""

    dioptres: tuple[float, ...]
    kernels: torch.Tensor
    """PSFs on detector pixels with the origin at n // 2, (depths, rows, columns), float32, relative
    to the light that the pattern collects: a sum of 1 means that none is lost."""
    collected: float
    """Share of the open pupil's light that the pattern collects."""
    energies: tuple[float, ...]
    """Sums of the kernels."""
    expected_energies: tuple[float, ...] | None = None
    """Energies from a computation that is known to keep light, where there is one."""
    are_measured: bool = False
    """Whether the PSFs were handed in instead of computed."""


class CameraPSFs:
    """Computes the protocol's PSFs of patterns in a camera; a source of PSFs for an evaluation.

    The panel's unmodulated share is included. Stacks of PSFs are planned once for the same depths,
    and shorter ones for patterns that equal their mirror images in both axes.
    """

    def __init__(self, camera: Camera, protocol: EdofProtocol) -> None:
        self._camera, self._protocol = camera, protocol
        self._stacks: dict[tuple[tuple[float, ...], str], PSFStack] = {}

    def __call__(self, pattern: PupilPattern, dioptres: Sequence[float]) -> torch.Tensor:
        """Compute the PSFs (depths, rows, columns) of a pattern at depths in dioptres.

        They are shares of the open pupil's light, at full resolution.
        """
        phase, amplitude, symmetry = pattern.phase, pattern.amplitude, "none"
        if phase is not None and amplitude is None and _is_mirrored(phase):
            phase, symmetry = crop_quarter(phase), "quarter"
        stack = self._stack(tuple(float(one) for one in dioptres), symmetry)
        with torch.no_grad():
            return stack(phase, amplitude)[:, 0, 0]

    def _stack(self, dioptres: tuple[float, ...], symmetry: str) -> PSFStack:
        """Plan the PSFs for depths in dioptres, or take the plan that was made before."""
        if (dioptres, symmetry) not in self._stacks:
            protocol = self._protocol
            pitch, side = protocol.pixel_pitch, protocol.psf_window
            self._stacks[dioptres, symmetry] = PSFStack(
                self._camera,
                metres_from_dioptres(dioptres),
                [protocol.wavelength],
                Plane((side, side), (pitch, pitch)),
                integrate=protocol.pixel_response == "area",
                symmetry=symmetry,
                tol=_TOLERANCE,
            )
        return self._stacks[dioptres, symmetry]


def _is_mirrored(phase: torch.Tensor) -> bool:
    """Tell whether a phase equals its mirror images in both axes bit for bit."""
    return all(torch.equal(phase, phase.flip(axis)) for axis in (0, 1))


def compute_depth_psfs(
    pattern: PupilPattern,
    dioptres: Sequence[float],
    camera: Camera,
    protocol: EdofProtocol,
    source: PSFSource | None = None,
) -> DepthPSFs:
    """Compute the PSFs with which scenes behind a pattern are captured, and their energies.

    The source is `CameraPSFs` by default. Raises ValueError if a depth or the pattern is invalid,
    or the PSFs hold more light than the pattern collects.
    """
    require_dioptres("dioptres", dioptres)
    collected = collected_share(pattern, camera)
    found = (source or CameraPSFs(camera, protocol))(pattern, dioptres)
    return _account_for_light(found, dioptres, collected, protocol)


def measured_depth_psfs(
    psfs: torch.Tensor,
    dioptres: Sequence[float],
    collected: float,
    protocol: EdofProtocol,
    expected_energies: Sequence[float] | None = None,
) -> DepthPSFs:
    """Take measured PSFs into a protocol, after checking how much light they hold.

    Raises ValueError if shapes or numbers are invalid, or the PSFs hold more light than is
    collected.

    psfs: PSFs at full resolution with the origin at n // 2, (depths, rows, columns), as shares of
        the open pupil's light. They mustn't be normalised to a sum of 1, because light beyond the
        window is lost.
    collected: share of the open pupil's light that the pattern collects, above 0 and up to 1.
    expected_energies: share of the collected light that each PSF should hold in its window, for
        instance that of computed PSFs in a window of the same size. Without it, an evaluation can
        only estimate whether the PSFs were normalised.
    """
    require_dioptres("dioptres", dioptres)
    if not 0 < collected <= 1:
        raise ValueError(f"collected is {collected:g}; it is a share, above 0 and up to 1")
    found = _account_for_light(psfs, dioptres, collected, protocol)
    expected = None
    if expected_energies is not None:
        expected = tuple(float(one) for one in expected_energies)
        if len(expected) != len(found.energies):
            raise ValueError(
                f"expected_energies has {len(expected)} values; give one for each of the "
                f"{len(found.energies)} depths"
            )
    return replace(found, expected_energies=expected, are_measured=True)


def _account_for_light(
    psfs: torch.Tensor, dioptres: Sequence[float], collected: float, protocol: EdofProtocol
) -> DepthPSFs:
    """Check the light of PSFs at full resolution, and bring them to detector pixels."""
    if psfs.ndim != 3 or psfs.shape[0] != len(dioptres):
        raise ValueError(
            f"psfs is {tuple(psfs.shape)}; give (depths, rows, columns) for {len(dioptres)} depths"
        )
    require_finite("psfs", psfs)
    if max(psfs.shape[-2:]) > protocol.psf_window:
        raise ValueError(
            f"psfs is {tuple(psfs.shape)}; the protocol's window has {protocol.psf_window} pixels "
            "along a side"
        )
    sums = [float(one.sum(dtype=torch.float64)) / collected for one in psfs]
    for depth, energy in zip(dioptres, sums, strict=True):
        if not 0 < energy <= 1 + ENERGY_TOLERANCE:
            raise ValueError(
                f"psfs hold {energy:.4g} of the collected light at {depth:g} dioptres; give shares "
                "of the open pupil's light, which sum to 1 at most"
            )
    kernels = torch.stack([bin_psf(one, protocol.binning) for one in psfs])
    kernels = (kernels / collected).to(torch.float32)
    depths = tuple(float(one) for one in dioptres)
    return DepthPSFs(depths, kernels, collected, tuple(sums))


@in_full_precision
def bin_psf(psf: torch.Tensor, binning: int) -> torch.Tensor:
    """Compute the PSF on detector pixels that are squares of finer pixels.

    The scene is constant over a detector pixel, and the image's mean over it is captured. Together
    they weigh the finer PSF by a triangle along each axis, sampled once a detector pixel. The
    result has the same sum, odd numbers of rows and columns, and its origin at n // 2, as the PSF
    on the finer pixels. Raises ValueError if the binning is below 1.
    """
    require_count("binning", binning)
    if binning == 1:
        return psf
    step = torch.arange(1 - binning, binning, dtype=psf.dtype)
    triangle = (binning - step.abs()) / binning
    for dim in (0, 1):
        psf = _weigh_and_sample(psf.movedim(dim, -1), triangle, binning).movedim(-1, dim)
    return psf


def _weigh_and_sample(psf: torch.Tensor, weights: torch.Tensor, step: int) -> torch.Tensor:
    """Correlate the last axis of a PSF with odd weights, and keep every `step`-th value.

    The origin, at n // 2, is kept.
    """
    n, reach = psf.shape[-1], step - 1
    most = (n // 2 + reach) // step
    left = most * step + reach - n // 2
    right = most * step + reach + 1 + n // 2 - n
    padded = torch.nn.functional.pad(psf, (left, max(right, 0)))
    rows = torch.nn.functional.conv1d(padded[:, None], weights[None, None], stride=step)[:, 0]
    return rows[:, : 2 * most + 1]


def compute_transfer(kernel: torch.Tensor, shape: tuple[int, int]) -> torch.Tensor:
    """Compute the transfer function of a PSF for pictures that are periodic.

    A PSF that is larger than the period, `shape`, is folded into it, so that no light is lost. The
    result is (rows, columns // 2 + 1), complex, on the grid of rfft2.

    kernel: PSF with its origin at n // 2, (rows, columns).
    """
    for dim, period in enumerate(shape):
        kernel = _fold(kernel.movedim(dim, -1), period).movedim(-1, dim)
    return rfft2(origin_to_corner(kernel.contiguous()))


def _fold(kernel: torch.Tensor, period: int) -> torch.Tensor:
    """Add up samples of a PSF's last axis that lie whole periods apart; the origin is at n // 2."""
    n = kernel.shape[-1]
    before = -(-max(n // 2 - period // 2, 0) // period) * period + period // 2 - n // 2
    after = -(before + n) % period
    padded = torch.nn.functional.pad(kernel, (before, after))
    return padded.reshape(*padded.shape[:-1], -1, period).sum(-2)
