"""Phase retrieval: targets, panels and videos at the edge of what can be asked for."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import torch
from judges import positions, relative
from judges.view import WAVELENGTH
from numpy.typing import NDArray

from hard_cases.table import ONCE, Case, Holds, Refused, require_close, require_finite
from optics.camera import Camera, Lens, Panel
from optics.camera.stop import Stop, rectangle
from optics.retrieval import METHODS, RetrievalResult, design_plane, retrieve, window_for_reach
from optics.retrieval.descent import GradientDescent
from optics.retrieval.far_field import FarField, unit_modulus
from optics.retrieval.frame_averaging import correct_request
from optics.retrieval.gerchberg_saxton import (
    amplitude_constraint,
    mixed_region_constraint,
    over_compensated_constraint,
)
from optics.retrieval.goal import RetrievalGoal, far_field_length
from optics.retrieval.slow_crystal import displayed_psf, shortest_phase_paths
from optics.retrieval.superpixel import Superpixels
from optics.slm import PanelMap

Array = NDArray[Any]

PITCH = 40e-6
SMALL = (24, 32)


def camera(shape: tuple[int, int] = SMALL, lens: Lens | None = None, **panel: Any) -> Camera:
    return Camera(Panel(shape, PITCH, **panel), lens or Lens())


def solved(
    method: str | None, target: Array, optics: Camera | None = None, **options: Any
) -> RetrievalResult:
    optics = optics or camera()
    generator = torch.Generator().manual_seed(1)
    frames = METHODS[method].min_frames if method else 1
    given = {"iterations": 4, "generator": generator, "frames": frames, **options}
    plane = design_plane(optics, WAVELENGTH, target.shape)
    return retrieve(optics, target, plane, WAVELENGTH, method=method, **given)


def every_way(target: Array, optics: Camera | None = None, **options: Any) -> dict[str, Array]:
    """Phases (frames, rows, columns) by every method; spots' own only where there are some."""
    found = {}
    for name in METHODS:
        if name == "weighted" and np.count_nonzero(target) > 4:
            continue
        phases = solved(name, target, optics, **options).phases
        require_finite(phases)
        found[name] = phases.double().numpy()
    return found


def ring(shape: tuple[int, int], radius: float, width: float = 2.0) -> Array:
    y, x = positions(shape[0], 1.0)[:, None], positions(shape[1], 1.0)[None, :]
    return np.exp(-((np.hypot(y, x) - radius) ** 2) / (2 * width**2))


