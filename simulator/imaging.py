"""Effect plans and pictures of situations, with results that are kept for later pictures."""

from __future__ import annotations

import copy
import math
import os
import time
from collections.abc import Callable, Hashable, Mapping
from dataclasses import asdict, dataclass, replace

import torch

from optics.caching import ByteCache, HashedKey
from optics.camera import Camera
from optics.sensor import moments
from optics.slm import max_phase
from optics.threads import single_threaded
from optics.validation import as_number
from simulator.effects.picture_norms import estimated_norms, minimum_norms
from simulator.effects.registry import EFFECTS
from simulator.formation import expected_electrons
from simulator.ledger import Ledger
from simulator.planning import EffectPlan
from simulator.planning.effect import DecidedBy, forced_level, resolve_forced_levels
from simulator.planning.effect_plan import plan_effects, require_decided_by, require_tolerance
from simulator.probing.pattern_probe import PatternProbe
from simulator.probing.picture_probe import PictureProbe
from simulator.recipe import Recipe
from simulator.situation import Situation
from simulator.speckle import moments_with_speckle, speckle_pattern
from simulator.streaming import FrameSimulator


class Cache(ByteCache):
    """Keep the most recently used results under hashable keys, a limited number of any size."""

    def size_of(self, result: object) -> int:
        return 1

    def __contains__(self, key: Hashable) -> bool:
        """Return whether a result is kept under `key`."""
        with self._lock:
            return key in self._entries


# Bytes that pictures may keep for later ones: of any sensor, and for each pixel. Chosen: more of
# them saved little in the bundled plans.
_LEAST_MEMORY, _MEMORY_PER_PIXEL = 560 << 20, 85


@dataclass(frozen=True)
class PictureMoments:
    """Mean and variance of a sensor's pixels, without any random draw; maps are (rows, columns).

    electrons: mean number of electrons that the light frees on each pixel during the exposure.
    mean, variance: of each pixel's digital number less its black level, in electrons and
    electrons².
    """

    electrons: torch.Tensor
    mean: torch.Tensor
    variance: torch.Tensor


class Imaging:
    """Compute the effect plans and pictures of situations, and keep what they share.

    tol: relative error of mean picture and noise up to which effects may be left out. forced:
    effects to be on, off or at a level, whatever error that makes. memory: bytes of results to
    keep. decide_by: "bound" for plans whose error is proved, "estimate" for plans by audited
    estimates, which save more. Raises ValueError for a tol that is negative or not finite, and for
    another word.
    """

    def __init__(
        self,
        tol: float = 1e-2,
        forced: Mapping[str, str | bool] | None = None,
        memory: int = _LEAST_MEMORY,
        decide_by: DecidedBy = "bound",
    ) -> None:
        require_tolerance(tol)
        require_decided_by(decide_by)
        self.tol, self.forced, self.decide_by = tol, dict(forced or {}), decide_by
        self.ledger = Ledger()
        self.plan_count = 0
        """How many effect plans were computed; those that were found in the cache don't count."""
        # Light and PSFs would displace frame simulators, which show a picture again at once. They
        # get half of the memory (chosen).
        streams = memory // 2
        self._cache, self._streams = ByteCache(memory - streams), ByteCache(streams)
        self._plans = Cache(256)
        self._pictures, self._patterns = Cache(4), Cache(3)

    def with_tolerance(self, tol: float) -> Imaging:
        """Return a copy with another tolerance and no forced effects, which shares the caches."""
        require_tolerance(tol)
        other = copy.copy(self)
        other.tol, other.forced = tol, {}
        return other

    @property
    def memory(self) -> int:
        """Return the bytes of light, spectra and PSFs that are kept at most."""
        return self._cache.limit + self._streams.limit

    @property
    def kept_bytes(self) -> int:
        """Return the bytes of light, spectra and PSFs that are kept now."""
        return self._cache.bytes + self._streams.bytes

    def forget(self) -> None:
        """Empty the caches of pictures and plans; they are computed again if needed."""
        for cache in (self._cache, self._plans, self._streams, self._pictures, self._patterns):
            cache.clear()

    def force(self, forced: Mapping[str, str | bool], s: Situation) -> None:
        """Force effects on, off or to a level in the next pictures, whatever the error.

        Raises ValueError for an effect that doesn't exist, for a level that it doesn't have, or for
        an effect that is on and requires one that is off. No plan is computed for this check.
        """
        levels = {name: forced_level(EFFECTS, s, name, wanted) for name, wanted in forced.items()}
        resolve_forced_levels(EFFECTS, levels)
        self.forced = dict(forced)

    def plan(self, s: Situation) -> EffectPlan:
        """Return the effect plan of a situation, from the cache if possible.

        Raises ValueError for a filter wavelength at which the panel's phase range isn't known.
        """
        # A plan is computed with the tolerance and levels under which it is kept, even if another
        # thread changes them meanwhile.
        key = tol, forced, decided_by, _ = self._plan_key(s)
        return self._plans.get(key, lambda: self._compute_plan(s, tol, dict(forced), decided_by))

    def is_planned(self, s: Situation) -> bool:
        """Return whether the effect plan of a situation is in the cache."""
        return self._plan_key(s) in self._plans

    def _plan_key(
        self, s: Situation
    ) -> tuple[float, tuple[tuple[str, str | bool], ...], DecidedBy, Hashable]:
        return self.tol, tuple(sorted(self.forced.items())), self.decide_by, picture_key(s)

    @single_threaded
    def _compute_plan(
        self, s: Situation, tol: float, forced: Mapping[str, str | bool], decided_by: DecidedBy
    ) -> EffectPlan:
        """Compute the effect plan of a situation, and time it."""
        self.plan_count += 1
        began = time.thread_time()
        max_phase(s.camera.panel, s.wavelength)  # raises ValueError where it isn't known
        if s.cache.are_estimates != (decided_by == "estimate"):
            # Bounds must not be found from an estimate.
            s.cache.results.clear()
        s.cache.are_estimates = decided_by == "estimate"
        s.cache.picture_probe = self._shared_picture_probe(s)
        s.cache.pattern_probe = self._shared_pattern_probe(s)
        norms = minimum_norms(s) if decided_by == "bound" else estimated_norms(s)
        plan = plan_effects(EFFECTS, s, norms, tol, forced, decided_by)
        plan.planning_cpu = time.thread_time() - began
        return plan

    def _shared_picture_probe(self, s: Situation) -> PictureProbe:
        """Return the picture's probe, which doesn't depend on the exposure time of what stands."""
        key = s.target, s.camera, s.band, s.picture_probe.shift
        return self._pictures.get(key, lambda: s.picture_probe)

    def _shared_pattern_probe(self, s: Situation) -> PatternProbe:
        """Return the pattern's probe, which doesn't depend on the exposure either."""
        camera, distances = s.mount.camera_in_panel_axes(s.camera), s.picture_probe.distances
        samples = _samples_per_spot(s) if s.cache.are_estimates else 2.0
        foci, leaked = s.foci, s.leaked_foci
        shown = s.panel_content.names, s.panel_content.frame_time

        def probe() -> PatternProbe:
            return PatternProbe(
                camera, s.panel_content, s.wavelength, distances, self._cache,
                samples_per_spot=samples, foci=foci, leaked_foci=leaked,
            )  # fmt: skip

        key = camera, shown, s.wavelength, distances, samples, foci, leaked
        return self._patterns.get(key, probe)

    @single_threaded
    def electrons(
        self, s: Situation, recipe: Recipe, check: Callable[[], None] = lambda: None
    ) -> torch.Tensor:
        """Return the mean number of electrons that light frees on each pixel, (rows, columns)."""
        return expected_electrons(s, recipe, self._cache, self.ledger, check)

    def picture_moments(
        self, s: Situation, recipe: Recipe, check: Callable[[], None] = lambda: None
    ) -> PictureMoments:
        """Return mean and variance of every pixel in a situation's picture."""
        electrons = self.electrons(s, recipe, check)
        stages = asdict(recipe.stages)
        if recipe.speckle:
            self.ledger.add("speckle", 20.0 * electrons.numel(), 16 * electrons.numel())
            mean, variance = moments_with_speckle(s, electrons, **stages)
        else:
            mean, variance = moments(electrons, s.exposure, s.camera.sensor, **stages)
        return PictureMoments(electrons, mean, variance)

    def stream(
        self, s: Situation, plan: EffectPlan, check: Callable[[], None] = lambda: None
    ) -> FrameSimulator:
        """Return a frame simulator of a situation; it is kept while nothing changes."""

        def compute() -> FrameSimulator:
            recipe = plan.recipe
            electrons = self.electrons(s, recipe, check)
            if recipe.speckle:
                self.ledger.add("speckle", 20.0 * electrons.numel(), 16 * electrons.numel())
                electrons = electrons * speckle_pattern(s)
            return FrameSimulator(electrons, s.exposure, s.camera.sensor, recipe)

        return self._streams.get((picture_key(s), tuple(plan.levels.items())), compute)


