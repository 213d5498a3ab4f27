"""Train a pattern together with its decoder."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import torch
from torch import nn

from labapp.edof.design_problem import EdofProblem
from labapp.training.edof.captures import (
    Captures,
    DrawnScene,
    SceneSampler,
    capture_scenes,
    unmodulated_shares,
)
from labapp.training.edof.config import EdofTrainingConfig
from labapp.training.edof.decoder_task import (
    decode_captures,
    decoder_schedule,
    scene_losses,
    validation_score,
)
from labapp.training.edof.depth_choice import choose_dioptres, depth_chances, depth_indices
from labapp.training.edof.optics_table import (
    compute_transfers,
    training_dioptres,
    transfer_on_axis,
)
from labapp.training.processes import Processes
from labapp.training.state import TrainingSchedule
from optics.edof.learned import DecoderNetwork
from optics.edof.learned.wiener_front import DepthStatistics, add_unmodulated_light

_FIRST_STEP = 2**31
"""Number of the first step for the random scenes. Chosen: the decoder's own training takes fewer
steps, so that no scene comes again."""

_LEAST_GRADIENT = 1e-14
"""Adam's guard against zero for the pattern. Its usual one, 1e-8, is as large as the gradient by
one of half a million pixels."""


def joint_schedule(config: EdofTrainingConfig, steps: int) -> TrainingSchedule:
    """Return the schedule of a pattern together with its decoder."""
    own, seed = config.joint, config.seed + 1
    alone = decoder_schedule(config, steps)
    return replace(alone, first_rate=own.first_rate, last_rate=own.last_rate, seed=seed)


class PatternWithDecoder(nn.Module):
    """Holds the parameters of a pattern and the network of its decoder, which train together.

    parameters: the pattern's, radians.
    """

    def __init__(self, network: DecoderNetwork, parameters: torch.Tensor) -> None:
        super().__init__()
        self.network = network
        self.pattern = nn.Parameter(parameters.detach().clone().to(torch.float64))


class JointTask:
    """A pattern and its decoder that learn together, through the optics between them.

    The transfer functions of all parts of the range of depths are remembered, for the filter and
    for scenes with several layers. Each scene has one layer whose transfer function is computed
    anew, for the derivative by the pattern, and then remembered. The filter is held constant in
    each step, as it is nearly the best for the pattern.
    module: its network is on the device of the training.
    problem: the optics, for scenes of the training's side.
    processes: share the scenes of a step.
    settings: everything that the result depends on, as plain data.
    """

    def __init__(
        self,
        module: PatternWithDecoder,
        problem: EdofProblem,
        sampler: SceneSampler,
        config: EdofTrainingConfig,
        processes: Processes,
        settings: Mapping[str, Any],
    ) -> None:
        self.module, self._problem, self._sampler = module, problem, sampler
        self._config, self._processes, self.settings = config, processes, settings
        self.samples = config.joint.samples
        self._transfer = problem.transfer(problem.request.wavelengths[0])
        self._dioptres = training_dioptres(config, config.joint.parts)
        self._spectrum = problem.spectrum.to(processes.device, torch.float32)
        self._remembered = self._compute_all()
        self._flat = self._compute_all(flat=True)
        # By the PSFs before the joint training, so that the scenes' depths stay the same in it.
        self._chances = depth_chances(self._remembered, config).cpu()

    def parameter_groups(self) -> list[dict[str, Any]]:
        """Return the decoder's weights, and the pattern's parameters with a rate of their own."""
        own = self._config.joint
        return [
            {"params": list(self.module.network.parameters()), "rate": 1.0},
            {
                "params": [self.module.pattern],
                "rate": own.pattern_rate / own.first_rate,
                "eps": _LEAST_GRADIENT,
            },
        ]

    def losses(self, step: int, samples: Sequence[int]) -> torch.Tensor:
        """Return the losses of decoded scenes of a step, differentiable by the pattern too."""
        drawn = self._sampler.draw(_FIRST_STEP + step, samples)
        # The scenes take turns in which of their layers passes the derivative on.
        pairs = zip(samples, drawn, strict=True)
        chosen = [(step + one) % len(scene.depths) for one, scene in pairs]
        depths = [scene.depths[k] for scene, k in zip(drawn, chosen, strict=True)]
        phase = self._problem.phase(self.module.pattern)
        places = depth_indices(self._chances, depths)
        config = self._config
        if config.depths.distances_m:
            dioptres = [self._dioptres[one] for one in places]
        else:
            depth_range = (config.far_dioptre, config.near_dioptre)
            dioptres = choose_dioptres(self._chances, depths, depth_range)
        fresh = self._compute_fresh(phase, dioptres, step, samples, places)
        transfers = []
        for scene, k, own in zip(drawn, chosen, fresh, strict=True):
            each = list(self._remembered[self._places(scene)])
            each[k] = own
            transfers.append(torch.stack(each))
        return scene_losses(self._decode(drawn, transfers), config)

    def _compute_fresh(
        self,
        phase: torch.Tensor,
        dioptres: Sequence[float],
        step: int,
        samples: Sequence[int],
        places: Sequence[int],
    ) -> torch.Tensor:
        """Compute a transfer function for each scene of a step, and remember those to remember.

        The scenes take turns in the panel's conditions that the pattern shall stand. What the panel
        shows as it should be is remembered, as the filter knows of nothing else.
        """
        ways = (None, *self._problem.conditions)
        turns = [(step + one // 2) % len(ways) for one in samples]
        found: dict[int, torch.Tensor] = {}
        for way in sorted(set(turns)):
            own = [k for k, turn in enumerate(turns) if turn == way]
            there = [dioptres[k] for k in own]
            each = transfer_on_axis(self._transfer, phase, there, ways[way])
            found.update(zip(own, each, strict=True))
        fresh = torch.stack([found[k] for k in range(len(samples))])
        known = [place if turn == 0 else -1 for place, turn in zip(places, turns, strict=True)]
        self._remember(known, fresh)
        return fresh

    @torch.no_grad()
    def validate(self) -> float:
        """Return the mean PSNR in dB of validation scenes behind the pattern as it is now.

        The scenes are those of the decoder's training.
        """
        kept, self._remembered = self._remembered, self._compute_all()
        try:
            return validation_score(
                self._sampler,
                self._config,
                lambda drawn: self._decode(
                    drawn, [self._remembered[self._places(one)] for one in drawn]
                ),
            )
        finally:
            self._remembered = kept

    def extra_state(self) -> dict[str, Any]:
        """Return the transfer functions that are remembered."""
        return {"remembered": self._remembered.cpu()}

    def load_extra_state(self, state: dict[str, Any]) -> None:
        """Take over remembered transfer functions."""
        self._remembered = state["remembered"].to(self._processes.device)

    def _decode(
        self, drawn: Sequence[DrawnScene], transfers: Sequence[torch.Tensor]
    ) -> tuple[torch.Tensor, Captures]:
        """Capture scenes, and decode them behind the filter of all remembered depths."""
        shares = unmodulated_shares(drawn)
        mixed = [
            add_unmodulated_light(one, self._flat[self._places(scene)], float(share))
            for one, scene, share in zip(transfers, drawn, shares, strict=True)
        ]
        captures = capture_scenes(drawn, mixed, linear=self._config.scenes.light == "linear")
        known = DepthStatistics.of_transfers(self._remembered, self._flat, self._spectrum)
        front = known.front(shares.to(self._processes.device))
        return decode_captures(self.module.network, captures, front, mixed), captures

    def _places(self, scene: DrawnScene) -> list[int]:
        """Return the parts of the range of depths that a scene's layers are in."""
        return depth_indices(self._chances, scene.depths)

    def _remember(self, places: Sequence[int], fresh: torch.Tensor) -> None:
        """Replace what is remembered of parts of the range by what all processes computed."""
        device = self._processes.device
        where = self._processes.gather(torch.tensor(places, device=device)).tolist()
        remembered = self._remembered.clone()
        for place, one in zip(where, self._processes.gather(fresh), strict=True):
            if place >= 0 and bool(
                torch.isfinite(one.real).all() and torch.isfinite(one.imag).all()
            ):
                remembered[place] = one
        self._remembered = remembered

    @torch.no_grad()
    def _compute_all(self, *, flat: bool = False) -> torch.Tensor:
        """Compute the transfer functions of all parts of the range, for the pattern as it is.

        flat: for a flat pattern instead, as unmodulated light sees it.
        """
        phase = self._problem.phase(self.module.pattern)
        return compute_transfers(self._transfer, phase * (not flat), self._dioptres)