def one_sample(shape: tuple[int, int], y: int, x: int) -> Array:
    target = np.zeros(shape)
    target[shape[0] // 2 + y, shape[1] // 2 + x] = 3.0
    return target


def share_at(phase: Array, length: int, y: int, x: int, amplitude: Array | float = 1.0) -> float:
    """Of the light that a blaze would send to a sample: |sum|² over the sum of amplitudes²."""
    rows, columns = (np.arange(n) for n in phase.shape)
    turn = -2 * np.pi * (rows[:, None] * y + columns * x) / length
    amplitude = np.broadcast_to(amplitude, phase.shape)
    return float(abs((amplitude * np.exp(1j * (phase + turn))).sum() / amplitude.sum()) ** 2)


def on_target(phases: Array, optics: Camera, target: Array, stop: Array | float = 1.0) -> float:
    """Share of all light where the target exceeds 2 % of its peak, by whole FFTs."""
    length, seen = far_field_length(optics), np.zeros(target.shape)
    for phase in phases:
        field = np.zeros((length, length), dtype=complex)
        field[: phase.shape[0], : phase.shape[1]] = stop * np.exp(1j * phase)
        far = np.abs(np.fft.fftshift(np.fft.fft2(field))) ** 2 / (np.abs(field) ** 2).sum()
        first = [length // 2 - n // 2 for n in target.shape]
        part = [slice(k, k + n) for k, n in zip(first, target.shape, strict=True)]
        seen += far[part[0], part[1]] / (length**2 * len(phases))
    return float(seen[target > 0.02 * target.max()].sum())


# Targets


def a_window_of_one_sample(tol: float) -> None:
    """All light to the axis: a constant phase."""
    for phases in every_way(np.ones((1, 1))).values():
        for phase in phases:
            assert share_at(phase, 64, 0, 0) > 1 - 1e-6


def a_single_lit_sample(tol: float) -> None:
    """A blazed grating."""
    for phases in every_way(one_sample((16, 20), 4, -6), iterations=20).values():
        assert min(share_at(phase, 64, 4, -6) for phase in phases) > 0.85


def at_the_windows_edge(tol: float) -> None:
    """Its first row and column, from which an odd and an even window turn otherwise."""
    for shape in ((16, 20), (17, 21)):
        y, x = -(shape[0] // 2), -(shape[1] // 2)
        for name in ("over-compensated", "weighted", "joint"):
            phases = solved(name, one_sample(shape, y, x)).phases.double().numpy()
            assert share_at(phases[0], 64, y, x) > 0.95


def at_the_end_of_the_far_field(tol: float) -> None:
    """The finest grating that the pixels make: phases of 0 and pi in turn."""
    target = one_sample((64, 64), -32, -32)
    for name in ("gerchberg-saxton", "over-compensated", "joint"):
        phases = solved(name, target).phases.double().numpy()
        squares = np.pi * (np.indices(SMALL).sum(0) % 2)
        assert np.abs(np.exp(1j * (phases[0] - squares)).mean()) > 0.99


def lit_all_over(tol: float) -> None:
    """A tenth of the far field, evenly: nothing is dark, so that nothing is free."""
    target = np.ones((20, 20))
    for phases in every_way(target).values():
        assert on_target(phases, camera(), target) > 0.5


def far_apart(tol: float) -> None:
    """A spot beside one of a millionth of a millionth of its light."""
    target = one_sample((16, 20), 5, -7) + 1e-12 * one_sample((16, 20), -6, 3)
    for name in ("over-compensated", "joint", "sequential", "weighted", "descent"):
        phases = solved(name, target).phases.double().numpy()
        assert share_at(phases[0], 64, 5, -7) > 0.9


def any_scale(tol: float) -> None:
    """The same pattern."""
    target = ring((30, 40), 9)
    plain = every_way(target, iterations=2)
    for scale in (1e-30, 1e30, 1e-300, 1e300):
        for name, phases in every_way(scale * target, iterations=2).items():
            assert np.abs(np.exp(1j * phases) - np.exp(1j * plain[name])).mean() < 1e-2


# Panels


def odd_everywhere(tol: float) -> None:
    """Prime sides: superpixels reach beyond the panel, and no length is twice a side."""
    optics, target = camera((53, 97)), ring((43, 47), 14)
    for name, phases in every_way(target, optics, iterations=12).items():
        assert phases.shape[1:] == (53, 97)
        assert on_target(phases, optics, target) > (0.6 if name == "published" else 0.8)


def one_row(tol: float) -> None:
    """A line of pixels steers along itself."""
    optics = camera((1, 64))
    for y, x in ((0, 9), (0, -11)):
        for name in ("over-compensated", "weighted", "joint", "descent"):
            phases = solved(name, one_sample((1, 30), y, x), optics).phases.double().numpy()
            assert share_at(phases[0], 128, y, x) > 0.95


def one_pixel(tol: float) -> None:
    """There is nothing to choose, and nothing to divide by."""
    every_way(np.ones((2, 2)), camera((1, 1)), iterations=2)


def slit() -> tuple[Camera, Array]:
    """A stop of six rows of pixels and its open area; all other rows are covered."""
    half = 10 * PITCH
    stop = Stop(rectangle(2 * 3 * PITCH / half, 2 * 8 * PITCH / half))
    optics = camera(lens=Lens(f_number=0.125 / (2 * half), stop=stop))
    y, x = positions(24, 1.0)[:, None], positions(32, 1.0)[None, :]
    edge = [np.clip(reach + 0.5 - np.abs(at), 0, 1) for at, reach in ((y, 3), (x, 8))]
    return optics, edge[0] * edge[1]


def rows_in_the_dark(tol: float) -> None:
    """Light is steered by what is open; phases of the rest are finite, whatever they are."""
    optics, share = slit()
    assert (share.sum(1) == 0).sum() == 17
    target = one_sample((16, 20), 4, -6)
    for name, phases in every_way(target, optics, iterations=20).items():
        # Freedom lets light of a wide spot stay beside its middle.
        least = 0.6 if name == "mixed-region" else 0.8
        assert min(share_at(phase, 64, 4, -6, share) for phase in phases) > least


def a_pinhole(tol: float) -> None:
    """A stop within a single pixel: the Airy disc is wider than the far field."""
    optics = camera(lens=Lens(f_number=0.125 / 10e-6))
    for phases in every_way(ring((30, 40), 9), optics, iterations=2).values():
        require_finite(phases)


def lit_from_one_side(tol: float) -> None:
    """Half of the panel is dark: as good as a panel of the other half."""
    light = np.repeat([[1.0, 1.0, 0.0, 0.0]], 24, axis=0).repeat(8, axis=1)
    optics = camera(illumination=PanelMap(light))
    target = one_sample((16, 20), 5, -7)
    for name in ("over-compensated", "weighted", "joint", "descent"):
        phases = solved(name, target, optics).phases.double().numpy()
        assert share_at(phases[0], 64, 5, -7, light) > 0.95


# Fields and means of zero


def a_field_of_zero(tol: float) -> None:
    """It has no phase: it stays zero, and its pattern is finite."""
    dtype = torch.complex64 if tol > 1e-7 else torch.complex128
    optics, shape = camera(), (16, 20)
    goal = RetrievalGoal(
        optics, torch.ones(shape), design_plane(optics, WAVELENGTH, shape), WAVELENGTH
    )
    pixels = Superpixels(goal, 2)
    zero = torch.zeros(shape, dtype=dtype)
    assert not pixels.far_field.round_trip(zero, pixels.uneven_amplitude).any()
    require_finite(pixels.pixel_phases(zero))
    target = pixels.target_intensity
    for constrain in (
        amplitude_constraint(target),
        over_compensated_constraint(target),
        mixed_region_constraint(target, 0.4),
    ):
        require_finite(torch.view_as_real(constrain(zero)))
    assert not unit_modulus(zero).any()


def a_mean_of_zero(tol: float) -> None:
    """Dark frames ask for the target again, and a target's dark part for nothing."""
    for scale in (1e-30, 1.0, 1e30):
        target = torch.from_numpy(scale * ring((16, 20), 5)).float()
        asked = correct_request(target, target, torch.zeros(16, 20))
        require_close(asked / scale, target / scale, 1e-5)
        half = target.clone()
        half[:, :10] = 0
        require_finite(correct_request(half, half, torch.zeros(16, 20)))
        require_finite(correct_request(target, target, half))


def flat_gradient(tol: float) -> None:
    """All phases equal: light on the axis alone, |0| everywhere else, and finite derivatives."""
    optics = camera(unmodulated=0.1, coupling=10e-6)
    plane = design_plane(optics, WAVELENGTH, (17, 20))
    descent = GradientDescent(RetrievalGoal(optics, torch.ones(17, 20), plane, WAVELENGTH))
    phase = torch.zeros(SMALL, requires_grad=True)
    light = descent.frame_intensity(phase)
    torch.sqrt(light[light > 0]).sum().backward()
    require_finite(phase.grad)
    dtype = torch.complex64 if tol > 1e-7 else torch.complex128
    field = torch.zeros(4, 5, dtype=dtype, requires_grad=True)
    FarField((4, 5), 12, (5, 3)).intensity(field).sum().backward()
    assert field.grad is not None
    assert not field.grad.any()


# Videos


def video_on(response_time: float) -> tuple[Array, Array, Array]:
    """The mean light of a video as it is shown, of its standing frames, and of its mean phase."""
    optics, shape = camera(response_time=response_time), (17, 20)
    goal = RetrievalGoal(
        optics, torch.ones(shape), design_plane(optics, WAVELENGTH, shape), WAVELENGTH
    )
    # On the panel's own levels: 5.4 pi at 633 nm, and so on; rounded the same by every reader.
    phases = torch.from_numpy(np.random.default_rng(0).uniform(0.1, 6.1, (3, *SMALL)))
    still = replace(goal, camera=camera())
    stand = displayed_psf(still, phases, 1)
    mean = displayed_psf(still, phases.mean(0, keepdim=True), 1)
    return tuple(each.numpy() for each in (displayed_psf(goal, phases, 1), stand, mean))


def crystal_far_quicker(tol: float) -> None:
    """Every frame stands at once."""
    for response_time in (1e-12, 1e-6):
        moving, standing, _ = video_on(response_time)
        require_close(moving, standing, 2e-3)


def crystal_far_slower(tol: float) -> None:
    """The panel shows the mean of all phases, but for the rounding of that mean to a level."""
    moving, standing, mean = video_on(1e6)
    assert relative(moving, mean) < 0.05
    assert relative(moving, standing) > 0.5


def a_still_video(tol: float) -> None:
    """The same phase in every frame, and at the range's very ends: no way is short or long."""
    turn = 2 * math.pi
    edge = torch.tensor([0.0, turn, -1e-17, turn - 1e-12, 6 * turn, 1e4 * turn + 1.0])
    for reach in (turn, 3 * turn, 3.35 * turn):
        ways = shortest_phase_paths(edge.double().repeat(4, 1)[:, None], reach)
        assert not ways.diff(dim=0).any()
        assert float(ways.min()) >= 0
        assert float(ways.max()) <= reach * (1 + 1e-6)
        turns = (ways[0, 0].double() - edge.double()) / turn
        # Single precision holds 1e4 waves to a thousandth.
        assert float((turns - turns.round()).abs().max()) < 1e-3


def law(
    name: str, why: str, given: str, function: Callable[[float], None], judge: str, **row: Any
) -> Holds:
    return Holds(name, why, given, function, judge, **{"tols": ONCE, **row})


def refused(
    name: str, why: str, given: str, ask: Callable[[], Any], words: str, remedy: Callable[[], Any]
) -> Refused:
    return Refused(name, why, given, ask, words, lambda tol: remedy())


RING = ring((30, 40), 9)
HOLED = np.where(RING.max() == RING, math.nan, RING)
DIPPED = RING - 1e-9


CASES: list[Case] = [
    law("a window of one sample", "an extent of zero, a start without curvature",
        "1x1, every method", a_window_of_one_sample, "a constant phase"),
    law("a target of a single lit sample", "all other amplitudes are exactly zero",
        "16x20, every method", a_single_lit_sample, "a blazed grating"),
    law("a spot on its window's first row and column", "n // 2 on one side, and not on the other",
        "16x20 and 17x21", at_the_windows_edge, "a blazed grating"),
    law("a spot at the far field's last sample", "plus and minus Nyquist are the same",
        "64x64 of 64", at_the_end_of_the_far_field, "squares of 0 and pi"),
    law("a target without a dark sample", "no freedom, no edge, no margin",
        "20x20 ones, every method", lit_all_over, "whole FFTs"),
    law("spots twelve orders of magnitude apart", "weights and ratios run over",
        "1 and 1e-12", far_apart, "a blazed grating"),
    law("a target of any scale", "sums and squares of float32 end at 1e38",
        "1e-300 to 1e300, every method", any_scale, "the pattern at scale one"),
    law("panel and window of prime sides", "superpixels reach beyond the last pixel",
        "53x97 and 43x47, every method", odd_everywhere, "whole FFTs"),
    law("a panel of one row", "a parabola over no height",
        "1x64", one_row, "a blazed grating"),
    law("a pattern of one pixel", "the deviation of a single number",
        "1x1, every method", one_pixel, "finite numbers"),
    law("rows that the stop covers", "nothing over nothing in every dark row",
        "a slit of 7 of 24 rows, every method", rows_in_the_dark, "a blazed grating"),
    law("a stop within a pixel", "one pixel has all the light",
        "f/12500, every method", a_pinhole, "finite numbers"),
    law("a panel lit from one side", "a target's light is counted over all pixels",
        "half of 24x32 dark", lit_from_one_side, "a blazed grating"),
    law("a field of zero between the transforms", "angle(0)",
        "16x20 zeros", a_field_of_zero, "zero", tols=(1e-3, 1e-8)),
    law("frames that leave the target dark", "target / mean",
        "a mean of zero", a_mean_of_zero, "the target"),
    law("the derivative where light vanishes", "|0| has none",
        "all phases equal", flat_gradient, "finite numbers", tols=(1e-3, 1e-8)),
    law("a liquid crystal far quicker than a frame", "exp(-frame / tau) is zero",
        "tau 1e-12 s", crystal_far_quicker, "standing frames"),
    law("a liquid crystal far slower than a video", "1 - exp(-frame / tau) cancels",
        "tau 1e6 s", crystal_far_slower, "the mean phase"),
    law("a video that doesn't move, next to whole waves", "rounding takes it to another order",
        "0, 2 pi, -1e-17, 1e4 waves", a_still_video, "no steps"),
    refused("NaN in a target", "one NaN makes every phase NaN", "1 of 1200",
            lambda: solved(None, HOLED), "target must be finite",
            lambda: solved(None, np.nan_to_num(HOLED)).phases),
    refused("a target that dips below zero", "the root of a negative intensity", "RING - 1e-9",
            lambda: solved(None, DIPPED), "nowhere negative",
            lambda: solved(None, DIPPED.clip(0)).phases),
    refused("a target without light", "nothing over nothing", "zeros",
            lambda: solved(None, 0 * RING), "somewhere positive",
            lambda: solved(None, one_sample((30, 40), 0, 0)).phases),
    refused("a panel without light", "0 / 0 in every figure of merit", "f/1e100",
            lambda: solved(None, RING, camera(lens=Lens(f_number=1e100))),
            "no light reaches the panel .*: open the stop",
            lambda: solved(None, RING, camera(lens=Lens(f_number=1e3))).phases),
    refused("a lit sample between those of the published program", "it disappears, and all phases",
            "16x20, one at (5, -7)", lambda: solved("published", one_sample((16, 20), 5, -7)),
            "target is dark on every second sample, .* choose another method",
            lambda: solved("gerchberg-saxton", one_sample((16, 20), 5, -7)).phases),
    refused("a target beyond the panel's reach", "light comes back from the other side",
            "5 mm from the axis", lambda: window_for_reach(camera(), WAVELENGTH, 5e-3),
            r"panel steers light to \S+ µm at most; choose a smaller one",
            lambda: solved(None, ring(window_for_reach(camera(), WAVELENGTH, 5e-4), 20)).phases),
    refused("a window larger than the far field", "indices wrap", "65x64 of 64",
            lambda: solved(None, np.ones((65, 64))), r"window is \(65, 64\); .* 64 samples at most",
            lambda: solved(None, np.ones((64, 64))).phases),
]  # fmt: skip