def default_memory(camera: Camera) -> int:
    """Return the bytes that a camera's pictures may keep for later ones.

    It is at most a quarter of the machine's memory: 0.6 GB for a sensor of 768 x 512 pixels, 1.0 GB
    for one of 2448 x 2048.
    """
    rows, columns = camera.sensor.shape
    machine = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    return min(machine // 4, _LEAST_MEMORY + _MEMORY_PER_PIXEL * rows * columns)


def _samples_per_spot(s: Situation) -> float:
    """Return the samples of far fields in each diffraction spot that estimates need.

    Fewer samples hide the transfer function near the cut-off, where few pictures have any light.
    That saves time with large panels. The numbers of pixels and the share of a picture's norm that
    may be in fine detail were chosen.
    """
    if math.prod(s.camera.panel.shape) < 1 << 17 or s.picture_probe.is_dark:
        return 2.0
    power, camera = s.picture_probe.power_spectrum, s.camera
    period = s.wavelength * as_number(camera.ray_matrix_b) / camera.panel.pitch
    fine = power.low > 0.3 * min(camera.panel.shape) / period
    share = math.sqrt(power.power[fine].sum() / power.power.sum()) if power.power.any() else 0.0
    return 2.0 if share > 0.3 else 1.5


def picture_key(s: Situation) -> Hashable:
    """Return a cache key of all that a situation's picture depends on.

    The start of the exposure is part of it only if the picture depends on it.
    """
    return HashedKey(
        s.camera,
        s.mount,
        s.target,
        # Filters are set in steps of 0.01 nm (1e-11 m): rounding to 1e-14 m removes only
        # floating-point errors.
        replace(s.band, centre=round(s.band.centre, 14)),
        (s.panel_content.names, s.panel_content.frame_time),
        s.exposure_start if _depends_on_start(s) else 0.0,
        s.exposure,
        s.focus_drift,
        s.interference,
        s.numerics,
    )


def _depends_on_start(s: Situation) -> bool:
    """Return whether a picture depends on when the exposure begins.

    It does if the lamp changes with time, or if the panel's video does and the exposure doesn't see
    all of its frames equally. A rolling shutter's rows see them equally but for rounding.
    """
    video = s.panel_content
    if s.target.lamp is not None or (video.is_changing and s.camera.sensor.shutter == "rolling"):
        return True
    return video.is_changing and not video.covers_whole_periods(s.exposure)
