"""PSFs and OTFs behind one pattern from half a metre to infinity, where digits run out."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import torch
from judges import by_panel, richardson
from judges.depths import by_points
from judges.view import View
from numpy.typing import NDArray

from hard_cases.table import (
    SINGLE,
    Agrees,
    Case,
    Holds,
    Seen,
    Slope,
    require_close,
)
from optics.camera import Camera, Lens, Panel, Sensor
from optics.edof import FullTransfer, QuarterTransfer, TransferDesign
from optics.psf import PSFStack
from optics.slm import phase_to_grey

WAVELENGTH = 520e-9
CAMERA = Camera(
    Panel((24, 32), 160e-6, 0.81, unmodulated=0.0),
    Lens(0.1, 5.6, math.inf),
    Sensor((20, 21), 3.45e-6),
)
"""The thesis' lens, wider than the panel. At half a metre its corner is 20 waves out of focus."""

PIXELS = CAMERA.sensor.window_plane((4, 5), centre=(2e-5, -1e-5))
RNG = np.random.default_rng(7)
DEEP = RNG.uniform(0, 2 * np.pi * 3000, CAMERA.panel.shape).astype(np.float32)
"""Phases of up to 3000 waves: a unit in the last place is a thousandth of a radian."""

DIRECTION = RNG.normal(size=CAMERA.panel.shape)
DISTANCES = (0.5, 2.0, 50.0)
DIOPTRES = (0.0, 0.02, 0.5, 2.0)
BITS = (1e-5, 1e-10)
"""Tolerances of OTFs that are computed in single and in double precision."""

KINDS = {"a quarter of a panel": QuarterTransfer, "a whole panel": FullTransfer}


def view(distance: Any, pattern: Any = DEEP) -> View:
    return View(CAMERA, PIXELS, distance, WAVELENGTH, phase=pattern)


def moved(t: Any, base: NDArray[Any] = DEEP, direction: NDArray[Any] = DIRECTION) -> Any:
    """A pattern in double precision, and a share t of another one; a tensor if t is one."""
    base = base.astype(np.float64)
    if isinstance(t, torch.Tensor):
        return torch.from_numpy(base) + t * torch.from_numpy(direction)
    return base + t * direction


def types_agree(tol: float) -> None:
    """The same numbers in both types: the same light, and gradients that differ by rounding."""
    found = []
    for dtype in (torch.float32, torch.float64):
        phase = torch.from_numpy(DEEP).to(dtype).requires_grad_()
        light = view(0.5).operator(tol)(phase)
        (light.double() ** 2).sum().backward()
        assert phase.grad is not None
        assert phase.grad.dtype == dtype
        found.append((light.detach(), phase.grad.double()))
    require_close(found[0][0], found[1][0], 1e-12)
    require_close(found[0][1], found[1][1], 1e-6)


# Transfer functions

SIZE, REACH = 16, 20


def design(camera: Camera = CAMERA, **settings: Any) -> TransferDesign:
    settings = {"reach": REACH, "fast": False} | settings
    return TransferDesign(camera, WAVELENGTH, SIZE, **settings)


def complex_of(tol: float) -> torch.dtype:
    """The type that a tolerance asks for."""
    return torch.complex64 if tol > 1e-7 else torch.complex128


def transfer_of(kind: Any, tol: float, camera: Camera = CAMERA, **settings: Any) -> Any:
    return kind(design(camera, **settings), complex_of(tol))


