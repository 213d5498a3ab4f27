"""From lens or camera, object distance and wavelength to the PSF on the sensor."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import replace

import torch

from optics.accuracy import (
    FLOAT64_ARITHMETIC,
    Account,
    Budget,
    ErrorEstimate,
    MachineSpeed,
    Result,
    ToleranceError,
    unkeepable,
)
from optics.camera import Camera, Lens
from optics.edge import as_number, tensors_inside
from optics.plane import Plane
from optics.psf.axial import AxialEngine
from optics.psf.engine import Engine
from optics.psf.panel import PanelEngine
from optics.psf.question import Question
from optics.psf.sampled import SampledEngine
from optics.psf.scattered import ScatteredEngine
from optics.psf.truth import Probe
from optics.pupil import (
    Scalar,
    cutoff_frequency,
    model_error,
    numeric_lens,
    open_radius,
    require_light,
)
from optics.sensor import PIXEL_INTEGRATION_ERROR, PixelIntegration
from optics.threads import in_full_precision

_LEAST = 1e-12
"""Amplitudes whose squares single precision holds, with room for a dim window."""

METHODS = ("axial", "scattered", "sampled")
"""For a lens; behind a panel the methods are those of the Fourier transform."""


class PSFOperator:
    """The incoherent PSF of a lens or a camera, planned once and called many times.

    The model is the Fraunhofer integral of the generalised pupil (thesis Eq. 3.1). In a
    Camera, each panel pixel is a square of one modulation, and the unmodulated share is
    added in intensity, as light of the polarisation that the panel doesn't turn (§5.6).
    A Lens stands alone.

    optics: Camera or Lens. distance: metres from the object to the panel or the lens,
    math.inf allowed. wavelength: metres. pixels: whose light is wanted, on the axis or off
    it (Sensor.window() makes them). integrate: whether the answer is the light on whole
    pixels, or the density of light at their centres times their area. unmodulated: share
    of unmodulated light; the panel's own if None. tol: relative L2 error from sampling and
    arithmetic. method: one of METHODS for a lens, a transform's name for a camera; the
    cheapest that keeps tol if None. phase_slope: radians per stop radius by which phases given
    to a lens may turn; its nodes are chosen before. budget: memory allowed, and the machine's
    speed.

    Call with phase (radians) and amplitude, both optional, (..., rows, columns) of the
    panel, or (..., points) of `points` for a lens; tensors or arrays. The answer is
    (..., *pixels.shape), the share of the light leaving the pupil that each pixel receives.

    Differentiable in phase, amplitude, and in every length that is a 0-d tensor: distance,
    wavelength, the lens' focal length, f-number, focus distance and aberrations, and the
    pixels' centre (a panel's stop keeps its edges). Mixed precision (autocast) is kept out.

    Raises ToleranceError if tol can't be kept, with the floor and the remedy.
    """

    def __init__(
        self,
        optics: Camera | Lens,
        distance: Scalar,
        wavelength: Scalar,
        pixels: Plane,
        *,
        integrate: bool = True,
        unmodulated: float | None = None,
        tol: float = 1e-3,
        method: str | None = None,
        phase_slope: float = 20.0,
        budget: Budget | None = None,
    ) -> None:
        self.camera = camera = optics if isinstance(optics, Camera) else None
        lens = optics.lens if isinstance(optics, Camera) else optics
        self.unmodulated = _unmodulated(camera, unmodulated)
        require_light(as_number(distance), as_number(wavelength))
        _require_method(method, camera)
        self.pixels = pixels
        cutoff = cutoff_frequency(_numeric(optics), as_number(wavelength))
        self._integral = PixelIntegration(pixels, cutoff, budget) if integrate else None
        samples = self._integral.plane if self._integral else pixels
        rest = PIXEL_INTEGRATION_ERROR if integrate else 0.0
        floor = rest + 20 * FLOAT64_ARITHMETIC
        if not floor <= tol:
            raise unkeepable(tol, floor)
        margin = self._integral.margin if self._integral else 0
        question = Question(
            lens, distance, wavelength, samples, tol - rest, budget or Budget(), margin, phase_slope
        )
        self._question = question
        self._kept: list[tuple[torch.Tensor | None, torch.Tensor]] = []
        self._engine = _prepared(question, camera, method)
        self.account = self._accounted(question, tol, rest)

    def _accounted(self, question: Question, tol: float, rest: float) -> Account:
        engine, speed = self._engine, question.budget.speed
        rows, columns = question.samples.shape
        sampling = ErrorEstimate(engine.error.value + rest, engine.error.how)
        return Account(
            method=engine.name,
            sampling=f"{engine.sampling} to {columns}x{rows} samples of "
            f"{question.samples.pitch[1] * 1e6:.3g} µm",
            precision=engine.precision,
            tol=tol,
            model=self._model_error(question),
            sampling_error=sampling,
            arithmetic=ErrorEstimate(engine.arithmetic, "bound, from tests"),
            cpu_predicted=self.cpu_seconds(speed),
            bytes=engine.bytes + (self._integral.bytes if self._integral else 0),
        )

    def _model_error(self, question: Question) -> ErrorEstimate:
        n = question.numeric
        reach = n.radius
        if self.camera is not None:
            reach = open_radius(replace(self.camera, lens=n.lens))
        return model_error(n.lens, n.wavelength, min(n.radius, reach))

    @property
    def wavelength(self) -> Scalar:
        """Metres."""
        return self._question.wavelength

    @property
    def scale(self) -> Scalar:
        """Wavelength times image distance: square metres of pupil by a cycle on the sensor."""
        return self._question.scale

    def cpu_seconds(self, speed: MachineSpeed) -> float:
        """Predicted processor time of one call, on a machine of such a speed."""
        integral = self._integral.cpu_seconds(speed) if self._integral else 0.0
        return self._engine.cpu_seconds(speed) + integral

    @property
    def points(self) -> tuple[torch.Tensor, torch.Tensor]:
        """Metres (y, x) in the pupil where phases and amplitudes are wanted; they broadcast."""
        return self._engine.points()

    @tensors_inside
    @in_full_precision
    def __call__(
        self, phase: torch.Tensor | None = None, amplitude: torch.Tensor | None = None
    ) -> torch.Tensor:
        if self._question.differentiable:
            self._question.require_unchanged()
        light = self._light(phase, amplitude)
        if not self.unmodulated or phase is None:
            return light
        straight = self.straight(amplitude).to(light.device)
        return (1 - self.unmodulated) * light + self.unmodulated * straight

    def straight(
        self, amplitude: torch.Tensor | None = None, *, keep: bool = False
    ) -> torch.Tensor:
        """The PSF of light that no phase is put on.

        keep: whether this very amplitude will be asked for again, unchanged. Without any, the
        answer is always kept: it is the same for every pattern.
        """
        if self._question.differentiable or (amplitude is not None and not keep):
            return self._light(None, amplitude)
        for known, light in self._kept:
            if known is amplitude:
                return light
        light = self._light(None, amplitude)
        if not light.requires_grad:
            self._kept = [*self._kept[-1:], (amplitude, light)]
        return light

    def _light(self, phase: torch.Tensor | None, amplitude: torch.Tensor | None) -> torch.Tensor:
        peak = _peak(amplitude)
        if amplitude is not None and peak != 1:
            amplitude = amplitude / peak
        light = self._engine.intensity(phase, amplitude)
        light = self._integral(light) if self._integral else light
        if peak == 1:
            return light
        # Beyond what single precision holds, the answer is in double.
        wide = light if _LEAST < peak < 1 / _LEAST else light.to(torch.float64)
        return wide * peak**2


def _peak(amplitude: torch.Tensor | None) -> float:
    """The largest amplitude there is; 1 where there is none, or it is no number."""
    if amplitude is None or not amplitude.numel():
        return 1.0
    peak = float(amplitude.detach().abs().max())
    return peak if 0 < peak < math.inf else 1.0


def _unmodulated(camera: Camera | None, share: float | None) -> float:
    if camera is None:
        if share:
            raise ValueError(f"unmodulated is {share:g}; a lens without a panel modulates nothing")
        return 0.0
    share = camera.panel.unmodulated if share is None else share
    if not 0 <= share <= 1:
        raise ValueError(f"unmodulated is {share:g}; it is a share and must lie between 0 and 1")
    return share


def _require_method(method: str | None, camera: Camera | None) -> None:
    if method is not None and camera is None and method not in METHODS:
        raise ValueError(f"method is {method!r}; for a lens choose one of {', '.join(METHODS)}")


def _numeric(optics: Camera | Lens) -> Camera | Lens:
    """The same with a lens of plain numbers."""
    if isinstance(optics, Camera):
        return replace(optics, lens=numeric_lens(optics.lens))
    return numeric_lens(optics)


def _offers(
    question: Question, camera: Camera | None, method: str | None
) -> list[Callable[[], Engine]]:
    """Makers of every engine that serves a question; one that can't serve raises."""
    if camera is not None:
        return [lambda: PanelEngine(question, camera, transform=method)]
    probe = Probe(question)
    offers: list[Callable[[], Engine]] = []
    if method in (None, "axial") and AxialEngine.serves(question):
        offers.append(lambda: AxialEngine(question))
    if method in (None, "scattered"):
        offers.append(lambda: ScatteredEngine(question, probe))
    if method in (None, "sampled") and (method or question.tol >= SampledEngine.FINEST):
        offers.append(lambda: SampledEngine(question, probe))
    return offers


