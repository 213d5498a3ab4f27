"""Captures and decoders of several depths: light that is lost or missing, borders, draws."""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.integrate import quad

from hard_cases.depth_waves import CAMERA
from hard_cases.table import (
    DOUBLE,
    ONCE,
    SINGLE,
    Agrees,
    Case,
    Holds,
    Refused,
    require_close,
    require_finite,
    require_finite_gradient,
)
from optics.edof import (
    DEPTH_RANGE,
    PUBLISHED_DIOPTRES,
    EdofProtocol,
    PupilPattern,
    random_dioptres,
)
from optics.edof.decoders import extend_antisymmetrically
from optics.edof.dioptres import find_undrawn, stratified_dioptres
from optics.edof.evaluation import SceneBlur, add_noise
from optics.edof.protocol import NoiseRange, prepare_scene
from optics.edof.protocol_psfs import compute_depth_psfs, measured_depth_psfs, round_stop
from optics.edof.scoring import check_sampler

SIDE = 16
SMALL = EdofProtocol("small", psf_window=21, pixel_response="area", crop=SIDE, centre=8)
TRUE = SMALL.with_border("true")
RNG = np.random.default_rng(11)
SCENE = RNG.uniform(0, 1, (SIDE, SIDE))


def numbers(value: Any, tol: float) -> torch.Tensor:
    return torch.from_numpy(np.asarray(value)).to(torch.float32 if tol > 1e-7 else torch.float64)


# Depths that are drawn


def published_sampler() -> Callable[[], int]:
    """int(u (n - 1)), as it was published; u is below 1."""
    draw = random.Random(1).random
    return lambda: int(draw() * (len(PUBLISHED_DIOPTRES) - 1))


def half_a_metre_is_missed(tol: float) -> None:
    """The last depth of the list, half a metre, is named; a sound sampler isn't accused."""
    far_to_near = PUBLISHED_DIOPTRES[::-1]
    alarm = check_sampler(published_sampler(), far_to_near)
    assert alarm is not None
    assert alarm.kind == "undrawn"
    assert "never drawn: 2 dioptres" in alarm.message
    draw = random.Random(1).random
    assert check_sampler(lambda: int(draw() * len(far_to_near)), far_to_near) is None


def every_depth_is_drawn(tol: float) -> None:
    """A tenth of the range that is never drawn would be found."""
    generator, width = torch.Generator().manual_seed(1), DEPTH_RANGE[1] / 10
    for draw in (random_dioptres, stratified_dioptres):
        drawn = iter([d for _ in range(60) for d in draw(10, generator)])
        assert find_undrawn(lambda d=drawn: int(next(d) / width), 10) == ()


# Kernels and borders


def kernel_of(rows: int, columns: int) -> NDArray[np.float64]:
    kernel = np.random.default_rng(12).uniform(0, 1, (rows, columns))
    return 0.9 * kernel / kernel.sum()


LONG = kernel_of(41, 37)
"""More than twice as long as a capture."""


def circular(scene: NDArray[Any]) -> NDArray[np.float64]:
    total = np.zeros((SIDE, SIDE))
    for row, column in np.ndindex(*LONG.shape):
        total += LONG[row, column] * np.roll(scene, (row - 20, column - 18), (0, 1))
    return total


def long_kernel(tol: float) -> torch.Tensor:
    return SceneBlur(numbers(LONG, tol), SMALL)(numbers(SCENE, tol))


def slope_of_a_long_kernel(tol: float) -> torch.Tensor:
    scene = numbers(SCENE, tol).requires_grad_()
    blurred = SceneBlur(numbers(LONG, tol), SMALL)(scene)
    (blurred * numbers(SCENE[::-1].copy(), tol)).sum().backward()
    assert scene.grad is not None
    return scene.grad


def turned_sum() -> NDArray[np.float64]:
    """The adjoint of a circular sum is one with the kernel turned by 180 degrees."""
    total = np.zeros((SIDE, SIDE))
    for row, column in np.ndindex(*LONG.shape):
        total += LONG[row, column] * np.roll(SCENE[::-1], (20 - row, 18 - column), (0, 1))
    return total


# Lost light


def rectangle_share(window: int) -> float:
    """Light of the open panel in a square window, by integrals of squared sincs."""
    half, share = window / 2 * 3.45e-6, 1.0
    for pixels in CAMERA.panel.shape:
        reach = half * pixels * CAMERA.panel.pitch / (520e-9 * 0.1)
        share *= 2 * quad(lambda t: np.sinc(t) ** 2, 0, reach, limit=200)[0]
    return share


def light_is_kept_in_mind(tol: float) -> None:
    """The window's share, in the account, in the kernel and in the image of a white wall."""
    full = replace(CAMERA, panel=replace(CAMERA.panel, fill_factor=1.0))
    pattern = PupilPattern("open", torch.zeros(CAMERA.panel.shape))
    for window in (1, 5, 21):
        protocol = replace(SMALL, psf_window=window)
        psfs = compute_depth_psfs(pattern, (0.0,), full, protocol)
        wanted = rectangle_share(window)
        assert wanted < 0.99
        white = SceneBlur(psfs.kernels[0], protocol)(torch.ones(SIDE, SIDE))
        for found in (psfs.energies[0], float(psfs.kernels[0].sum()), float(white.mean())):
            assert abs(found - wanted) <= 2e-3


# Zeros


