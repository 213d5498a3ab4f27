"""What panels do to the light: phases of any size, extreme crystals, curves and neighbours."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import torch
from judges.view import WAVELENGTH
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter
from scipy.special import j0

from hard_cases.frames import dtype_for
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
from optics.camera import Camera, Lens, Sensor
from optics.psf import PSFOperator, modulated_psf
from optics.slm import (
    Modulator,
    Panel,
    PanelMap,
    PhaseResponse,
    grey_to_phase,
    max_phase,
    phase_to_grey,
)

PANEL = Panel((6, 7), 40e-6, 0.81, unmodulated=0.0)
FRAME = 1 / 60
LEVELS = torch.linspace(0, 1, 256, dtype=torch.float64)


def made(**effects: Any) -> Modulator:
    return Modulator(replace(PANEL, **effects), WAVELENGTH)


EVERYTHING: dict[str, Any] = {
    "response_time": 5e-3,
    "coupling": 8e-6,
    "flicker": 0.01,
    "jitter": 0.2,
    "front_reflection": 0.005,
    "gap_reflection": 0.3,
    "flatness": PanelMap(np.linspace(-3e-7, 3e-7, 6).reshape(2, 3)),
    "illumination": PanelMap(np.linspace(0, 2, 6).reshape(2, 3)),
}


def random(*shape: int, waves: float = 1.0, tol: float = DOUBLE) -> torch.Tensor:
    rng = np.random.default_rng(0)
    phase = rng.uniform(0, 2 * np.pi * waves, (*shape, *PANEL.shape))
    return torch.from_numpy(phase).to(dtype_for(tol))


def light(modulator: Modulator, video: torch.Tensor) -> torch.Tensor:
    """Mean over a cycle of what lies far away."""
    cycle = modulator.video_cycle_fields(video, FRAME)
    parts = [share * torch.fft.fft2(field).abs() ** 2 for _, share, field in cycle]
    return torch.stack(parts).sum(0)


def of_parts(phase: NDArray[np.float64], sigma: float) -> NDArray[np.complex128]:
    """The mean over each pixel on a grid 80 times finer; 72 x 72 of 80 x 80 parts are active."""
    n = 80
    fine = np.exp(
        1j * gaussian_filter(np.kron(phase, np.ones((n, n))), sigma * n, mode="nearest", truncate=6)
    )
    blocks = fine.reshape(phase.shape[0], n, phase.shape[1], n)
    return blocks[:, 4:-4, :, 4:-4].mean((1, 3))


# Laws


def whole_waves_more(tol: float) -> None:
    """The field turns by the offset and is the same otherwise, as far as the numbers hold it."""
    modulator, offset = made(coupling=8e-6), 1e5
    phase = random(tol=tol) + offset
    truth = made(coupling=8e-6).modulation(random()) * np.exp(1j * offset)
    digits = torch.finfo(phase.dtype).eps * offset
    assert float((modulator.modulation(phase) - truth).abs().max()) <= 10 * digits


def one_pixel(tol: float) -> None:
    """It is its own neighbour."""
    panel = replace(PANEL, shape=(1, 1), coupling=40e-6)
    phase = torch.full((1, 1), 2.0, dtype=dtype_for(tol))
    modulator = Modulator(panel, WAVELENGTH)
    require_close(modulator.modulation(phase), torch.exp(2j * torch.ones(1, 1)), 10 * tol)
    video = torch.stack([phase, 2 * phase])
    require_finite(light(Modulator(replace(panel, **EVERYTHING), WAVELENGTH), video))


def all_flickers(tol: float) -> None:
    """A ripple as large as the phase: J0 of 6 pi is left."""
    modulator = made(flicker=1.0)
    grey = torch.full(PANEL.shape, 255, dtype=torch.uint8)
    phase = float(modulator.phase(grey)[0, 0])
    nodes = modulator.still_fields(grey, dtype=dtype_for(tol))
    mean = torch.stack([share * field for share, field in nodes]).sum(0)
    left = mean * np.exp(-1j * phase)
    assert float((left - j0(phase)).abs().max()) <= 1e-3 + 1e-5


def far_quicker(tol: float) -> None:
    """Every frame stands at once."""
    video = random(3, tol=tol)
    require_close(light(made(response_time=1e-12), video), light(made(), video), max(tol, 1e-8))


def far_slower(tol: float) -> None:
    """The panel shows the mean of all phases, and stands."""
    video = random(3, tol=tol)
    mean = video.mean(0, keepdim=True)
    # A millionth of the change is left.
    require_close(light(made(response_time=1e4), video), light(made(), mean), max(tol, 1e-5))


def nothing_shown(tol: float) -> None:
    """All phases zero, all effects on: nothing divides by the change, the step or the phase."""
    video = torch.zeros(2, *PANEL.shape, dtype=dtype_for(tol))
    require_finite_gradient(lambda v: light(made(**EVERYTHING), v), video)


def gradient_in_single(tol: float) -> None:
    """The derivative of all effects in single precision, against double."""
    gradients = [
        require_finite_gradient(lambda v: light(made(**EVERYTHING), v), random(2, tol=t))
        for t in (tol, DOUBLE)
    ]
    require_close(gradients[0], gradients[1], max(10 * tol, 1e-12))


def dark_places(tol: float) -> None:
    """Zero light on some pixels, and a finite gradient there."""
    beam = torch.zeros(PANEL.shape)
    beam[2, 3] = 5.0
    modulator = made(illumination=PanelMap(beam), coupling=8e-6)
    field = modulator.modulation(random(tol=tol))
    assert int((field != 0).sum()) == 1
    require_finite_gradient(modulator.modulation, random(tol=tol))


def dead_levels(tol: float) -> None:
    """Half of the levels do nothing: the others' phases come back to half a step."""
    shares = torch.cat([torch.zeros(128), torch.linspace(0, 1, 128)]).double()
    panel = replace(PANEL, response=PhaseResponse.from_curve(WAVELENGTH, shares))
    phase = random(waves=100, tol=tol)
    shown = grey_to_phase(panel, phase_to_grey(panel, phase, WAVELENGTH), WAVELENGTH)
    miss = torch.angle(torch.exp(1j * (shown - phase)))
    half = 0.5 * max_phase(panel, WAVELENGTH) / 127
    assert float(miss.abs().max()) <= half * (1 + 1e-4)