def _prepared(question: Question, camera: Camera | None, method: str | None) -> Engine:
    """The cheapest engine that fits the memory and keeps the tolerance, prepared.

    Raises the ToleranceError of the one that came closest.
    """
    budget = question.budget
    offers = _offers(question, camera, method)
    if not offers:
        raise ValueError(f"method is {method!r}; it serves round stops and aberrations only")
    refusals: list[ToleranceError] = []
    engines: list[Engine] = []
    for offer in offers:
        try:
            engine = offer()
            _require_memory(engine, budget)
            engines.append(engine)
        except ToleranceError as error:
            refusals.append(error)
    for engine in sorted(engines, key=lambda engine: engine.cpu_seconds(budget.speed)):
        try:
            engine.prepare()
        except ToleranceError as error:
            refusals.insert(0, error)
            continue
        return engine
    raise refusals[0]


def _require_memory(engine: Engine, budget: Budget) -> None:
    if engine.bytes > budget.memory:
        raise ToleranceError(
            f"a PSF by {engine.name} needs {engine.bytes / 1e6:.0f} MB at least and "
            f"{budget.memory / 1e6:.0f} MB are allowed; allow more memory, ask for fewer pixels, "
            "or bring the object closer to the plane in focus"
        )


def psf(
    optics: Camera | Lens,
    phase: torch.Tensor | None,
    distance: Scalar,
    wavelength: Scalar,
    pixels: Plane,
    *,
    tol: float = 1e-3,
) -> Result[torch.Tensor]:
    """The PSF on sensor pixels, with its account; plans a PSFOperator and calls it once."""
    started = time.process_time()
    operator = PSFOperator(optics, distance, wavelength, pixels, tol=tol)
    value = operator(phase)
    return Result(value, operator.account.spent(time.process_time() - started))


def nyquist_samples(camera: Camera, wavelength: float) -> float:
    """Samples per sensor pixel, along an axis, that just resolve the PSF's finest fringe."""
    return 2 * camera.sensor.pitch * cutoff_frequency(camera, wavelength)
