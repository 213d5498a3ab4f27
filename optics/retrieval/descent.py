"""Improve a retrieved pattern by gradient descent through a model of the real panel.

The other methods assume a panel of ideal pixels. Here every phase passes through the model of the
panel's grey levels, phase response, coupling, gaps and flatness before its light is compared with
the target. Unmodulated light is included as well, so that the pattern compensates what it can
(after Schroff et al., Sci. Rep. 13, 3252, 2023). Every iteration costs a pass over all pixels and
back, which is expensive. The method is meant for the last improvement of a good start.
"""

from __future__ import annotations

import torch

from optics.camera.pupil import pupil_amplitude, with_stop_shadow_on_panel
from optics.progress import Progress
from optics.retrieval.goal import RetrievalGoal
from optics.slm.modulator import Modulator

_RATE = 0.03  # learning rate of Adam at the start, radians; it falls to a tenth of that. Chosen.


class GradientDescent:
    """Minimise the difference between a target and the mean light of frames.

    The loss is the squared error of the mean intensity over the window, relative to the target's.
    The target is scaled to the light that the start has in the target's bright part. A fitted scale
    would trade light for a smoother shape.

    orders: waves of the panel's range that are used.
    """

    def __init__(self, goal: RetrievalGoal, orders: int = 1) -> None:
        self.goal, self.orders = goal, orders
        self.modulator = Modulator(goal.camera.panel, goal.wavelength)
        self._stop = pupil_amplitude(with_stop_shadow_on_panel(goal.camera)).to(torch.float32)
        self._unmodulated_intensity = torch.zeros(goal.plane.shape)
        for share, field in self.modulator.unmodulated_fields:
            still = torch.ones(goal.camera.panel.shape) if field is None else field
            self._unmodulated_intensity += share * self._intensity(still) / goal.power

    def _intensity(self, modulation: torch.Tensor) -> torch.Tensor:
        return self.goal.far_field.intensity(modulation.to(torch.complex64) * self._stop)

    def frame_intensity(self, phase: torch.Tensor) -> torch.Tensor:
        """Return the window's intensity for one frame's phase, as shares of all light.

        It is differentiable: the phase is rounded to the panel's grey levels in the value, but not
        in the derivative.
        """
        with torch.no_grad():
            shown = self.modulator.phase(self.modulator.grey(phase, self.orders))
            rounding = shown.to(torch.float32) - phase
        modulation = self.modulator.modulation(phase + rounding)
        steered = (1 - self.modulator.unmodulated_share) * (1 - self.modulator.jitter_scatter_share)
        modulated = steered * self._intensity(modulation) / self.goal.power
        return modulated + self._unmodulated_intensity

    def run(self, phases: torch.Tensor, iterations: int, progress: Progress) -> torch.Tensor:
        """Improve phases, (frames, rows, columns) in radians; return the best, float32."""
        frames = [phase.to(torch.float32).clone().requires_grad_() for phase in phases]
        adam = torch.optim.Adam(frames, lr=_RATE)
        schedule = torch.optim.lr_scheduler.CosineAnnealingLR(adam, iterations, _RATE / 10)
        wanted, best, least = None, phases, float("inf")
        for iteration in range(iterations + 1):
            progress.report(iteration / (iterations + 1), f"descent {iteration}/{iterations}")
            with torch.no_grad():
                mean = torch.stack([self.frame_intensity(frame) for frame in frames]).mean(0)
            if wanted is None:
                wanted = self._target_intensity(mean)
            error = float((mean - wanted).square().sum())
            if error < least:
                least, best = error, torch.stack([frame.detach().clone() for frame in frames])
            if iteration == iterations:
                break
            adam.zero_grad()
            pull = 2 * (mean - wanted) / (len(frames) * wanted.square().sum())
            for frame in frames:
                # Frames are differentiated one by one, which needs the memory of one graph only.
                (self.frame_intensity(frame) * pull).sum().backward()  # type: ignore[no-untyped-call]
            adam.step()
            schedule.step()
        return best

    def _target_intensity(self, mean: torch.Tensor) -> torch.Tensor:
        """Return the target, scaled to the light that frames have in its bright part.

        Elsewhere the unmodulated light is added, which no pattern can remove.
        """
        target = self.goal.target.to(torch.float32)
        bright = target > 0.02 * target.max()
        wanted = target * (mean[bright].sum() / target[bright].sum())
        return torch.where(bright, wanted, torch.maximum(wanted, self._unmodulated_intensity))