def below_the_first_level(tol: float) -> None:
    """A region whose curve begins a rounding error above zero shows zero by its first level,
    not by a whole wave."""
    curves = LEVELS + torch.tensor([0.0, 1e-12]).double()[:, None]
    panel = replace(PANEL, response=PhaseResponse((WAVELENGTH,), curves[None, None]))
    assert not phase_to_grey(panel, torch.zeros(PANEL.shape, dtype=dtype_for(tol)), 5e-7).any()


def hardly_coupled(tol: float) -> None:
    """A blur of a picometre is none."""
    phase = random(waves=3, tol=tol)
    require_close(made(coupling=1e-12).modulation(phase), made().modulation(phase), max(tol, 1e-12))


OPTICS = Camera(PANEL, Lens(0.125, 5.0, 2.0), Sensor((20, 21), 20e-6))


def hardly_a_jitter(tol: float) -> None:
    """1 - exp(-1e-18) isn't zero, and changes no picture."""
    assert abs(made(jitter=1e-9).jitter_scatter_share / 1e-18 - 1) <= 1e-9
    require_close(seen(jitter=1e-9), seen(), 1e-6)


def nothing_but_jitter(tol: float) -> None:
    """All light is scattered: the same on all pixels but for the envelope of one, of which
    the neighbours of the middle see as much as the middle."""
    picture = seen(jitter=40.0)
    require_finite(picture)
    assert float(picture.max() / picture.min()) <= 1.01


def seen(**effects: Any) -> torch.Tensor:
    """A PSF behind the panel, on 3 x 3 pixels."""
    pixels = OPTICS.sensor.window_plane((3, 3))
    operator = PSFOperator(OPTICS, 2.0, WAVELENGTH, pixels, unmodulated=0.0)
    modulator = made(**effects)
    return modulated_psf(operator, modulator, [(1.0, modulator.modulation(random()))])


def law(
    name: str, why: str, given: str, function: Callable[[float], None], judge: str, **row: Any
) -> Holds:
    return Holds(name, why, given, function, judge, **{"tols": (SINGLE, DOUBLE), **row})


STEPS = random(waves=3)
FLY_BACK = torch.from_numpy(np.tile((np.arange(14) * 2.0) % (6 * np.pi), (6, 1))[:, ::2].copy())