def photons_of_darkness(tol: float) -> None:
    """Neither noise nor a slope; where there is light, the root's slope."""
    for image in (np.zeros((4, 5)), np.full((4, 5), -0.1), np.full((4, 5), 0.25)):
        given = numbers(image, tol).requires_grad_()
        capture = add_noise(given, 0.1, 0.5, torch.Generator().manual_seed(1), shot_share=1.0)
        capture.sum().backward()
        require_finite(given.grad)
        normal = torch.randn((4, 5), generator=torch.Generator().manual_seed(1)).double().numpy()
        lit = np.maximum(image, 0)
        white = 0.1 / np.sqrt(0.5)
        require_close(capture, image + white * np.sqrt(lit) * normal, 1e-6)
        root = np.where(lit > 0, white * normal / (2 * np.sqrt(np.where(lit > 0, lit, 1))), 0)
        require_close(given.grad, 1 + root, 1e-6)


def extended_flatness(tol: float) -> None:
    """A constant goes on as itself; black stays black, without noise to average over."""
    for level in (0.0, 1e-30, 0.5, 1e6):
        flat = numbers(np.full((SIDE, SIDE), level), tol)
        for noise in (0.0, 0.05, 10.0):
            extended = extend_antisymmetrically(flat, (30, 32), noise)
            assert torch.allclose(extended, torch.full_like(extended, level), rtol=1e-5, atol=0)
            require_finite_gradient(
                lambda x, n=noise: extend_antisymmetrically(x, (30, 32), n), flat
            )


BLACK = PupilPattern("black", amplitude=torch.ones(CAMERA.panel.shape))
WINDOW = torch.full((1, 21, 21), 1 / 500)


def captured(deviation: float = 0.1, collected: float = 1.0) -> torch.Tensor:
    return add_noise(torch.ones(3, 3), deviation, collected, torch.Generator())


def grown(protocol: EdofProtocol) -> torch.Tensor:
    side = protocol.scene_side
    return SceneBlur(torch.from_numpy(kernel_of(21, 21)), protocol)(torch.rand(side, side))


CASES: list[Case] = [
    # Draws
    Holds("the last distance of a list", "int(u (n - 1)) leaves out half a metre, the hardest",
          "ten published distances", half_a_metre_is_missed, "an alarm that names it", tols=ONCE),
    Holds("depths at random", "a range without its ends", "600 draws of each kind",
          every_depth_is_drawn, "counting", tols=ONCE),
    # Kernels
    Agrees("a kernel longer than the image", "what is cropped to the image is light that is lost",
           "41x37 on 16x16, periodic", long_kernel, lambda: circular(SCENE),
           "a circular sum, place by place", tols=(1e-6, 1e-13)),
    Agrees("the derivative behind a kernel longer than the image", "its adjoint folds as well",
           "41x37 on 16x16, periodic", slope_of_a_long_kernel, turned_sum,
           "the sum with the kernel turned", tols=(1e-6, 1e-13)),
    Refused("a scene without a margin", "its image would wrap around", "16x16, a true border",
            lambda: SceneBlur(torch.from_numpy(kernel_of(21, 21)), TRUE)(torch.rand(SIDE, SIDE)),
            "with a true border and a crop of 16 the protocol needs 36 x 36",
            lambda _: grown(TRUE)),
    Refused("a photograph without a margin", "a border that is made up makes up detail",
            "30x40, a true border", lambda: prepare_scene(torch.rand(30, 40), TRUE.scene_side),
            "picture is 40 x 30 pixels; the scene needs 36 x 36: give a larger picture",
            lambda _: prepare_scene(torch.rand(36, 40), TRUE.scene_side)),
    Refused("a kernel beyond the margin", "its light would wrap around", "41x37, a true border",
            lambda: SceneBlur(torch.from_numpy(LONG), TRUE),
            "kernel reaches 20 pixels; the protocol's window allows 10",
            lambda _: grown(replace(TRUE, psf_window=41))),
    # Light
    Holds("a window narrower than the PSF", "normalised to 1, it promises light that is lost",
          "1, 5 and 21 pixels, a flat pattern", light_is_kept_in_mind,
          "integrals of squared sincs", tols=ONCE),
    Refused("PSFs without light", "0 / 0 of their energy", "zeros",
            lambda: measured_depth_psfs(0 * WINDOW, (1.0,), 1.0, SMALL),
            "psfs hold 0 of the collected light at 1 dioptres",
            lambda _: measured_depth_psfs(WINDOW, (1.0,), 1.0, SMALL).kernels),
    Refused("a pupil without light", "0 / 0 of the light that is collected", "amplitudes of zero",
            lambda: PupilPattern("black", amplitude=torch.zeros(24, 32)),
            "it must lie within 0 to 1, and pass light somewhere", lambda _: BLACK.amplitude),
    Refused("a hole between the pixels", "no pixel's centre is in it", "10 µm on 160 µm",
            lambda: round_stop(CAMERA.panel, 1e-5),
            r"whole pixels make no hole of that size: give 0.00032 m at least",
            lambda _: round_stop(CAMERA.panel, 3.2e-4).amplitude),
    Holds("photons of darkness", "the root of zero has an infinite slope, times 0: NaN",
          "0, -0.1 and 0.25 of white, photon noise alone", photons_of_darkness,
          "the root and its slope", tols=(SINGLE, DOUBLE)),
    Holds("constant captures beyond their border", "edges and means of nothing",
          "0, 1e-30, .5, 1e6", extended_flatness, "the constant", tols=(SINGLE, DOUBLE)),
    *(
        Refused(name, "who divides by it gets infinities", "0", ask,
                words, remedy)
        for name, ask, words, remedy in (
            ("no noise in a protocol", lambda: NoiseRange(0.0, 0.01), "low is 0",
             lambda _: NoiseRange(1e-6, 0.01).deviations),
            ("no noise in a capture", lambda: captured(deviation=0.0), "deviation is 0",
             lambda _: captured(deviation=1e-12)),
            ("no light in a capture", lambda: captured(collected=0.0), "light is 0",
             lambda _: captured(collected=1e-6)),
        )
    ),
]  # fmt: skip