def own_part(kind: Any, whole: Any) -> Any:
    """What a kind of transfer takes of an array on the whole panel."""
    rows, columns = whole.shape
    return whole[rows // 2 :, columns // 2 :] if kind is QuarterTransfer else whole


def whole_panel(kind: Any, part: Any) -> NDArray[np.float64]:
    """The pattern on the whole panel, by joining mirror images."""
    if kind is FullTransfer:
        return np.asarray(part)
    half = np.concatenate([part[::-1], part], 0)
    return np.concatenate([half[:, ::-1], half], 1)


def summed(kind: Any, part: Any, camera: Camera = CAMERA, reach: int = REACH) -> NDArray[Any]:
    """OTFs at all depths by direct sums; of a quarter, about its own middle."""
    middle = -0.5 if kind is QuarterTransfer else 0.0
    samples = np.arange(-reach, reach + 1.0)
    pattern = whole_panel(kind, part)
    found = np.stack(
        [by_points(camera, WAVELENGTH, pattern, d, samples, SIZE, middle) for d in DIOPTRES]
    )
    return found[:, : SIZE // 2 + 1].real if kind is QuarterTransfer else found


WEIGHTS = np.random.default_rng(8).uniform(0, 1, (len(DIOPTRES), SIZE, SIZE // 2 + 1))


def contrast(transfers: Any) -> Any:
    """A weighted sum of squared moduli, of tensors and of arrays alike."""
    weights = WEIGHTS[:, : transfers.shape[1]]
    if isinstance(transfers, torch.Tensor):
        return (torch.from_numpy(weights) * transfers.abs().double() ** 2).sum()
    return (weights * np.abs(transfers) ** 2).sum()


def otfs(kind: Any, tol: float) -> Any:
    return transfer_of(kind, tol)(torch.from_numpy(own_part(kind, DEEP)), DIOPTRES)


def slope_of_transfers(kind: Any) -> Callable[[float], Any]:
    def ask(tol: float) -> torch.Tensor:
        phase = torch.from_numpy(own_part(kind, DEEP).copy()).requires_grad_()
        contrast(transfer_of(kind, tol)(phase, DIOPTRES)).backward()
        assert phase.grad is not None
        assert phase.grad.dtype == torch.float32
        return (phase.grad.double() * torch.from_numpy(own_part(kind, DIRECTION).copy())).sum()

    return ask


def slope_of_sums(kind: Any) -> Callable[[], Any]:
    def truth() -> Any:
        base, direction = (own_part(kind, a).astype(float) for a in (DEEP, DIRECTION))
        return richardson(lambda t: contrast(summed(kind, base + t * direction)), 0.0, 0.05)

    return truth


def beyond_a_wave(kind: Any) -> Callable[[float], None]:
    def law(tol: float) -> None:
        """Whole waves more, or wrapped into one: the same OTF, and the same gradient."""
        generator = torch.Generator().manual_seed(1)
        transfer = transfer_of(kind, tol)
        base = 2 * math.pi * torch.rand(transfer.shape, generator=generator, dtype=torch.float64)
        whole = torch.randint(-20, 21, base.shape, generator=generator).double()
        found = []
        for phase in (base, base + 2 * math.pi * whole):
            phase = phase.requires_grad_()
            value = transfer(phase, DIOPTRES)
            contrast(value).backward()
            assert phase.grad is not None
            found.append((value.detach(), phase.grad))
        wrapped = torch.remainder(phase.detach(), 2 * math.pi)
        require_close(found[1][0], found[0][0], tol)
        require_close(found[1][1], found[0][1], 10 * tol)
        assert float((found[1][1] == 0).double().mean()) == 0
        require_close(transfer(wrapped, DIOPTRES), found[0][0], tol)

    return law


def exported(tol: float) -> None:
    """Wrapped and kept in single precision, as in a file: the judge's PSF, and the same levels."""
    unwrapped = torch.from_numpy(DEEP).double()
    kept = torch.remainder(unwrapped, 2 * math.pi).float()
    near = view(0.5)
    require_close(near.operator(tol)(kept), by_panel(near), tol)
    levels = [phase_to_grey(CAMERA.panel, one, WAVELENGTH) for one in (unwrapped, kept.double())]
    # Halfway between two levels, single precision may decide for the other one.
    assert int((levels[0] != levels[1]).sum()) <= 1


def moved_out_of_the_window(tol: float) -> None:
    """Each ring of samples adds its light; the OTF at zero frequency is the light that is in."""
    pattern, within = DEEP.astype(np.float64), []
    for reach in (2, 8, 20):
        samples = np.arange(-reach, reach + 1.0)
        transfer = transfer_of(FullTransfer, tol, reach=reach)
        found = transfer(torch.from_numpy(DEEP), (2.0,))[0, 0, 0]
        light = by_points(CAMERA, WAVELENGTH, pattern, 2.0, samples, SIZE)[0, 0]
        require_close(found.real, light.real, tol)
        within.append(float(found.real))
    assert 0 < within[0] < within[1] < within[2] < 0.5


# From infinity to half a metre at once


def stacked(tol: float) -> None:
    """Each PSF as its judge has it; and the gradient is the sum of both."""
    stack = PSFStack(CAMERA, (math.inf, 0.5), (WAVELENGTH,), PIXELS, tol=tol)
    phase = torch.from_numpy(DEEP).double().requires_grad_()
    light = stack(phase)[:, 0, 0]
    for one, distance in zip(light, (math.inf, 0.5), strict=True):
        require_close(one, by_panel(view(distance)), tol)
    (light.double() ** 2).sum().backward()
    total = torch.zeros_like(phase)
    for distance in (math.inf, 0.5):
        alone = phase.detach().clone().requires_grad_()
        (view(distance).operator(tol)(alone).double() ** 2).sum().backward()
        assert alone.grad is not None
        total += alone.grad
    assert phase.grad is not None
    require_close(phase.grad, total, 30 * tol)


CASES: list[Case] = [
    *(
        Seen(f"3000 waves, an object at {d:g} m",
             "k r is 1e7 rad, whose unit in single precision is a radian", view(d), by_panel)
        for d in DISTANCES
    ),
    *(
        Slope(f"the derivative in 3000 waves, an object at {d:g} m",
              "the gradient goes through the same phases", lambda t, d=d: view(d, moved(t)),
              0.0, 0.5, by_panel)
        for d in DISTANCES
    ),
    Holds("3000 waves in both types", "a phase that is divided by 2 pi in single precision loses "
          "a thousandth of a radian", "float32 and float64 of the same value", types_agree,
          "each other"),
    *(
        Agrees(f"OTFs of 3000 waves, {name}", "one call from infinity, 0 dioptres, to half a metre",
               "0, .02, .5 and 2 dioptres, phases in float32",
               partial(otfs, kind), partial(summed, kind, own_part(kind, DEEP)), "direct sums",
               tols=BITS)
        for name, kind in KINDS.items()
    ),
    *(
        Agrees(f"the derivative of OTFs of 3000 waves, {name}",
               "the gradient of all depths is one sum", "0, .02, .5 and 2 dioptres",
               slope_of_transfers(kind), slope_of_sums(kind), "differences of direct sums",
               # The gradient is returned in the phase's own type, float32.
               tols=(1e-4, 1e-6))
        for name, kind in KINDS.items()
    ),
    Holds("infinity and half a metre in one stack", "infinity is no distance to divide by",
          "∞ and 0.5 m", stacked, "Gauss-Legendre over every pixel"),
    *(
        Holds(f"phases beyond one wave, {name}",
              "clipped to one wave, a pixel has no gradient and freezes",
              "up to 20 waves more or less, and wrapped", beyond_a_wave(kind), "one wave",
              tols=BITS)
        for name, kind in KINDS.items()
    ),
    Holds("a wrapped pattern in a file", "3000 waves of it are forgotten", "modulo 2 pi, float32",
          exported, "Gauss-Legendre, unwrapped", tols=(SINGLE, 1e-6)),
    Holds("light beyond the window", "a window that is normalised to 1 promises light that is "
          "lost", "2, 8 and 20 pixels to the border", moved_out_of_the_window, "direct sums",
          tols=BITS),
]  # fmt: skip