CASES: list[Case] = [
    law("coupled pixels far from a phase of zero", "a blur of large numbers loses their digits",
        "1e5 rad more", whole_waves_more, "the same pixels near zero, turned"),
    Agrees("random steps of three waves between coupled pixels",
        "a few samples a pixel don't follow six pi between two neighbours",
        "coupling of 0.2 pixels", lambda tol: made(coupling=8e-6).modulation(STEPS),
        lambda: of_parts(STEPS.numpy(), 0.2), "scipy's filter on 80 x 80 parts a pixel",
        tols=(2e-3,)),
    Agrees("a fly-back of three waves",
        "wrapped phases are the same waves, and not the same to the neighbours",
        "coupling of 0.5 pixels", lambda tol: made(coupling=20e-6).modulation(FLY_BACK),
        lambda: of_parts(FLY_BACK.numpy(), 0.5), "scipy's filter on 80 x 80 parts a pixel",
        tols=(2e-3,)),
    law("coupling of a picometre", "an error function divides by its width", "1e-12 m",
        hardly_coupled, "no coupling"),
    law("a modulator of one pixel", "no neighbours, no steps, one region", "1 x 1",
        one_pixel, "exp(2i)"),
    law("all of the phase flickers", "two nodes don't follow six pi of ripple", "flicker 1",
        all_flickers, "Bessel's J0", tols=(SINGLE, DOUBLE)),
    law("a crystal far quicker than its frames", "exp(-1e10) is zero, and its logarithm infinite",
        "tau 1e-12 s", far_quicker, "frames that stand at once"),
    law("a crystal far slower than its frames", "a geometric sum of ones divides by 1 - 1",
        "tau 1e4 s", far_slower, "the mean of the frames"),
    law("all effects on a phase of zero", "0 / 0 in steps, changes and ripples",
        "two frames of zeros", nothing_shown, "finite gradients"),
    law("the derivative of all effects in single precision", "nodes are chosen by the phase",
        "two random frames", gradient_in_single, "double precision"),
    law("a beam on one pixel", "the root of zero has no derivative", "one pixel of 42 is lit",
        dark_places, "one field, finite gradients"),
    law("levels that do nothing", "a flat curve has no inverse", "128 of 256 levels",
        dead_levels, "half a step"),
    law("a curve that begins a rounding error above zero",
        "what is below the first level is wrapped to the last", "1e-12 of the range",
        below_the_first_level, "level 0"),
    law("jitter of a nanoradian", "1 - exp(-1e-18) cancels", "1e-9 rad", hardly_a_jitter,
        "its square", tols=ONCE),
    law("nothing but jitter", "no light is left to take a share of", "40 rad",
        nothing_but_jitter, "even light", tols=ONCE),
    Refused("a phase of NaN on a panel", "it becomes grey level 0, or a NaN of a picture",
        "1 of 42", lambda: made(coupling=8e-6).modulation(random() / (random() != STEPS[0, 0] / 3)),
        "phase has 1 NaN or infinite values of 42", lambda tol: made().modulation(random())),
    Refused("unwrapped steps between coupled pixels", "no number of samples follows them",
        "1e5 rad a pixel", lambda: made(coupling=8e-6).modulation(1e5 * random()),
        "phase steps by .* wrap the phase into the panel's range",
        lambda tol: made(coupling=8e-6).modulation(1e5 * random() % (2 * math.pi))),
    Refused("fringing fields over two pixels", "a kernel wider than its pixels blurs everything",
        "80 µm", lambda: made(coupling=80e-6), "coupling is 8e-05 m; .* 4e-05 m, at most",
        lambda tol: made(coupling=40e-6).modulation(random())),
    Refused("more waves than the panel reaches", "phases beyond the last level are clipped",
        "orders 4", lambda: made().grey(random(), 4), "orders is 4; .* choose 1 to 3",
        lambda tol: made().grey(random(), 3)),
    Refused("a response that falls", "two levels of one phase, and a search that finds neither",
        "level 100", lambda: PhaseResponse.from_curve(5e-7, LEVELS - 0.1 * (LEVELS > 100.5 / 255)),
        "falls from level 100 to 101 .* smooth the measurement",
        lambda tol: PhaseResponse.from_curve(5e-7, LEVELS).shares),
    Refused("a video faster than anything follows", "a mean over thousands of turns",
        "1e4 rad a frame",
        lambda: light(made(response_time=5e-3), 1e4 * random(2)),
        "changes by .* within a frame",
        lambda tol: light(made(response_time=5e-3), 1e4 * random(2) % (2 * math.pi))),
]  # fmt: skip
